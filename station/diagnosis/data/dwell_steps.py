"""Where an offset jumps within a short dwell and stays changed for the rest of the run.

A dwell is too short to show by itself that a change of its mean is a jump. The other dwells of the unit show what is
usual, including what settles after each arrival: the dwell must stand out alone in its run. And the visits after it
must differ from those before by as much as the dwell shows, which neither a bump nor one slow arrival causes.
"""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.medians import medians
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.forward import resting_stimulus
from station.model.scene import visits_scene_of_table

#: Places of a dwell at which it is looked for, and the fewest readings on either side.
PLACES, LEAST_READINGS = 16, 8
#: A change of the mean is a jump from so many robust deviations on: of a thousand dwells three axes at sixteen places
#: reach 4.3 by chance. Readings beyond so many of their own noise count as that far away.
SIGMA, CLIP = 6.5, 4.0
#: What comes after differs from what was before by the change within the dwell to these shares of it.
SAME = (0.6, 1.4)

Rows = NDArray[np.intp]


def find(recipe: Recipe, table: SampleTable, begin: Rows, end: Rows, some: NDArray[np.bool_]) -> list[int]:
    """First rows after a jump, rising. begin, end (v): rows of the stays of a sorted table; some (v): those to look at.
    Nothing where nobody knows the poses: what was before the jump cannot be compared with what comes after."""
    some = some & (end - begin >= 2 * LEAST_READINGS)
    if not recipe.pose_known or not some.any():
        return []
    sums, noise = _calmed(table, begin, end)
    standing_out = np.zeros(len(begin), bool)
    standing_out[some] = _beyond_usual(_changes(sums, begin[some], end[some], noise), table.unit.code[begin[some]])
    code = np.stack([table.unit.code[begin], table.run[begin]])
    edge = np.flatnonzero(np.any(np.diff(code, axis=1, prepend=-1) != 0, axis=0))
    found, stimulus = list[int](), None
    for first, last in zip(edge.tolist(), [*edge[1:].tolist(), len(begin)], strict=True):
        jumped = np.flatnonzero(standing_out[first:last])
        # What two dwells of a run do arrivals do, too.
        if len(jumped) != 1:
            continue
        v = first + int(jumped[0])
        row = _clearest(sums, int(begin[v]), int(end[v]), noise)
        # Drawn in, the readings show where it is, and not how large.
        sides = table.reading[begin[v] : row], table.reading[row : end[v]]
        change = np.median(sides[1], axis=0) - np.median(sides[0], axis=0)
        mean = (sums[end[first:last]] - sums[begin[first:last]]) / (end - begin)[first:last, None]
        stimulus = _stimulus(recipe, table, begin) if stimulus is None else stimulus
        if _stays(mean, stimulus[first:last], int(jumped[0]), change):
            found.append(row)
    return found


def _calmed(table: SampleTable, begin: Rows, end: Rows) -> tuple[Floats, Floats]:
    """Running sums (n + 1, 3) of the readings, outliers limited, and the noise of the difference of neighbours (3)."""
    count = end - begin
    middle = np.repeat(np.add.reduceat(table.reading, begin, axis=0) / count[:, None], count, axis=0)
    inside = np.ones(len(table), bool)
    inside[begin] = False
    noise = np.median(np.abs(np.diff(table.reading, axis=0, prepend=0))[inside], axis=0) / 0.6745 / np.sqrt(2)
    off = table.reading - middle
    calm = np.where(noise > 0, np.clip(off, -CLIP * noise, CLIP * noise), off)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(middle + calm, axis=0)]), noise


def _changes(sums: Floats, begin: Rows, end: Rows, noise: Floats) -> Floats:
    """Changes of the mean (v, places, 3) in standard deviations of white noise; 0 where readings are too few."""
    share = np.arange(1, PLACES) / PLACES
    row = begin[:, None] + np.round((end - begin)[:, None] * share).astype(np.intp)
    return _change_at(sums, begin[:, None], row, end[:, None], noise)


def _change_at(sums: Floats, begin: Rows | np.intp, row: Rows, end: Rows | np.intp, noise: Floats) -> Floats:
    """The change of the mean (…, 3) at rows (…) between others, in standard deviations of white noise."""
    before, after = (row - begin)[..., None], (end - row)[..., None]
    enough = np.minimum(before, after) >= LEAST_READINGS
    n, m = np.maximum(before, 1), np.maximum(after, 1)
    change = (sums[end] - sums[row]) / m - (sums[row] - sums[begin]) / n
    std = noise * np.sqrt(1 / n + 1 / m)
    return np.where(enough & (std > 0), change / np.where(std > 0, std, 1.0), 0.0)


def _beyond_usual(change: Floats, unit: NDArray[np.int32]) -> NDArray[np.bool_]:
    """The dwells (v) that change as none of their unit usually does."""
    found = np.zeros(len(unit), bool)
    for u in np.unique(unit).tolist():
        own = unit == u
        each = np.moveaxis(change[own], 0, -1)
        off = np.abs(each - medians(each)[..., None])
        usual = np.maximum(medians(off) / 0.6745, 1.0)
        found[own] = (off / usual[..., None]).max(axis=(0, 1)) > SIGMA
    return found


def _clearest(sums: Floats, begin: int, end: int, noise: Floats) -> int:
    """The row of a dwell at which its mean changes the most."""
    rows = np.arange(begin + LEAST_READINGS, end - LEAST_READINGS + 1)
    change = _change_at(sums, np.intp(begin), rows, np.intp(end), noise)
    return int(rows[np.argmax(np.sum(change**2, axis=1))])


def _stimulus(recipe: Recipe, table: SampleTable, begin: Rows) -> Floats:
    """What each stay's unit should feel (v, 3)."""
    return resting_stimulus(visits_scene_of_table(recipe, table[begin]))


def _stays(mean: Floats, stimulus: Floats, at: int, change: Floats) -> bool:
    """Whether the visits of a run (v, 3) after the one at which it changes differ from those before by as much, beside
    each axis' own offset and gain."""
    known = np.arange(len(mean)) != at
    after = (np.arange(len(mean)) > at)[known].astype(float)
    size = np.zeros(3)
    for i in range(3):
        columns = np.stack([np.ones(len(after)), stimulus[known, i], after], axis=1)
        columns[:, 1] *= np.ptp(stimulus[:, i]) > 0
        solved, _, rank, _ = np.linalg.lstsq(columns, mean[known, i], rcond=1e-9)
        if rank <= int(np.any(columns[:, 1])) + 1 or rank == len(after):
            return False
        size[i] = solved[2]
    # In coarse steps the readings on both sides may have one median: no change at all.
    low, high = (share * float(change @ change) for share in SAME)
    return low < float(size @ change) < high
