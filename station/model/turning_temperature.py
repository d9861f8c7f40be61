"""How fast the temperature changed in each visit by its own samples: a course through the means of visits is smooth,
and misses where a ramp of a chamber begins or ends within one."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: A visit's own rate is taken where it is off the smooth course by so many times what visits usually are; of so many
#: visits this can be told, each with so many samples in a quarter of it.
SHARP, LEAST_VISITS, LEAST_SAMPLES = 8.0, 12, 8
#: By how many steps of a coarse thermometer lines through quarters of a visit may be off at its ends, where the reading
#: changes twice in the visit or less, and where it does so more often.
FEW_STEPS, MORE_STEPS = 1.25, 0.75
#: The median of |x| beside the standard deviation of normal x.
MEDIAN_PER_SIGMA = 0.6745


def with_own_rates(slope: Floats, own: Floats) -> Floats:
    """Rates (v) of a smooth course, degC/s, but where the temperature turned within a visit its own; own (v, 2): these,
    and what they must be off by at the least."""
    own, least = own.T
    known = np.isfinite(own)
    if np.count_nonzero(known) < LEAST_VISITS:
        return slope
    off = own - slope
    # What every visit shows warms it as it arrives, and is no turn of the course.
    off -= np.median(off[known])
    usual = float(np.median(np.abs(off[known]))) / MEDIAN_PER_SIGMA
    turned = known & (np.abs(off) > np.maximum(SHARP * usual, least))
    return np.where(turned, slope + off, slope)


def own_rates(temperature_degC: Floats, time_s: Floats, visit: NDArray[np.intp], visits: int) -> Floats:
    """Mean rates (v, 2), degC/s, from the beginning of each visit to its end, which move its mean reading: by straight
    lines through the first and the last quarter of its samples (n), NaN where these are too few; and what they tell
    at the least, by the usual change of the reading from one sample to the next where it changes at all."""
    begin, end = np.full(visits, np.inf), np.full(visits, -np.inf)
    np.minimum.at(begin, visit, time_s)
    np.maximum.at(end, visit, time_s)
    span = np.where(end > begin, end - begin, np.nan)
    late = (time_s - begin[visit]) / span[visit]
    first = _line_at(late, temperature_degC, visit, late <= 0.25, 0.0, visits)
    last = _line_at(late, temperature_degC, visit, late >= 0.75, 1.0, visits)
    change = np.abs(np.diff(temperature_degC)) * (np.diff(visit) == 0)
    step = float(np.median(change[change > 0])) if change.any() else 0.0
    often = np.bincount(visit[1:], change > 0, visits) > 2
    return np.stack([(last - first) / span, np.where(often, MORE_STEPS, FEW_STEPS) * step / span], axis=1)


def _line_at(x: Floats, y: Floats, visit: NDArray[np.intp], used: NDArray[np.bool_], at: float, visits: int) -> Floats:
    """Values (v) at a place of the straight line through the samples used of each visit."""
    x, y, code = x[used], y[used], visit[used]
    n = np.bincount(code, minlength=visits).astype(float)
    few = n < LEAST_SAMPLES
    n[few] = np.nan
    mx, my = np.bincount(code, x, visits) / n, np.bincount(code, y, visits) / n
    dx = x - mx[code]
    square = np.bincount(code, dx**2, visits)
    return np.asarray(my + np.bincount(code, dx * y, visits) / np.where(square > 0, square, np.nan) * (at - mx))
