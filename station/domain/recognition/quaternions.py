"""Four columns that are a quaternion, and three of which would go round a sphere as a compass does."""

from itertools import combinations

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition.raw_table import RawTable

#: The length of a quaternion stays the same within this share, but for few rows; that of any three of its parts ranges
#: over more, unless nothing turns.
SAME, BUT_FEW, RANGES = 0.002, 0.95, 0.05


def without_them(table: RawTable, free: list[int]) -> list[int]:
    """Columns without those that are a quaternion, where three others are left."""
    left = list(free)
    for first in free:
        four = [first + i for i in range(4)]
        if set(four) <= set(left) and _is_quaternion(np.stack([table.numbers(i) for i in four], axis=1)):
            left = [i for i in left if i not in four]
    return left if len(left) >= 3 else free


def _is_quaternion(parts: Floats) -> bool:
    """Whether four columns (n, 4) are of one length, and no three of them are."""
    known = parts[np.isfinite(parts).all(axis=1)]
    if not len(known):
        return False
    length = np.linalg.norm(known, axis=1)
    middle = float(np.median(length))
    if not middle > 0 or np.quantile(np.abs(length - middle), BUT_FEW) > SAME * middle:
        return False
    return all(
        np.ptp(np.linalg.norm(known[:, list(three)], axis=1)) > RANGES * middle for three in combinations(range(4), 3)
    )
