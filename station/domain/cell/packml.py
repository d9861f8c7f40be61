"""The station's outer state: the state model of ANSI/ISA-TR88.00.02-2022 (PackML), as a literal table.

Held and suspended differ by whose fault the wait is: held, something inside the station wants a person; suspended,
something outside of it is missing (no units, the next machine is full). Aborted is left by Clear alone.
"""

from collections.abc import Mapping
from enum import IntEnum

from station.errors import UsageError
from station.messages import Message


class State(IntEnum):
    """The 17 states with the numbers of PackTags (StateCurrent)."""

    CLEARING = 1
    STOPPED = 2
    STARTING = 3
    IDLE = 4
    SUSPENDED = 5
    EXECUTE = 6
    STOPPING = 7
    ABORTING = 8
    ABORTED = 9
    HOLDING = 10
    HELD = 11
    UNHOLDING = 12
    SUSPENDING = 13
    UNSUSPENDING = 14
    RESETTING = 15
    COMPLETING = 16
    COMPLETE = 17

    @property
    def label(self) -> str:
        """The name as the standard spells it, in lower case."""
        return self.name.lower()


class Command(IntEnum):
    """Commands with the numbers of PackTags (CntrlCmd); 0 is no command."""

    RESET = 1
    START = 2
    STOP = 3
    HOLD = 4
    UNHOLD = 5
    SUSPEND = 6
    UNSUSPEND = 7
    ABORT = 8
    CLEAR = 9
    COMPLETE = 10

    @property
    def label(self) -> str:
        """The name in lower case."""
        return self.name.lower()


_S, _C = State, Command

#: What each acting state becomes when its work is done ("state complete"); execute ends so at the end of a load.
DONE: Mapping[State, State] = {
    _S.CLEARING: _S.STOPPED,
    _S.STOPPING: _S.STOPPED,
    _S.ABORTING: _S.ABORTED,
    _S.RESETTING: _S.IDLE,
    _S.STARTING: _S.EXECUTE,
    _S.HOLDING: _S.HELD,
    _S.UNHOLDING: _S.EXECUTE,
    _S.SUSPENDING: _S.SUSPENDED,
    _S.UNSUSPENDING: _S.EXECUTE,
    _S.EXECUTE: _S.COMPLETING,
    _S.COMPLETING: _S.COMPLETE,
}

#: From these a stop leads nowhere: the machine stands or is on its way to a stand already.
_NOT_RUNNING = frozenset({_S.STOPPING, _S.STOPPED, _S.CLEARING, _S.ABORTING, _S.ABORTED})
#: From these a hold leads to holding (OPC 30050, 6.3.8).
_HOLDABLE = frozenset({_S.STARTING, _S.EXECUTE, _S.UNHOLDING, _S.SUSPENDING, _S.SUSPENDED, _S.UNSUSPENDING})

#: Command → the states in which it is allowed → what follows.
TRANSITIONS: Mapping[Command, Mapping[State, State]] = {
    _C.RESET: {_S.STOPPED: _S.RESETTING, _S.COMPLETE: _S.RESETTING},
    _C.START: {_S.IDLE: _S.STARTING},
    _C.STOP: {state: _S.STOPPING for state in State if state not in _NOT_RUNNING},
    _C.HOLD: {state: _S.HOLDING for state in State if state in _HOLDABLE},
    _C.UNHOLD: {_S.HELD: _S.UNHOLDING},
    _C.SUSPEND: {_S.EXECUTE: _S.SUSPENDING},
    _C.UNSUSPEND: {_S.SUSPENDED: _S.UNSUSPENDING},
    _C.ABORT: {state: _S.ABORTING for state in State if state not in (_S.ABORTING, _S.ABORTED)},
    _C.CLEAR: {_S.ABORTED: _S.CLEARING},
    _C.COMPLETE: {_S.EXECUTE: _S.COMPLETING},
}


def after_command(state: State, command: Command) -> State:
    """What `command` makes of `state`. Errors: UsageError where the table does not allow it there."""
    following = TRANSITIONS[command].get(state)
    if following is None:
        raise UsageError(refusal(state, command))
    return following


def after_done(state: State) -> State:
    """What `state` becomes when its work is done; a waiting state stays."""
    return DONE.get(state, state)


def allowed(state: State) -> tuple[Command, ...]:
    """The commands that `state` takes."""
    return tuple(command for command in Command if state in TRANSITIONS[command])


def refusal(state: State, command: Command) -> Message:
    """Why a command is not followed, with those that would be."""
    takes = [c.label for c in allowed(state)]
    return Message("packml-command-refused", command=command.label, state=state.label, allowed=takes)


def diagram() -> str:
    """The table as a Mermaid state diagram; stop and abort, which lead from nearly everywhere, are left out."""
    lines = [f"    {a.label} --> {b.label}" for a, b in DONE.items()]
    for command, ways in TRANSITIONS.items():
        if command not in (Command.STOP, Command.ABORT):
            lines += [f"    {a.label} --> {b.label}: {command.label}" for a, b in ways.items()]
    return "\n".join(["stateDiagram-v2", f"    [*] --> {State.ABORTED.label}", *lines])
