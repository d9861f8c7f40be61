"""Counters, drives and clocks of the line with single values missing or corrupt, and what stood there."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.recognition import corrupt_columns

#: Of more values than this share of a run nobody knows what stood there.
MOST = 0.2
#: More counts or drives than this share that differ from those on either side are no glitches.
MOST_ODD = 0.02

Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]


def counts(counter: Floats, visit: Rows, modulus: int) -> Floats:
    """Frame counters (n): one between two of which the second follows the first but one is the one between. One that
    came twice, or two that changed places, stand as they are."""
    missing = np.isnan(counter)
    middle = (visit[:-2] == visit[2:]) & ((counter[2:] - counter[:-2]) % modulus == 2 % modulus)
    step = (counter[1:-1] - counter[:-2]) % modulus
    odd = np.zeros(len(counter), bool)
    odd[1:-1] = middle & (step != 0) & (step != 1) & (step != 2)
    odd &= missing | (np.count_nonzero(odd & ~missing) <= max(MOST_ODD * len(counter), 1))
    rows = np.flatnonzero(odd)
    found = np.array(counter)
    found[rows] = (counter[rows - 1] + 1) % modulus
    return found if len(rows) else counter


def drives(motor: Floats, visit: Rows, run: Rows) -> Floats:
    """Drives of motors (n): one that differs from two alike on either side is as they are, a missing one as before."""
    odd = np.zeros(len(motor), bool)
    odd[1:-1] = (visit[:-2] == visit[2:]) & (motor[:-2] == motor[2:]) & (motor[1:-1] != motor[2:])
    if odd.sum() > max(MOST_ODD * len(motor), 1):
        odd[:] = False
    return _carried(motor, odd | np.isnan(motor), run)


def starts(started_s: Floats, run: Rows) -> Floats:
    """When runs started (n), one number a run: what most of its rows say."""
    other = np.zeros(len(started_s), bool)
    begin = np.flatnonzero(np.diff(run, prepend=-1))
    for first, last in zip(begin.tolist(), [*begin[1:].tolist(), len(run)], strict=True):
        own = started_s[first:last]
        if not (own == own[0]).all():
            values, count = np.unique(own, return_counts=True)
            other[first:last] = own != values[np.argmax(count)]
    return _carried(started_s, other, run)


def elapsed(since_s: Floats, time_s: Floats, visit: Rows, run: Rows) -> Floats:
    """Times elapsed (n), the missing and the corrupt ones at the pace of the stamps (n)."""
    missing = np.isnan(since_s)
    if missing.any():
        since_s = np.where(missing, _carried(since_s - time_s, missing, run) + time_s, since_s)
    return corrupt_columns.repaired_stamps(since_s, visit, run)


def _carried(value: Floats, unknown: Mask, run: Rows) -> Floats:
    """Values (n), those not known as the last known one of the run, or the first; a run with too few stays as it is."""
    if not unknown.any():
        return value
    found = np.array(value)
    for r in np.unique(run[unknown]).tolist():
        rows = np.flatnonzero(run == r)
        known = rows[~unknown[rows]]
        if len(known) >= (1 - MOST) * len(rows):
            last = np.searchsorted(known, rows, side="right") - 1
            found[rows] = value[known[np.maximum(last, 0)]]
    return found
