"""What a frame counter tells: lost, repeated, late frames, and whether it is stuck."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: So many equal counters in a row are no duplicate of one frame any more.
STUCK_FRAMES = 4
#: Frames overtake each other by one or two places; further back is a loss of nearly a whole turn.
MAX_REORDERING = 2
#: From this share of its time on, a turn counts as missed.
WRAP_SHARE = 0.75
#: From this ratio on between the mean time per frame and that of short stretches, frames come in bursts: not even three
#: of four frames lost would slow them down so much.
BURSTS = 4.0
#: So many frames on either side of a pause are looked at; an adapter that holds back more is taken for a loss.
WINDOW = 1024


@dataclass(frozen=True, slots=True)
class CounterErrors:
    """lost: frames missing between the first and the last; gaps: places where some are; repeats: frames with the

    counter of the one before; longest_repeat: most such frames in a row; late: frames behind their turn.
    """

    lost: int = 0
    gaps: int = 0
    repeats: int = 0
    longest_repeat: int = 0
    late: int = 0

    @property
    def stuck(self) -> bool:
        """The counter stood still, which repeated single frames do not explain."""
        return self.longest_repeat >= STUCK_FRAMES - 1


def counter_steps(counter: NDArray[np.uint64], time_ns: NDArray[np.int64], values: int) -> NDArray[np.int64]:
    """How many frames each one (n − 1) is ahead of the one before: 1 as it should be, 0 repeated, < 0 late.

    The counter knows this only modulo `values`; time chooses among the numbers that agree with it. So a loss of
    exactly `values` frames shows, two swapped frames are no loss, and neither is a pause after which the adapter
    hands over all that it held back.
    """
    signed = counter.astype(np.int64)
    apart: NDArray[np.int64] = signed[1:] - signed[:-1]
    elapsed_ns = time_ns[1:] - time_ns[:-1]
    in_turn = bool(((apart == 1) | (apart == 1 - values)).all())
    step = np.ones(len(apart), np.int64) if in_turn else apart % values
    if in_turn and _no_pause(elapsed_ns, values):
        return step
    period_ns = _period(None if in_turn else step, time_ns)
    if period_ns <= 0:
        return step
    if not in_turn and values >= 2 * MAX_REORDERING + 2:
        step[(step >= values - MAX_REORDERING) & (elapsed_ns < period_ns * step / 2)] -= values
    _add_wraps(step, elapsed_ns / period_ns, values)
    return step


def _no_pause(elapsed_ns: NDArray[np.int64], values: int) -> bool:
    """Whether no pause is long enough to hide a turn."""
    return bool(elapsed_ns.max(initial=0) * len(elapsed_ns) <= values // 2 * elapsed_ns.sum())


def count_errors(step: NDArray[np.int64], bad_between: NDArray[np.int64]) -> CounterErrors:
    """Sums up steps (m); bad_between (m): frames that did arrive in each step but whose counter cannot be trusted."""
    moved = step != 0
    missing = np.where(moved, step - 1, 0) - np.where(step > 1, bad_between, 0)
    return CounterErrors(
        lost=max(0, int(missing.sum())),
        gaps=int(np.count_nonzero(missing > 0)),
        repeats=int(np.count_nonzero(~moved)),
        longest_repeat=_longest(~moved),
        late=int(np.count_nonzero(step < 0)),
    )


def _period(step: NDArray[np.int64] | None, time_ns: NDArray[np.int64]) -> float:
    """Median time per frame over stretches of many frames, which neither pauses nor losses move; 0: none. Where those
    are but parts of bursts, the mean.

    step (n − 1); None: every frame is one ahead of the one before.
    """
    stretch = max(1, min(64, (len(time_ns) - 1) // 8))
    elapsed_ns: NDArray[np.int64] = time_ns[stretch:] - time_ns[:-stretch]
    if not len(elapsed_ns):
        return 0.0
    if step is None:
        return _over_bursts(float(np.median(elapsed_ns / stretch)), time_ns, len(time_ns) - 1)
    number = np.concatenate([[0], np.cumsum(step)])
    frames = number[stretch:] - number[:-stretch]
    elapsed_ns = elapsed_ns[frames > 0]
    if not len(elapsed_ns):
        return 0.0
    return _over_bursts(float(np.median(elapsed_ns / frames[frames > 0])), time_ns, int(number[-1]))


def _over_bursts(period_ns: float, time_ns: NDArray[np.int64], frames: int) -> float:
    """The period, or the mean one over `frames` where frames come in bursts."""
    mean_ns = int(time_ns[-1] - time_ns[0]) / max(frames, 1)
    return mean_ns if mean_ns > BURSTS * period_ns else period_ns


def _add_wraps(step: NDArray[np.int64], elapsed: NDArray[np.float64], values: int) -> None:
    """Adds the whole turns that pauses hide; elapsed (n − 1) in periods.

    Frames come late, never early: the least delay before and after a pause is compared. After a mere pause the
    delay falls back to what it was; after a loss it stays up by `values` periods for each turn.
    """
    longer = elapsed - step
    pauses = np.flatnonzero(longer >= WRAP_SHARE * values)
    if not len(pauses):
        return
    delay = np.zeros(len(longer) + 1)
    np.cumsum(longer, out=delay[1:])
    first = 0
    for pause in pauses.tolist():
        before = delay[max(first, pause + 1 - WINDOW) : pause + 1].min()
        after = delay[pause + 1 : pause + 1 + WINDOW].min()
        turns = int((after - before) / values + 1 - WRAP_SHARE)
        if turns > 0:
            step[pause] += values * turns
            first = pause + 1


def _longest(mask: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))
