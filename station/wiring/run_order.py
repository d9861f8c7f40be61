"""What a person asks of the station, before anything is opened."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class RunOrder:
    """What the command line or the page asks for; None: as config.yaml says.

    mounted: with `simulate`, a map of how the rig is really built.
    effects: `ID` or `ID=SIZE`; faults: `KIND[:key=value,…]`, of every unit, or of one as `SERIAL/KIND…`.
    """

    recipe: str | None = None
    config: Path | None = None
    database: Path | None = None
    simulate: bool = False
    seed: int = 1
    effects: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    model: Path | None = None
    device_state: Path | None = None
    interface: str | None = None
    channel: str | None = None
    operator: str | None = None
    lot: str | None = None
    mounted: str | None = None
