"""Two groups of one value, before and after a change: how far their means lie apart, with its interval."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from station.domain.core.types import Floats

LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class GroupMean:
    """Mean of n values with the half-width of its 95 % interval."""

    n: int
    mean: float
    half_width: float


@dataclass(frozen=True, slots=True)
class MeanChange:
    """Mean after minus mean before with the half-width of its interval, by Welch's t (Biometrika 34, 1947)."""

    before: GroupMean
    after: GroupMean
    difference: float
    half_width: float


def compare(before: Floats, after: Floats, level: float = LEVEL) -> MeanChange | None:
    """The change of the mean from `before` (n) to `after` (m), its interval at `level`, the groups' own at 95 %; None
    where a group has fewer than two values."""
    if min(len(before), len(after)) < 2:
        return None
    variances = [float(np.var(group, ddof=1)) / len(group) for group in (before, after)]
    total = sum(variances)
    difference = float(np.mean(after)) - float(np.mean(before))
    squares = sum(v**2 / (len(g) - 1) for v, g in zip(variances, (before, after), strict=True))
    half_width = _t(total**2 / squares, level) * math.sqrt(total) if squares else 0.0
    return MeanChange(_group(before), _group(after), difference, half_width)


def _group(values: Floats) -> GroupMean:
    n = len(values)
    return GroupMean(n, float(np.mean(values)), _t(n - 1) * float(np.std(values, ddof=1)) / math.sqrt(n))


def _t(dof: float, level: float = LEVEL) -> float:
    return float(scipy.special.stdtrit(dof, (1 + level) / 2))
