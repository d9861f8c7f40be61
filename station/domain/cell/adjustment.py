"""What a line controller may change of a line that runs: its unit mode and a few times, until the line ends."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from types import MappingProxyType

from station.domain.cell.packml import Command, State


class UnitMode(IntEnum):
    """Modes with the numbers of OPC 30050, 6.5.2. In maintenance nothing starts, by itself or on command."""

    PRODUCE = 1
    MAINTENANCE = 2

    @property
    def label(self) -> str:
        """The name in lower case."""
        return self.name.lower()


#: The mode changes only where nothing moves and no load is in work.
MODE_CHANGES_IN = frozenset({State.STOPPED, State.IDLE, State.COMPLETE, State.ABORTED})
#: Commands that would move something.
REFUSED_IN_MAINTENANCE = frozenset({Command.RESET, Command.START})


@dataclass(frozen=True, slots=True)
class AdjustableTime:
    """name: as `line:` of config.yaml has it; least_s, most_s: limits of what is taken."""

    name: str
    least_s: float
    most_s: float


#: By the number under which a line controller knows it.
ADJUSTABLE: Mapping[int, AdjustableTime] = MappingProxyType(
    {
        1: AdjustableTime("starved_s", 0.0, 3600.0),
        2: AdjustableTime("scan_s", 0.1, 60.0),
    }
)


@dataclass(frozen=True, slots=True)
class LineAdjustment:
    """times_s: by name of ADJUSTABLE; what is not in it is as config.yaml has it."""

    mode: UnitMode = UnitMode.PRODUCE
    times_s: Mapping[str, float] = field(default_factory=dict)
