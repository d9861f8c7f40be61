"""Saturation: a reading that stays at one extreme value while others show noise."""

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import (
    FaultParameter,
    GrossFault,
    block_gain,
    halves_of,
    rows_of_units,
    unit_label,
)
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Share of a stop's samples at the extreme from which it is clipped, and share at the commonest value from which
#: nothing can be said because every stop looks like that.
CLIPPED_SHARE, COMMON_SHARE = 0.3, 0.15
#: Where no step of the output is known readings are told apart to this share of their noise.
RESOLUTION_SHARE = 1e-3
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
            # Where any sample stands at the limit the mean of the stop is wrong, too.
            bad[rows] = np.asarray((share > 0).any(axis=1))[where]
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
    sentence = f"{int(bad.sum())} samples stand still at ±{next(iter(limits.values())):.4g} {recipe.unit}"
    scores = [_held_out_scores(table.reading[rows], stop[rows], limits[u], recipe.device.lsb)
              for u, rows in enumerate(rows_of_units(table.unit)) if u in limits]  # fmt: skip
    gain = block_gain(np.concatenate([s for s, _ in scores]), np.concatenate([n for _, n in scores]), "sample")
    return [GrossFault("clipping", "unit", numbers, sentence, float(bad.sum()), gain=gain)]


def _held_out_scores(reading: Floats, stop: NDArray[np.intp], limit: float, lsb: float) -> tuple[Floats, Floats]:
    """Of each stop of a unit (s): by how much likelier its samples are where the share of them that stands exactly at
    the limit is that of the other half of the clipped stops, than where all are noise; and how many samples these are,
    0 in stops that no limit touches.

    Noise puts at most lsb/(σ·√2π) of the samples on one value, σ the median spread of the stops that are not clipped.
    """
    where = stop - stop[0]
    count = np.bincount(where)
    at = np.abs(reading) >= limit * (1 - 1e-9)
    share = np.stack([np.bincount(where, a) for a in at.T], 1) / count[:, None]
    half = halves_of(len(count))
    sigma = _spread(reading, where, share == 0)
    resolution = max(lsb, RESOLUTION_SHARE * sigma)
    chance = float(np.clip(resolution / (sigma * np.sqrt(2 * np.pi)), 1e-12, 0.999))
    score, samples = np.zeros(len(count)), np.zeros(len(count))
    for part in (0, 1):
        for axis in range(3):
            fitted = share[(half != part) & (share[:, axis] > 0), axis]
            judged = (half == part) & (share[:, axis] > 0)
            if not len(fitted):
                continue
            fitted_share = float(np.clip(fitted.mean(), 0.5 / count.max(), 1 - 0.5 / count.max()))
            hits = share[judged, axis] * count[judged]
            rest = count[judged] - hits
            score[judged] += hits * np.log(fitted_share / chance) + rest * np.log((1 - fitted_share) / (1 - chance))
            samples[judged] += count[judged]
    return score, samples


def _spread(reading: Floats, where: NDArray[np.intp], fine: NDArray[np.bool_]) -> float:
    """Median over stops and axes that are fine of the standard deviation of their samples."""
    count = np.bincount(where)[:, None]
    mean, square = (np.stack([np.bincount(where, x) for x in values.T], 1) / count for values in (reading, reading**2))
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))[fine]
    return max(float(np.median(spread)) if len(spread) else 0.0, 1e-12)
