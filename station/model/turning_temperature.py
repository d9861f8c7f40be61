"""How fast the temperature changed in each visit by its own samples: a course through the means of visits is smooth,
and misses where a ramp of a chamber begins or ends within one."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: A visit's own rate is taken where it is off the smooth course by so many times what visits usually are; of so many
#: visits this can be told, each with so many samples in a quarter of it.
SHARP, LEAST_VISITS, LEAST_SAMPLES = 8.0, 12, 8
#: The median of |x| beside the standard deviation of normal x.
MEDIAN_PER_SIGMA = 0.6745


def with_own_rates(slope: Floats, own: Floats) -> Floats:
    """Rates (v) of a smooth course, degC/s, but where the temperature turned within a visit its own (v)."""
    known = np.isfinite(own)
    if np.count_nonzero(known) < LEAST_VISITS:
        return slope
    off = own - slope
    # What every visit shows warms it as it arrives, and is no turn of the course.
    off -= np.median(off[known])
    usual = float(np.median(np.abs(off[known]))) / MEDIAN_PER_SIGMA
    turned = known & (np.abs(off) > SHARP * usual)
    return np.where(turned, slope + off, slope)


def own_rates(temperature_degC: Floats, time_s: Floats, visit: NDArray[np.intp], visits: int) -> Floats:
    """Mean rates (v), degC/s, from the beginning of each visit to its end, which move its mean reading: by straight
    lines through the first and the last quarter of its samples (n); NaN where these are too few."""
    begin, end = np.full(visits, np.inf), np.full(visits, -np.inf)
    np.minimum.at(begin, visit, time_s)
    np.maximum.at(end, visit, time_s)
    span = np.where(end > begin, end - begin, np.nan)
    late = (time_s - begin[visit]) / span[visit]
    first = _line_at(late, temperature_degC, visit, late <= 0.25, 0.0, visits)
    last = _line_at(late, temperature_degC, visit, late >= 0.75, 1.0, visits)
    return np.asarray((last - first) / span)


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
