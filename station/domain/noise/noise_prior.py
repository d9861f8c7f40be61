"""What the noise of a kind of unit is like, learnt from units measured before, and what it tells of the next one.

A unit tells little of its own noise while its first dwells last; those before it have told what shapes such units'
noise has and how much their levels differ: empirical Bayes. The weights of the shapes go some steps of EM from the
general prior towards those that the units make likeliest (Laird 1978, J. Am. Stat. Assoc. 73), the more steps the
more units: going all the way would take the chance of few units for their kind. The logarithms of the three axes'
variances are normal over units, with mean and covariance by moments: a spread population tells little, a homogeneous
one much, and where the axes of a unit go together each tells of the others. For a unit far off the spread is wider
(Student's t: the covariance comes from so many units), so that its own readings decide.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
import scipy

from station.domain.core.types import Floats
from station.domain.noise import noise

#: Shapes of noise reach so many times as far as the longest dwell: what is slower than a short first dwell is not
#: seen in it, and must not be taken for nothing.
REACH_FACTOR = 2
#: A prior holds for dwells so many times as long as those that its shapes are for.
MAX_LENGTH_RATIO = 4
#: Units learnt from; steps of EM at most, and for how many units there is one more.
MAX_UNITS, STEPS, UNITS_A_STEP = 50, 8, 6
#: The ln variance of readings that are all alike, which say nothing of noise.
SILENT_LOG_VARIANCE = -600.0
#: The general weights of the shapes count as so many axes of units.
GENERAL_AXES = 2.0
#: Before units tell, a unit's ln variance is taken to differ from the usual by SPREAD and its axes by OWN; this
#: counts as so many units.
UNIT_SPREAD, AXIS_SPREAD, GENERAL_UNITS = 0.5, 0.2, 3.0


@dataclass(frozen=True, slots=True, eq=False)
class NoiseLikelihood:
    """What one unit has told under each shape (s) of the family for dwells of up to `longest` readings.

    log_likelihood, log_variance (3, s): of its readings, and of a step as they say; dof: of that variance.
    """

    longest: int
    log_likelihood: Floats
    log_variance: Floats
    dof: float


@dataclass(frozen=True, slots=True, eq=False)
class NoisePrior:
    """What `units` units have told of the next one. longest: see Seen; log_weight (s) of the shapes; mean (3),
    covariance (3, 3) of the logarithms of the axes' variances of a step, over units."""

    longest: int
    units: int
    log_weight: Floats
    mean: Floats
    covariance: Floats

    @property
    def step(self) -> int:
        """Samples in a step of the family."""
        return noise.step_of(self.longest)

    @property
    def reach(self) -> int:
        """The reach of the family, in steps."""
        return reach(self.longest)

    def posterior(self, misfit: Floats, dof: Floats, log_det: Floats) -> tuple[Floats, Floats, Floats]:
        """As noise.posterior, of units of this kind, and the dof (u, 3) of the variance: the unit's own (u, 1) and
        those that the prior is worth."""
        own = log_variance_moments(*noise.posterior(misfit, dof, log_det, self.log_weight), dof)
        expected, worth = self._expected_variance(*own)
        total = dof + worth
        return *noise.posterior(misfit + (worth * expected)[..., None], total, log_det, self.log_weight), total

    def _expected_variance(self, mean: Floats, spread: Floats) -> tuple[Floats, Floats]:
        """Variance (u, 3) that earlier units and the other axes let expect of each axis, and its dof (u, 3).

        mean, spread (u, 3): ln variance as each axis' own readings tell it, and the variance of that.
        """
        off, covariance = mean - self.mean, self._scaled_covariance(mean - self.mean, spread)
        expected, wide = np.empty_like(mean), np.empty_like(mean)
        for axis in range(3):
            others = [k for k in range(3) if k != axis]
            with_axis = covariance[:, others, axis]
            among = covariance[:, others][:, :, others] + spread[:, others, None] * np.eye(2)
            gain = np.linalg.solve(among, with_axis[..., None])[..., 0]
            expected[:, axis] = self.mean[axis] + (gain * off[:, others]).sum(axis=1)
            wide[:, axis] = covariance[:, axis, axis] - (gain * with_axis).sum(axis=1)
        dof = 1 + 2 / np.maximum(wide, 1e-6)
        return np.exp(expected - _log_bias(dof)), dof

    def _scaled_covariance(self, off: Floats, spread: Floats) -> Floats:
        """The covariance (u, 3, 3) for units that are so far off (u, 3): their scale in a multivariate t (Lange, Little
        & Taylor 1989, J. Am. Stat. Assoc. 84, eq. 3)."""
        square = off[:, None] @ np.linalg.solve(self.covariance + spread[..., None] * np.eye(3), off[..., None])
        return np.asarray((self.units + square) / (self.units + 3) * self.covariance)


def applies(prior: NoisePrior | None, count: int) -> TypeGuard[NoisePrior]:
    """Whether there is a prior, and for a unit whose longest dwell has `count` readings."""
    return prior is not None and count <= MAX_LENGTH_RATIO * prior.longest


def reach(longest: int) -> int:
    """How far shapes of noise reach, in steps, for dwells of up to so many readings."""
    return REACH_FACTOR * noise.reach_of(longest)


def general_log_weights(longest: int) -> Floats:
    """Logarithms (s) of the weights of the shapes before any unit has been seen."""
    return noise.family(2, 1, reach(longest)).log_prior


def log_variance_moments(weight: Floats, variance: Floats, dof: Floats) -> tuple[Floats, Floats]:
    """Mean and variance (u, 3) of ln variance: over shapes of weight and variance (u, 3, s), each known with dof
    (u, 1)."""
    log = np.log(np.maximum(variance, 1e-300)) + _log_bias(dof)[..., None]
    mean = (weight * log).sum(axis=-1)
    return mean, (weight * (log - mean[..., None]) ** 2).sum(axis=-1) + 2 / dof


def likelihoods(misfit: Floats, dof: Floats, log_det: Floats, longest: int) -> list[NoiseLikelihood]:
    """What units (u) have told; dof (u, 1), and see noise.posterior."""
    log = np.log(np.maximum(misfit / dof[..., None], 1e-300))
    likelihood = -0.5 * (dof[..., None] * log + log_det[:, None, :])
    likelihood -= likelihood.max(axis=-1, keepdims=True)
    return [NoiseLikelihood(longest, a, b, float(n)) for a, b, n in zip(likelihood, log, dof[:, 0], strict=True)]


def learn_prior(units: Sequence[NoiseLikelihood], longest: int) -> NoisePrior | None:
    """What those of the newest units (the last) that were told with this `longest` say of the next; None without any.

    Its numbers are round, so that a record can keep them all.
    """
    usable = [u for u in units if u.longest == longest and (u.log_variance > SILENT_LOG_VARIANCE).all()][-MAX_UNITS:]
    if not usable:
        return None
    likelihood = np.exp(np.stack([u.log_likelihood for u in usable]))
    share = start = np.exp(general_log_weights(longest))
    for _ in range(min(STEPS, 1 + len(usable) // UNITS_A_STEP)):
        of_unit = _normed(likelihood * share)
        share = (GENERAL_AXES * start + of_unit.sum(axis=(0, 1))) / (GENERAL_AXES + 3 * len(usable))
    variance = np.exp(np.stack([u.log_variance for u in usable]))
    mean, spread = log_variance_moments(_normed(likelihood * share), variance, np.array([[u.dof] for u in usable]))
    covariance = _covariance(mean, spread)
    return NoisePrior(longest, len(usable), np.log(share).round(3), mean.mean(axis=0).round(5), covariance.round(7))


def _covariance(mean: Floats, spread: Floats) -> Floats:
    """Covariance (3, 3) of the next unit's levels, from those of units (u, 3), each known to `spread` (u, 3)."""
    off = mean - mean.mean(axis=0)
    value, vector = np.linalg.eigh(off.T @ off - np.diag(spread.sum(axis=0)))
    scatter = (vector * np.maximum(value, 0.0)) @ vector.T
    before, count = GENERAL_UNITS * (UNIT_SPREAD**2 + AXIS_SPREAD**2 * np.eye(3)), len(mean)
    return np.asarray((scatter + before) / (count - 1 + GENERAL_UNITS) * (1 + 1 / count))


def _log_bias(dof: Floats) -> Floats:
    """Mean of ln σ² over ln s² where σ² = ν s² / χ²_ν: ln(ν/2) − ψ(ν/2)."""
    return np.asarray(np.log(dof / 2) - scipy.special.digamma(dof / 2))


def _normed(weight: Floats) -> Floats:
    return np.asarray(weight / weight.sum(axis=-1, keepdims=True))
