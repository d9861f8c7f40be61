"""What a frame counter tells: lost, repeated, late frames, and whether it is stuck."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: So many equal counters in a row are no duplicate of one frame any more.
STUCK = 4


@dataclass(frozen=True, slots=True)
class Count:
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
        return self.longest_repeat >= STUCK - 1


def steps(counter: NDArray[np.uint64], time_ns: NDArray[np.int64], values: int) -> NDArray[np.int64]:
    """How many frames each one (n − 1) is ahead of the one before: 1 as it should be, 0 repeated, < 0 late.

    The counter knows this only modulo `values`; elapsed time, in periods, chooses among the numbers that agree
    with it. So a loss of exactly `values` frames shows, and two swapped frames are not taken for a loss.
    """
    signed = counter.astype(np.int64)
    step: NDArray[np.int64] = (signed[1:] - signed[:-1]) % values
    elapsed_ns = time_ns[1:] - time_ns[:-1]
    period_ns = _period(elapsed_ns[step == 1])
    if period_ns <= 0:
        return step
    # A whole turn is taken for missed from 3/4 of its time on: adapters that deliver in batches make the time
    # before a batch look long, and no real gap look shorter than it was by so much.
    turns = np.floor((elapsed_ns / period_ns - step) / values + 0.25)
    return step + values * turns.astype(np.int64)


def count(step: NDArray[np.int64], bad_between: NDArray[np.int64]) -> Count:
    """Sums up steps (m); bad_between (m): frames that did arrive in each step but whose counter cannot be trusted."""
    moved = step != 0
    missing = np.where(moved, step - 1, 0) - np.where(step > 1, bad_between, 0)
    return Count(
        lost=max(0, int(missing.sum())),
        gaps=int(np.count_nonzero(missing > 0)),
        repeats=int(np.count_nonzero(~moved)),
        longest_repeat=_longest(~moved),
        late=int(np.count_nonzero(step < 0)),
    )


def _longest(mask: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _period(elapsed_ns: NDArray[np.int64]) -> float:
    """Mean of the single steps without the longest hundredth, which may hide whole turns; 0 when there are none."""
    if not len(elapsed_ns):
        return 0.0
    kept = len(elapsed_ns) - max(1, len(elapsed_ns) // 100)
    return float(np.sort(elapsed_ns)[: max(1, kept)].mean())
