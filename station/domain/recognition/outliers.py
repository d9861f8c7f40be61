"""Single readings that a line, a logger or a knock made: far off what the sensor read before and after, which agree."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.recognition.sheet import noise_of

#: Less than this share of the stimulus is left to the means, which bound what single readings do.
FAR = 0.03
#: … and so is what lies nearer than so many standard deviations of the noise, or steps of the output.
SIGMA, STEPS = 10.0, 2.5
#: Readings before and after that are compared, the fewest that tell, and the most outliers together.
NEARBY, LEAST, TOGETHER = 6, 4, 3
#: Sides of an outlier agree, and are quiet, to this share of how far off it is, and to so many standard deviations
#: of the noise: where something moves, a jerk is none of the line's.
AGREE, REST = 0.1, 4.0
#: Where more of the readings between two boundaries are outliers, what is measured moves or shakes.
MOST = 0.05

Rows = NDArray[np.int64]


def replace_outliers(reading: Floats, begin: Rows, end: Rows, size: float) -> tuple[Floats, Floats]:
    """Readings (n, 3) with each outlier as its neighbours are, and by how much each was off (n), 0 where it stays.

    begin, end (v): rows of visits that follow each other; size: of the stimulus.
    """
    off, within = np.zeros(len(reading)), np.ones(max(len(reading) - 1, 0), bool)
    within[begin[1:] - 1] = False
    apart = np.abs(np.diff(reading, axis=0))
    if not (apart.max(axis=1, initial=0.0)[within] > FAR * size).any():
        return reading, off
    noise = noise_of(reading, within)
    step = np.where(within[:, None] & (apart > 0), apart, np.inf).min(axis=0)
    least = np.maximum(FAR * size, SIGMA * noise)
    least = np.maximum(least, np.where(np.isfinite(step), STEPS * step, 0.0))
    jump = (apart > least).any(axis=1)
    edge = np.flatnonzero(np.r_[True, jump | ~within, True])
    start, stop = edge[:-1], edge[1:]
    # A stretch is short, and a jump leads into it or out of it: boundaries of visits alone are no jumps.
    jumped = np.r_[False, jump & within, False]
    short = (stop - start <= TOGETHER) & (jumped[start] | jumped[stop])
    # Where readings jump all the time nothing is at rest, and a recording may hold very many of them.
    jumps = np.cumsum(jumped)
    short &= jumps[np.minimum(stop + NEARBY, len(reading))] - jumps[np.maximum(start - NEARBY, 0)] <= NEARBY
    if not short.any():
        return reading, off
    out = np.array(reading)
    visit = np.searchsorted(begin, start[short], side="right") - 1
    for first, last, v in zip(start[short].tolist(), stop[short].tolist(), visit.tolist(), strict=True):
        before = reading[max(first - NEARBY, begin[v]) : first]
        after = reading[last : min(last + NEARBY, end[v])]
        centre, restless = _neighbours(before, after)
        far = np.abs(reading[first:last] - centre)
        bound = np.minimum(REST * noise, AGREE * far.max())
        if (far > least).any(axis=1).all() and (restless <= bound).all():
            out[first:last], off[first:last] = centre, far.max(axis=1)
    many = np.add.reduceat(off > 0, begin) > np.maximum(MOST * (end - begin), 1)
    stays = np.repeat(many, end - begin)
    return np.where(stays[:, None], reading, out), np.where(stays, 0.0, off)


def _neighbours(before: Floats, after: Floats) -> tuple[Floats, Floats]:
    """What readings (n, 3) on either side of some read (3), and how little they agree (3): not at all where they are
    too few."""
    nearby = np.concatenate([before, after])
    if len(nearby) < LEAST:
        return np.zeros(3), np.full(3, np.inf)
    sides = [side for side in (before, after) if len(side)]
    middles = [np.median(side, axis=0) for side in sides]
    scatter = [np.median(np.abs(side - middle), axis=0) for side, middle in zip(sides, middles, strict=True)]
    # The upper median is a reading: the mean of two may lie between the steps of the output.
    middle = np.sort(nearby, axis=0)[len(nearby) // 2]
    # Quiet on one side alone is where a motion begins or ends.
    return middle, np.max([np.ptp(middles, axis=0), *scatter], axis=0)
