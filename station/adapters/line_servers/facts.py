"""What both servers say, from the line's own word. A line that no longer says anything is not available."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from station.domain.cell.packml import State

#: A line says its state at each step, at least so often while it waits, s; long runs say it unit by unit.
STALE_S = 600.0
#: OPC 40001-1, MachineryItemState.
NOT_AVAILABLE, OUT_OF_SERVICE, NOT_EXECUTING, EXECUTING = 0, 1, 2, 3
#: How an outcome travels as a number.
OUTCOME_CODES = {"": 0, "PASS": 1, "FAIL": 2, "ERROR": 3, "ABORTED": 4, "INTERRUPTED": 5}


@dataclass(frozen=True, slots=True)
class LineFacts:
    """state: None where no line runs; nests: name, serial and outcome of each; seconds: of each state by name."""

    state: State | None
    station: str
    recipe: str
    load: int
    loads: int
    why: str
    nests: tuple[tuple[str, str, str], ...]
    seconds: Mapping[str, float]

    @property
    def item_state(self) -> int:
        """MachineryItemState (OPC 40001-1)."""
        if self.state is None:
            return NOT_AVAILABLE
        if self.state in (State.ABORTING, State.ABORTED, State.CLEARING, State.STOPPED, State.STOPPING):
            return OUT_OF_SERVICE
        return EXECUTING if self.state in (State.STARTING, State.EXECUTE, State.COMPLETING) else NOT_EXECUTING


def facts_of(document: Mapping[str, Any] | None, why: str, *, alive: bool) -> LineFacts:
    """From the document of `station.line/1`; None: there is none. why: its sentence; alive: its process is there."""
    if document is None:
        return LineFacts(None, "", "", 0, 0, "", (), {})
    return LineFacts(
        state=State(document["state"]) if alive else None,
        station=str(document["station"]),
        recipe=str(document["recipe"]),
        load=int(document["load"]),
        loads=int(document["loads"]),
        why=why,
        nests=tuple((str(n["nest"]), str(n["serial"]), str(n["outcome"])) for n in document["nests"]),
        seconds={str(name): float(seconds) for name, seconds in document["seconds"].items()},
    )
