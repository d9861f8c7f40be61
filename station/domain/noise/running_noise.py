"""What the dwells of a unit have told of its noise so far: sums, added to dwell by dwell (station.domain.noise.noise).

Means enter nowhere: of Gaussian noise they are independent of everything here, so a dwell that ends by it leaves its
mean unbiased and as variable as the same dwell of fixed length (Helmert 1876; Stein 1945, Ann. Math. Stat. 16).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.noise import dwell_statistics, noise, noise_prior
from station.domain.noise.noise_prior import MAX_LENGTH_RATIO, NoiseLikelihood, NoisePrior
from station.domain.noise.standard_error import UnitRows

#: Readings below which a dwell says nothing of noise.
MIN_READINGS = 4
#: Dwells below which nobody knows which of them is the odd one.
MIN_DWELLS = 3
#: Points of the curve of noise against the length of a dwell.
CURVE_POINTS = 10


def family_length(count: int, prior: NoisePrior | None = None) -> int:
    """The readings that noise is told by where the longest dwell so far has `count`: the next power of two, or what
    a prior is for.

    Dwells told together share it; it changes seldom, so little is told again.
    """
    if noise_prior.applies(prior, count):
        return prior.longest
    return 1 << max(int(count - 1).bit_length(), 3)


@dataclass(frozen=True, slots=True, eq=False)
class DwellNoise:
    """One dwell of units (u), as long in each. count (u) readings; square, neighbours (u, 3): see dwell.squares;
    misfit (u, 3, s), log_det (u, s), dof (u): a dwell's share in those of noise.posterior."""

    count: Floats
    square: Floats
    neighbours: Floats
    misfit: Floats
    log_det: Floats
    dof: Floats


@dataclass(frozen=True, slots=True, eq=False)
class NoiseCurve:
    """Noise density of units (u): the variance of the mean of n readings times n, `by_count` (u, 3, p), at `count` (p)
    readings; dof (u, 3, p) of it; variance_ratio (u, v, 3): of each dwell to that of the unit's usual one."""

    count: Floats
    by_count: Floats
    dof: Floats
    variance_ratio: Floats

    def apart(self) -> "list[NoiseCurve]":
        """One of each unit."""
        each = range(len(self.by_count))
        return [NoiseCurve(self.count, self.by_count[[u]], self.dof[[u]], self.variance_ratio[[u]]) for u in each]

    def at(self, count: Floats) -> tuple[Floats, Floats]:
        """n · variance (u, v, 3) of dwells of n = count (u, v) readings and its dof, straight between logarithms."""
        if len(self.count) == 1:
            one, dof = (np.broadcast_to(c[:, None, :, 0], (*count.shape, 3)) for c in (self.by_count, self.dof))
            return one, dof
        place = np.interp(np.log(np.maximum(count, 1.0)), np.log(self.count), np.arange(len(self.count)))
        before = np.minimum(place.astype(int), len(self.count) - 2)
        share = (place - before)[..., None]
        return _between(self.by_count, before, share), _between(self.dof, before, share)


def _between(curve: Floats, before: NDArray[np.intp], share: Floats) -> Floats:
    """Curves (u, 3, p) at places (u, v) on the way from one point to the next."""
    points = curve.transpose(0, 2, 1)
    low, high = (np.take_along_axis(points, at[..., None], axis=1) for at in (before, before + 1))
    return np.asarray(low * (1 - share) + high * share)


def dwell_noise(reading: Floats, longest: int) -> DwellNoise:
    """What dwells (u, n, 3) of at least MIN_READINGS readings tell; longest: see reach_of."""
    x = np.ascontiguousarray(reading.transpose(0, 2, 1))
    units, _, n = x.shape
    _, deviation, _ = dwell_statistics.deviations(x, dwell_statistics.least_step(x))
    square, neighbours = dwell_statistics.squares(deviation)
    cut = noise.cut(n, noise.step_of(longest))
    family = noise.family(cut.blocks, cut.width, noise_prior.reach(longest))
    coefficient = dwell_statistics.block_means(deviation, cut) @ family.transform.T
    return DwellNoise(
        count=np.full(units, float(n)),
        square=square,
        neighbours=neighbours,
        misfit=coefficient**2 @ family.inverse,
        log_det=np.tile(family.log_det, (units, 1)),
        dof=np.full(units, float(cut.blocks - 1)),
    )


def join_units(units: Sequence[DwellNoise]) -> DwellNoise:
    """The dwells of several units at one visit as one."""
    if len(units) == 1:
        return units[0]
    return DwellNoise(*(np.concatenate([getattr(d, f.name) for d in units]) for f in fields(DwellNoise)))


def noise_curve(dwells: Sequence[DwellNoise], longest: int, prior: NoisePrior | None = None) -> NoiseCurve:
    """What all dwells of units, told with the same `longest`, say together; longer ones are taken to go on as white.

    A prior is heard where `longest` is what it is for.
    """
    variance_ratio = _variance_ratios(dwells)
    misfit, dof, log_det = _pooled(dwells, variance_ratio)
    if prior is not None and prior.longest == longest:
        weight, variance, dof = prior.posterior(misfit, dof, log_det)
    else:
        weight, variance = noise.posterior(misfit, dof, log_det, noise_prior.general_log_weights(longest))
    count = np.unique(np.rint(np.geomspace(2, MAX_LENGTH_RATIO * longest, CURVE_POINTS)).astype(int))
    found = [noise.average_shapes(weight, variance * _mean_variance(int(n), longest), dof) for n in count]
    return NoiseCurve(
        count=count.astype(float),
        by_count=np.stack([n * v for n, (v, _) in zip(count, found, strict=True)], axis=2),
        dof=np.stack([nu for _, nu in found], axis=2),
        variance_ratio=variance_ratio,
    )


def likelihoods(dwells: Sequence[DwellNoise], longest: int) -> list[NoiseLikelihood]:
    """What all dwells of units, told with the same `longest`, say of such units' noise."""
    return noise_prior.likelihoods(*_pooled(dwells, _variance_ratios(dwells)), longest)


def _pooled(dwells: Sequence[DwellNoise], variance_ratio: Floats) -> tuple[Floats, Floats, Floats]:
    """Misfit (u, 3, s), dof (u, 1) and log_det (u, s) of usual dwells together: see noise.posterior.

    A dwell that is odd in one axis was disturbed or moved: it says nothing of the usual noise.
    """
    usual = (variance_ratio == 1).all(axis=2).astype(float)
    # Where each is odd in some axis, nobody knows which is the usual one.
    usual = np.where(usual.any(axis=1, keepdims=True), usual, 1.0)
    misfit = np.stack([d.misfit for d in dwells], axis=1)
    dof = np.maximum((usual * np.stack([d.dof for d in dwells], axis=1)).sum(axis=1, keepdims=True), 1.0)
    log_det = (usual[..., None] * np.stack([d.log_det for d in dwells], axis=1)).sum(axis=1)
    return (usual[..., None, None] * misfit).sum(axis=1), dof, log_det


def _variance_ratios(dwells: Sequence[DwellNoise]) -> Floats:
    square, neighbours = (np.stack([getattr(d, name) for d in dwells], axis=1) for name in ("square", "neighbours"))
    count = np.stack([d.count for d in dwells], axis=1).astype(np.int64)
    u, v, _ = square.shape
    if v < MIN_DWELLS:
        return np.ones((u, v, 3))
    none = np.zeros(u, np.int64)
    units = UnitRows(np.arange(u) * v, np.repeat(np.arange(u), v), step=none, reach=none, informed=none > 0)
    found = dwell_statistics.variance_ratios(square.reshape(-1, 3), neighbours.reshape(-1, 3), count.ravel(), units)
    return found.reshape(u, v, 3)


def _mean_variance(count: int, longest: int) -> Floats:
    """Variance (s) of the mean of so many readings under each shape, for readings of unit variance."""
    cut = noise.cut(count, noise.step_of(longest))
    family = noise.family(cut.blocks, cut.width, noise_prior.reach(longest))
    return np.asarray(family.mean_variance * (cut.blocks * cut.samples / count))
