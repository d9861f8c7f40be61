"""How far the readings of each visit move while they should rest: gross motion, not settling."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.medians import medians
from station.domain.core.types import Floats, SampleTable

#: Parts that a visit is cut into.
PARTS = 8
#: A visit moves when its parts' means range over more than this share of the stimulus: 1.7 degrees, …
GROSS = 0.03
#: … and so many times what the unit's visits usually range over: all visits may settle alike.
BEYOND_USUAL = 8.0
#: Two poses in one visit: the parts before and after a step agree among themselves to this share of it.
WITHIN_PART = 0.25

Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class VisitMotion:
    """range (v): distance between the farthest means of a visit's parts; scatter (v): standard deviation of its
    readings; step (v): the largest difference of the means before and after one place; within (v): the greatest range
    of the parts on either side of it."""

    range: Floats
    scatter: Floats
    step: Floats
    within: Floats


def of(table: SampleTable, begin: NDArray[np.int64], end: NDArray[np.int64], noise: Floats) -> VisitMotion:
    """Of every visit of a sorted table, rows begin (v) to end (v); noise (3) of one reading is taken off the range."""
    count = end - begin
    parts = np.minimum(PARTS, np.maximum(count // 4, 1))
    edge = begin[:, None] + (count[:, None] * np.minimum(np.arange(PARTS + 1) / parts[:, None], 1.0)).astype(np.int64)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(table.reading, axis=0)])
    rows = np.maximum(np.diff(edge, axis=1), 1)
    there = np.diff(edge, axis=1) > 0
    mean = (sums[edge[:, 1:]] - sums[edge[:, :-1]]) / rows[..., None]
    mean = np.where(there[..., None], mean, mean[:, :1])
    # The range of eight means of white noise is about three of their deviations.
    allowed = 3 * float(np.linalg.norm(noise)) / np.sqrt(np.maximum(count / parts, 1))
    full = np.maximum(np.linalg.norm(np.ptp(mean, axis=1), axis=1) - allowed, 0.0)
    step, within = np.zeros(len(begin)), full.copy()
    for cut in range(2, PARTS - 1):
        apart = np.linalg.norm(mean[:, cut:].mean(axis=1) - mean[:, :cut].mean(axis=1), axis=1)
        # The part that holds the step itself belongs to neither side.
        sides = [np.linalg.norm(np.ptp(side, axis=1), axis=1) for side in (mean[:, : cut - 1], mean[:, cut + 1 :])]
        rest = np.maximum(*sides) if cut > 1 else sides[1]
        better = apart > step
        step, within = np.where(better, apart, step), np.where(better, rest, within)
    middle = np.add.reduceat(table.reading, begin, axis=0) / count[:, None]
    square = np.add.reduceat((table.reading - np.repeat(middle, count, axis=0)) ** 2, begin, axis=0)
    return VisitMotion(full, np.sqrt(square.sum(axis=1) / count), step, within)


def moving(motion: VisitMotion, unit: NDArray[np.int32], size: float) -> tuple[Bools, Bools]:
    """Which visits (v) move, and which hold two poses; size: of the stimulus."""
    usual = np.zeros((len(unit), 2))
    for u in np.unique(unit):
        own = unit == u
        usual[own] = medians(motion.range[own]), medians(motion.scatter[own])
    gross = (motion.range > GROSS * size) & (motion.range > BEYOND_USUAL * usual[:, 0])
    gross |= (motion.scatter > GROSS * size) & (motion.scatter > BEYOND_USUAL * usual[:, 1])
    merged = gross & (motion.step > GROSS * size) & (motion.within < WITHIN_PART * motion.step)
    return gross & ~merged, merged
