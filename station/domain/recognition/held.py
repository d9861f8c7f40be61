"""Readings that stand in a recording more than once: rows that are written twice, stamp and all, and readings that a
logger whose rate is above the sensor's writes again until there is a new one."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats

#: So many rows show it; this share of them repeats the one before; and a new reading changes all three axes so often,
#: where the codes of a coarse converter change one by one.
LEAST_ROWS, LEAST_REPEATED, TOGETHER = 100, 0.3, 0.8
#: A reading lasts for at most so many times the usual number of rows, but for this share of them; or longer, where
#: hardly more than this share stand for one row, as they do where only a rest is frozen.
LONGEST, FEW = 2.0, 0.05
#: Rows of one stamp are one row written again where this share of them have one reading, …
MOST_ALIKE = 0.98
#: … and where that many equal readings would be so rare by chance, as readings of unlike stamps are equal.
BY_CHANCE = 1e-6


def rows_once(stamps: Array, reading: Floats) -> NDArray[np.intp] | None:
    """The rows (k) of stamps (n) and readings (n, 3) that are the first of those with one stamp and one reading; None
    where none is written again. Rows that share a coarse stamp and differ are readings of their own."""
    order = np.argsort(stamps, kind="stable")
    alike = np.r_[False, (reading[order[1:]] == reading[order[:-1]]).all(axis=1)]
    same = np.r_[False, stamps[order[1:]] == stamps[order[:-1]]]
    if not same.any() or np.mean(alike[same]) < MOST_ALIKE:
        return None
    by_chance = float(np.mean(alike[1:][~same[1:]])) if not same[1:].all() else 1.0
    if by_chance ** int(same.sum()) > BY_CHANCE:
        return None
    return np.sort(order[~(same & alike)])


def fresh_rows(reading: Floats) -> NDArray[np.intp] | None:
    """The rows (k) of readings (n, 3) that are new, the first of each that is repeated; None where nothing is held."""
    if len(reading) < LEAST_ROWS:
        return None
    changed = reading[1:] != reading[:-1]
    some = changed.any(axis=1)
    fresh = np.flatnonzero(np.r_[True, some])
    if np.mean(~some) < LEAST_REPEATED or len(fresh) < LEAST_ROWS / 4:
        return None
    lasts = np.diff(np.r_[fresh, len(reading)])
    held = np.mean(lasts > LONGEST * np.median(lasts)) <= FEW or np.mean(lasts == 1) <= FEW
    return fresh if held and changed[some].all(axis=1).mean() >= TOGETHER else None
