"""Readings that a logger writes again until the sensor has a new one: its rate is above the sensor's."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: So many rows show it; this share of them repeats the one before; and a new reading changes all three axes so often,
#: where the codes of a coarse converter change one by one.
LEAST_ROWS, LEAST_REPEATED, TOGETHER = 100, 0.3, 0.8
#: A reading lasts for at most so many times the usual number of rows, but for this share of them; or longer, where
#: hardly more than this share stand for one row, as they do where only a rest is frozen.
LONGEST, FEW = 2.0, 0.05


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
