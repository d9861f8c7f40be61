"""Saturation: a reading that stays at one extreme value while others show noise."""

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import FaultParameter, GrossFault, rows_of_units, unit_label
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Share of a stop's samples at the extreme from which it is clipped, and share at the commonest value from which
#: nothing can be said because every stop looks like that.
CLIPPED_SHARE, COMMON_SHARE = 0.3, 0.15
#: Samples that must be clipped.
MIN_CLIPPED_SAMPLES = 5


def clipped(table: SampleTable, stop: NDArray[np.intp]) -> tuple[dict[int, float], NDArray[np.bool_]]:
    """Limit of each clipped unit, and which samples (n) belong to a clipped stop."""
    limits: dict[int, float] = {}
    bad = np.zeros(len(table), bool)
    for u, rows in enumerate(rows_of_units(table.unit)):
        if rows.stop - rows.start < 2 * MIN_CLIPPED_SAMPLES:
            continue
        reading, where = table.reading[rows], stop[rows] - stop[rows.start]
        limit = float(np.abs(reading).max())
        at = np.abs(reading) >= limit * (1 - 1e-9)
        count = np.bincount(where)
        share = np.stack([np.bincount(where, a) for a in at.T], 1) / np.maximum(count, 1)[:, None]
        hit = (share > CLIPPED_SHARE) & (share * count[:, None] >= MIN_CLIPPED_SAMPLES)
        if hit.any() and _repeat_share(reading, where, ~hit) < COMMON_SHARE:
            limits[u] = limit
            bad[rows] = np.asarray(hit.any(axis=1))[where]
    return limits, bad


def _repeat_share(reading: Floats, where: NDArray[np.intp], fine: NDArray[np.bool_]) -> float:
    """Median over stops and axes that are not hit of the share of neighbours that read the same."""
    same = (np.diff(reading, axis=0) == 0) & (np.diff(where) == 0)[:, None]
    equal = np.stack([np.bincount(where[1:], s, len(fine)) for s in same.T], 1)
    shares = equal / np.maximum(np.bincount(where, minlength=len(fine)), 1)[:, None]
    return float(np.median(shares[fine])) if fine.any() else 1.0


def faults(recipe: Recipe, table: SampleTable, stop: NDArray[np.intp]) -> list[GrossFault]:
    """Units that saturate below their full scale."""
    limits, bad = clipped(table, stop)
    full = recipe.device.full_scale
    limits = {u: x for u, x in limits.items() if full is None or x < 0.999 * full}
    if not limits:
        return []
    std = max(recipe.device.lsb, 1e-9) / np.sqrt(12)
    numbers = tuple(
        FaultParameter("limit", None, unit_label(table.unit, u), x, std, recipe.unit) for u, x in limits.items()
    )
    told = f"{int(bad.sum())} samples stand still at ±{next(iter(limits.values())):.4g} {recipe.unit}"
    return [GrossFault("clipping", "unit", numbers, told, float(bad.sum()))]
