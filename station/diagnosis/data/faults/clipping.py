"""Saturation: readings that stay at one extreme value while others show noise."""

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import (
    FaultParameter,
    GrossFault,
    block_gain,
    rows_of_units,
    unit_label,
)
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Share of a visit's samples at the extreme from which it is clipped, and share at the commonest value from which
#: nothing can be said because every visit looks like that.
CLIPPED_SHARE, COMMON_SHARE = 0.3, 0.15
#: Up to this share, which steps of 1.45 noises make, a visit is clipped where nearly all of so many samples are at the
#: extreme: no noise puts more than half of them into one step.
COARSE_SHARE, WHOLE_SHARE, MIN_WHOLE_SAMPLES = 0.4, 0.9, 16
#: How often noise may put so many samples of any visit of a unit at an extreme.
CHANCE = 1e-3
#: Where no step of the output is known readings are told apart to this share of their noise.
RESOLUTION_SHARE = 1e-3
#: Samples that must be clipped.
MIN_CLIPPED_SAMPLES = 5
#: No limit below or above, of three axes (2, 3).
_OPEN = np.array([[-np.inf], [np.inf]]) * np.ones(3)

#: Limits (2, 3) by unit, and which samples (n) are of a clipped visit.
CutOff = tuple[dict[int, Floats], NDArray[np.bool_]]


def clipped(table: SampleTable, visit: NDArray[np.intp]) -> CutOff:
    """Lower and upper limit of each axis (2, 3) of each clipped unit, infinite where an axis shows none, and which
    samples (n) belong to a clipped visit."""
    limits: dict[int, Floats] = {}
    bad = np.zeros(len(table), bool)
    for u, rows in enumerate(rows_of_units(table.unit)):
        if rows.stop - rows.start < 2 * MIN_CLIPPED_SAMPLES:
            continue
        reading, where = table.reading[rows], visit[rows] - visit[rows.start]
        found = _limits(reading, where)
        if np.isfinite(found).any():
            limits[u] = found
            # Where any sample stands at the limit the mean of the visit is wrong, too.
            bad[rows] = np.asarray((_share(_stands(reading, found), where) > 0).any(axis=1))[where]
    return limits, bad


def _limits(reading: Floats, where: NDArray[np.intp]) -> Floats:
    """The extremes (2, 3) of each axis at which its readings stand still while they show noise elsewhere."""
    extremes = np.stack([reading.min(axis=0), reading.max(axis=0)])
    count = np.bincount(where)[:, None]
    thawed = ~_frozen(reading, where, extremes)[where][:, None]
    stands = [_stands(reading, one) & thawed for one in _one_sided(extremes)]
    if max(map(np.count_nonzero, stands)) < MIN_CLIPPED_SAMPLES:
        return _OPEN
    share = np.stack([_share(at, where) for at in stands])
    hit = (share > CLIPPED_SHARE) & (share * count >= MIN_CLIPPED_SAMPLES)
    if not hit.any():
        return _OPEN
    repeat = _repeat_share(reading, where, np.asarray(~hit.any(axis=0)))
    if np.isfinite(repeat).any():  # an axis that only ever stands at one of two ends is judged by the others
        repeat = np.where(np.isnan(repeat) & (extremes[0] < extremes[1]), np.nanmedian(repeat), repeat)
    noisy = repeat < COARSE_SHARE
    # Neighbours repeat as often as Σ p², of normal noise the commonest value's p by √2.
    commonest = np.minimum(np.sqrt(2) * np.nan_to_num(repeat), 1.0)
    hit &= scipy.special.bdtrc(share * count - 1, count, commonest) * share.size < CHANCE
    whole = (share > WHOLE_SHARE) & (share * count >= MIN_WHOLE_SAMPLES)
    found = np.where(repeat < COMMON_SHARE, hit.any(axis=1), (hit & whole).any(axis=1)) & noisy
    # What reaches a limit of the unit and seldom stands there is cut off by the same.
    size = np.abs(extremes)
    equal = np.isclose(size[..., None], size[found], rtol=1e-9, atol=0.0).any(axis=-1)
    return np.where(found | (equal & noisy), extremes, _OPEN)


def _frozen(reading: Floats, where: NDArray[np.intp], extremes: Floats) -> NDArray[np.bool_]:
    """Of each visit (s) whether all axes stand still, and not all at an end: the sensor or its link froze there, which
    no limit does to an axis that is not at one."""
    first = np.flatnonzero(np.diff(where, prepend=-1))
    still = np.logical_and.reduceat((reading == reading[first][where]).all(axis=1), first)
    at_end = (reading[first] == extremes[0]) | (reading[first] == extremes[1])
    return np.asarray(still & ~at_end.all(axis=1))


def _one_sided(limits: Floats) -> tuple[Floats, Floats]:
    """The lower limits alone, and the upper ones."""
    return np.stack([limits[0], _OPEN[1]]), np.stack([_OPEN[0], limits[1]])


def _stands(reading: Floats, limits: Floats) -> NDArray[np.bool_]:
    """Which readings (n, 3) are at a limit (2, 3)."""
    slack = 1e-9 * np.abs(limits, where=np.isfinite(limits), out=np.zeros_like(limits))
    return np.asarray((reading <= limits[0] + slack[0]) | (reading >= limits[1] - slack[1]))


def _share(at: NDArray[np.bool_], where: NDArray[np.intp]) -> Floats:
    """Of each visit and axis the share of samples (s, 3) that are `at` (n, 3)."""
    count = np.bincount(where)
    hits = [np.bincount(where[column], minlength=len(count)) for column in at.T]
    return np.asarray(np.stack(hits, axis=1) / np.maximum(count, 1)[:, None])


def _repeat_share(reading: Floats, where: NDArray[np.intp], fine: NDArray[np.bool_]) -> Floats:
    """For each axis (3) the median over visits that are `fine` (s, 3) of the share of neighbours that read the same;
    NaN where there is none."""
    same = (np.diff(reading, axis=0) == 0) & (np.diff(where) == 0)[:, None]
    equal = np.stack([np.bincount(where[1:], s, len(fine)) for s in same.T], 1)
    shares = equal / np.maximum(np.bincount(where, minlength=len(fine)), 1)[:, None]
    return np.array([np.median(s[f]) if f.any() else np.nan for s, f in zip(shares.T, fine.T, strict=True)])


def faults(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp], cut_off: CutOff) -> list[GrossFault]:
    """Units that saturate below their full scale; cut_off: what `clipped` finds of the table."""
    limits, bad = cut_off
    full = recipe.device.full_scale
    limits = {u: x for u, x in limits.items() if full is None or np.abs(x).min() < 0.999 * full}
    if not limits:
        return []
    std = max(recipe.device.lsb, 1e-9) / np.sqrt(12)
    numbers = tuple(
        FaultParameter("limit", axis, unit_label(table.unit, u), value, std, recipe.unit)
        for u, found in limits.items()
        for axis, value in _named_limits(found)
    )
    axis, value = _named_limits(next(iter(limits.values())))[0]
    where = f"at {f'{axis} = ' if axis else '±'}{value:.4g} {recipe.unit}"
    sentence = f"{int(bad.sum())} samples stand still {where}"
    scores = [_scores(table.reading[rows], visit[rows], limits[u], recipe.device.lsb)
              for u, rows in enumerate(rows_of_units(table.unit)) if u in limits]  # fmt: skip
    gain = block_gain(np.concatenate([s for s, _ in scores]), np.concatenate([n for _, n in scores]), "sample")
    return [GrossFault("clipping", "unit", numbers, sentence, float(bad.sum()), gain=gain)]


def _named_limits(limits: Floats) -> list[tuple[str | None, float]]:
    """One limit for all axes and both sides where they share it, otherwise one for each axis."""
    sizes = np.abs(limits[np.isfinite(limits)])
    if np.isfinite(limits).any(axis=0).all() and np.allclose(sizes, sizes[0], rtol=1e-9, atol=0.0):
        return [(None, float(sizes[0]))]
    return [("xyz"[i], float(limits[side, i])) for side, i in np.argwhere(np.isfinite(limits))]


def _scores(reading: Floats, visit: NDArray[np.intp], limits: Floats, lsb: float) -> tuple[Floats, Floats]:
    """Of each visit of a unit (s): by how much likelier its samples are where some share of them stands exactly at the
    limit, than where all are noise; and how many samples these are, 0 in visits that no limit touches.

    Every share is as likely beforehand, ∫ p^k (1 − p)^(n−k) dp = B(k + 1, n − k + 1): a limit cuts a visit whole that
    reaches far beyond it, and touches another with the ends of its noise. Noise puts at most lsb/(σ·√2π) of the samples
    on one value, σ the median spread of the visits that are not clipped.
    """
    where = visit - visit[0]
    count = np.bincount(where)
    share = _share(_stands(reading, limits), where)
    sigma = _spread(reading, where, share == 0)
    resolution = max(lsb, RESOLUTION_SHARE * sigma)
    chance = float(np.clip(resolution / (sigma * np.sqrt(2 * np.pi)), 1e-12, 0.999))
    hits = share * count[:, None]
    rest = count[:, None] - hits
    score = scipy.special.betaln(hits + 1, rest + 1) - hits * np.log(chance) - rest * np.log1p(-chance)
    touched = share > 0
    return np.where(touched, score, 0.0).sum(axis=1), touched.sum(axis=1) * count.astype(float)


def _spread(reading: Floats, where: NDArray[np.intp], fine: NDArray[np.bool_]) -> float:
    """Median over visits and axes that are fine of the standard deviation of their samples."""
    count = np.bincount(where)[:, None]
    mean, square = (np.stack([np.bincount(where, x) for x in values.T], 1) / count for values in (reading, reading**2))
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))[fine]
    return max(float(np.median(spread)) if len(spread) else 0.0, 1e-12)
