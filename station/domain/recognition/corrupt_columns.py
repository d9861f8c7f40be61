"""Stamps and temperatures that a line, a logger or a thermometer corrupted, and what stood there by neighbours."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: A stamp so far before the one before it, or after the one after it, is none; nearer, a frame was late. Seconds, and
#: periods of the readings.
FAR_S, FAR_PERIODS = 1.0, 20.0
#: Stamps that are wrong together, and the share of all beyond which the rows are in another order.
TOGETHER, MOST_STAMPS = 3, 0.02
#: No thermometer is that cold or that hot, and none changes by more from one reading to the next within a visit.
COLDEST_DEGC, HOTTEST_DEGC, JUMP_DEGC = -100.0, 300.0, 5.0
#: Where it read before and after agrees to this share of the jump.
AGREE = 0.2
#: Where more of a run's temperatures are missing or outliers, nobody knows them.
MOST = 0.2

Mask = NDArray[np.bool_]


def repaired_stamps(time_s: Floats, visit: NDArray[np.intp], run: NDArray[np.intp], least: float = FAR_S) -> Floats:
    """Stamps (n), the corrupt ones at the pace of their neighbours.

    visit, run (n): numbers, of rows that follow each other; a visit belongs to one run. least: nearer than that no
    stamp is corrupt.
    """
    corrupt = np.zeros(len(time_s), bool)
    step = np.diff(time_s)
    if not (step < -least).any():
        return time_s
    inside = step[np.diff(visit) == 0]
    period = float(np.median(inside)) if len(inside) else 0.0
    far = max(least, FAR_PERIODS * period)
    for length in range(1, TOGETHER + 1):
        if len(time_s) < length + 2:
            break
        before, after = time_s[: -length - 1], time_s[length + 1 :]
        sound = (before <= after) & (run[: -length - 1] == run[length + 1 :])
        sound &= ~corrupt[: -length - 1] & ~corrupt[length + 1 :]
        rows = [slice(1 + i, len(time_s) - length + i) for i in range(length)]
        outside = [(time_s[r] < before - far) | (time_s[r] > after + far) for r in rows]
        for r in rows:
            corrupt[r] |= sound & np.logical_and.reduce(outside)
    if not 0 < corrupt.sum() <= max(MOST_STAMPS * len(time_s), TOGETHER):
        return time_s
    # Between visits a pose changes: what is corrupt at the end of one stands a period from its own.
    found, kept = np.array(time_s), np.flatnonzero(~corrupt)
    for row in np.flatnonzero(corrupt).tolist():
        near = kept[np.argsort(np.abs(kept - row), kind="stable")[: 2 * TOGETHER]]
        own = near[visit[near] == visit[row]]
        paced = time_s[own] + period * (row - own) if len(own) else np.interp(row, kept, time_s[kept])
        found[row] = np.median(paced)
    return found


def repaired_temperatures(value: Floats, time_s: Floats, visit: NDArray[np.intp], run: NDArray[np.intp]) -> Floats:
    """Temperatures (n), the missing ones and the outliers from what was read before and after.

    time_s, visit, run (n): of the rows, which follow each other. A run of which too much is not known stays as it is.
    """
    known = np.isfinite(value) & (value > COLDEST_DEGC) & (value < HOTTEST_DEGC)
    if known.all() and not ((np.abs(np.diff(value)) > JUMP_DEGC) & (np.diff(visit) == 0)).any():
        return value
    found = np.array(value)
    begin = np.flatnonzero(np.diff(run, prepend=-1))
    for first, last in zip(begin.tolist(), [*begin[1:].tolist(), len(value)], strict=True):
        rows = np.flatnonzero(known[first:last]) + first
        if len(rows):
            rows = rows[~_outlying(value[rows], visit[rows])]
        unknown = np.ones(last - first, bool)
        unknown[rows - first] = False
        missing = np.flatnonzero(unknown) + first
        if len(missing) and len(missing) <= MOST * (last - first):
            found[missing] = np.interp(time_s[missing], time_s[rows], value[rows])
    return found


def _outlying(value: Floats, visit: NDArray[np.intp]) -> Mask:
    """Which temperatures (n) of one run no thermometer had: they jump within a visit, and back to where they were. The
    shortest stretches first, as what stands between two of them is long without them."""
    outlying = np.zeros(len(value), bool)
    while True:
        rows = np.flatnonzero(~outlying)
        found = _shortest_jumps(value[rows], visit[rows], MOST * len(value) - np.count_nonzero(outlying))
        if not found.any():
            return outlying
        outlying[rows[found]] = True


def _shortest_jumps(value: Floats, visit: NDArray[np.intp], most: float) -> Mask:
    """The shortest of the stretches of temperatures (n) that jump and return, of at most so many rows."""
    jump, within = np.abs(np.diff(value)) > JUMP_DEGC, np.diff(visit) == 0
    found = np.zeros(len(value), bool)
    if not (jump & within).any():
        return found
    edge = np.r_[0, np.flatnonzero(jump) + 1, len(value)]
    first, last = edge[:-1], edge[1:]
    inside = np.r_[False, within[edge[1:-1] - 1], False]
    before, after = value[np.maximum(first - 1, 0)], value[np.minimum(last, len(value) - 1)]
    # At either end of a run there is one side alone.
    before, after = np.where(first > 0, before, after), np.where(last < len(value), after, before)
    off = np.minimum(np.abs(before - value[first]), np.abs(after - value[last - 1]))
    outlying = (inside[:-1] | inside[1:]) & (np.abs(before - after) < AGREE * off) & (last - first <= most)
    if outlying.any():
        shortest = outlying & (last - first == (last - first)[outlying].min())
        found = np.repeat(shortest, last - first)
    return found
