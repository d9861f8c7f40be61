"""Which lamps a stack light shows in each outer state (IEC 60204-1, table 4; ISA-TR88.00.02 gives no colours). Pure."""

from station.domain.cell.packml import State

#: Red: stop and look. Yellow: something is missing or wanted. Green: it works. Blue: a person must do something. White:
#: ready. `flash` and `sound` go with the others.
_LAMPS: dict[State, frozenset[str]] = {
    State.ABORTING: frozenset({"red", "flash", "sound"}),
    State.ABORTED: frozenset({"red", "flash", "sound"}),
    State.CLEARING: frozenset({"red"}),
    State.STOPPING: frozenset({"red"}),
    State.STOPPED: frozenset({"red"}),
    State.HOLDING: frozenset({"yellow", "blue"}),
    State.HELD: frozenset({"yellow", "blue", "flash", "sound"}),
    State.UNHOLDING: frozenset({"yellow"}),
    State.SUSPENDING: frozenset({"yellow"}),
    State.SUSPENDED: frozenset({"yellow"}),
    State.UNSUSPENDING: frozenset({"yellow", "green"}),
    State.RESETTING: frozenset({"white", "flash"}),
    State.IDLE: frozenset({"white"}),
    State.STARTING: frozenset({"green", "flash"}),
    State.EXECUTE: frozenset({"green"}),
    State.COMPLETING: frozenset({"green", "flash"}),
    State.COMPLETE: frozenset({"white", "green"}),
}


def lamps(state: State) -> frozenset[str]:
    """The lamps of that state."""
    return _LAMPS[state]
