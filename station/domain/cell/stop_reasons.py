"""Why a line stood: the reasons of its holds, suspensions and aborts, with when each began and ended."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from station.domain.cell.packml import State
from station.messages import Message

#: States in which a line stands for a reason, or is on its way there.
STANDING = frozenset({
    State.HOLDING, State.HELD, State.SUSPENDING, State.SUSPENDED, State.ABORTING, State.ABORTED,
})  # fmt: skip
#: So many are remembered.
MOST_REASONS = 16


@dataclass(frozen=True, slots=True)
class StopReason:
    """state: in which it began; began_s, ended_s: seconds since 1970, ended_s None while it lasts."""

    why: Message
    state: State
    began_s: float
    ended_s: float | None = None


def after_change(
    reasons: Sequence[StopReason], state: State, why: Message | None, now_s: float
) -> tuple[StopReason, ...]:
    """The reasons, newest first, once the line is in `state`, for `why` where it stands for a reason."""
    lasts = reasons[0] if reasons and reasons[0].ended_s is None else None
    stands_for = why if state in STANDING else None
    if lasts is not None and (stands_for == lasts.why or (stands_for is None and state in STANDING)):
        return tuple(reasons)  # holding became held
    ended = tuple(replace(r, ended_s=now_s) if r is lasts else r for r in reasons)
    if stands_for is None:
        return ended
    return (StopReason(stands_for, state, now_s), *ended)[:MOST_REASONS]
