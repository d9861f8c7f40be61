"""How many readings a second a sensor makes, by the stamps of its readings."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: Stamps are regular when this share of their steps misses a whole number of usual ones by less than this share of one.
MOSTLY, REGULAR = 0.95, 0.1
#: Readings come in bursts where at least this share of steps is shorter than this share of the usual one.
IN_BURSTS, IN_BURST = 1 / 3, 0.2
#: Where at least this share of all steps is long, they are no pauses but lead from burst to burst, if a burst takes
#: less than this share of such a step.
BURSTS, BURST_SHARE = 0.05, 0.5


def rate_of(time_s: Floats, within: NDArray[np.bool_]) -> tuple[float | None, float]:
    """Readings a second, by counts over the spans of the visits, and the scatter (s) of a step about it.

    Steps of more than five usual ones are pauses and count on neither side. Late stamps make a step back that counts.
    Of readings that come in bursts the first burst of a visit took its time before the visit, and the last may be cut.
    """
    steps = np.diff(time_s)
    ahead = steps[within & (steps > 0)]
    if not len(ahead):
        return None, 0.0
    usual = _usual_step(ahead)
    counts = within & (np.abs(steps) <= 5 * usual)
    whole_bursts = counts & ~_cut_bursts(steps, within, usual)
    counts = whole_bursts if whole_bursts.any() else counts
    regular = steps[counts]
    span = float(regular.sum())
    if not span > 0:
        return None, 0.0
    # Where stamps come at whole steps, the readings that are missing are counted, too.
    whole = np.round(regular / usual)
    are_whole = np.mean(np.abs(regular / usual - whole) < REGULAR) > MOSTLY
    periods = np.maximum(whole, 1) if are_whole else np.ones(len(whole))
    rate = float(periods.sum()) / span
    return rate, float(np.sqrt(np.mean((regular - periods / rate) ** 2)))


def _usual_step(ahead: Floats) -> float:
    """The usual step (s) of stamps that go ahead by `ahead` (n): of bursts whose readings have a stamp each, the step
    from burst to burst."""
    usual = float(np.median(ahead))
    apart = ahead[ahead > 5 * usual]
    if len(apart) < BURSTS * len(ahead):
        return usual
    burst = float(np.median(apart))
    return burst if usual * len(ahead) / len(apart) < BURST_SHARE * burst else usual


def _cut_bursts(steps: Floats, within: NDArray[np.bool_], usual: float) -> NDArray[np.bool_]:
    """Which of the steps (n) are within the first burst of a visit or lead to and through its last, which the visit may
    cut; none where readings do not come in bursts."""
    small = within & (np.abs(steps) < IN_BURST * usual)
    if not within.any() or np.count_nonzero(small) < IN_BURSTS * np.count_nonzero(within):
        return np.zeros(len(steps), bool)
    first = small & (_long_steps_before(within, small) == 0)
    last = within & (_long_steps_before(within[::-1], small[::-1])[::-1] == 0)
    return np.asarray(first | last)


def _long_steps_before(within: NDArray[np.bool_], small: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many steps of the same visit before each (n) lead from burst to burst."""
    long = within & ~small
    ahead = np.cumsum(long)
    return np.asarray(ahead - long - np.maximum.accumulate(np.where(within, 0, ahead)))
