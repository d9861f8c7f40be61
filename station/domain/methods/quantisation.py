"""What rounding by the converter does to the coefficients, beyond what averaging takes away.

The rounding errors of two readings of one code are one error where the readings are alike, and have nothing to do with
each other where they lie anywhere in that step by chance. The cross-axis gains that a unit was found to have say how
far apart they lie.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.methods import coefficients, contributions
from station.domain.methods.method import Fit, FitProblem
from station.domain.recipe.recipe import Recipe

#: Rounding below this share of the noise of a mean is the same whether equal codes are counted or not.
NEGLIGIBLE = 0.02
#: A mean whose rounding has kept this share of its variance is hardly dithered: its error is a rectangle.
UNDITHERED = 0.5
#: Equal codes whose readings lie far apart may still be alike by chance: the mean of "shared" and "apart" is the least.
BY_CHANCE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Rounding:
    """Covariance (u, 12, 12) of the coefficients, and half-width (u, 12) of the rectangle that is part of their error:
    it has the fourth cumulant of all the rectangles that add up."""

    covariance: Floats
    rectangle: Floats


def quantisation(recipe: Recipe, problem: FitProblem, fit: Fit) -> Rounding:
    """From rounding that no averaging takes away: independent where codes differ, partly one error where they are
    equal (`correlation`)."""
    found = contributions.noise(fit, contributions.diagonal(problem.quantisation))
    rectangle = np.zeros(found.shape[:2])
    of_noise = np.einsum("uvii->uvi", problem.cov) - problem.quantisation
    coarse = (problem.quantisation > NEGLIGIBLE * of_noise).any(axis=(1, 2)) & problem.quantisation.any((1, 2))
    for u in np.flatnonzero(coarse).tolist():
        alone = np.diagonal(found[u])
        variance, fourth = _of_unit(recipe.device.lsb, problem, fit, u, np.maximum(alone, 0.0))
        # Half-width a: variance a²/3, fourth cumulant −2a⁴/15; of readings each has its own −2a⁴/15.
        rectangle[u] = np.minimum(fourth**0.25, np.sqrt(3 * alone))
        found[u] = found[u] + np.diag(np.maximum(variance - alone, 0.0))
    return Rounding(found, rectangle)


def _of_unit(lsb: float, problem: FitProblem, fit: Fit, u: int, alone: Floats) -> tuple[Floats, Floats]:
    """Variances (12) of one unit, and the sum (12) of the fourth powers of half-widths."""
    total, fourth = np.zeros(12), np.zeros(12)
    cross = _cross_variance(fit, u, alone)
    for i in range(problem.axes):
        variance = problem.quantisation[u, :, i]
        step = np.sqrt(12 * variance.max())
        if step == 0:
            continue
        each = fit.jacobian[u, :, :, i] * np.sqrt(variance)
        undithered = lsb > 0 and variance.min() >= UNDITHERED * max(step, lsb) ** 2 / 12
        code = np.round(problem.mean[u, :, i] / step)
        for own in (np.flatnonzero(code == c) for c in np.unique(code)):
            apart, shared = (each[:, own] ** 2).sum(axis=1), each[:, own].sum(axis=1) ** 2
            shared_rounding = correlation(_spread(problem, fit, u, i, own, cross) / step) if len(own) > 1 else 0.0
            weight = (BY_CHANCE + (1 - BY_CHANCE) * shared_rounding) * (shared > apart)
            total += apart + weight * (shared - apart)
            if undithered:
                fourth += 9 * ((1 - weight) * (each[:, own] ** 4).sum(axis=1) + weight * shared**2)
    return total, fourth


def _cross_variance(fit: Fit, u: int, variance: Floats) -> float:
    """Mean square of the cross-axis gains that were found, less what rounding makes of it; 0 where the method takes
    them for granted, so that readings count as alike."""
    if not fit.free[coefficients.CROSS].all():
        return 0.0
    square = fit.theta[u, coefficients.CROSS] ** 2 - variance[coefficients.CROSS]
    return max(float(square.mean()), 0.0)


def _spread(problem: FitProblem, fit: Fit, u: int, axis: int, visits: NDArray[np.intp], cross: float) -> float:
    """Standard deviation of the true readings of some visits on an axis, as the coefficients have it."""
    if not problem.pose_known:
        return 0.0
    of_truth = problem.true[u, visits].var(axis=0)
    gains = np.full(3, cross)
    gains[axis] = coefficients.matrix_of(fit.theta)[u, axis, axis] ** 2
    return float(np.sqrt(of_truth @ gains))


def correlation(spread: float) -> float:
    """Of the rounding errors of two readings of one code, where readings have that standard deviation, in steps.

    Their difference d has a density that goes with (1 − |d|)·exp(−d²/4s²), and given d their sum is anywhere within
    ± (1 − |d|): 1 without a spread, 0 where it is far above the step.
    """
    return float(np.interp(spread, *_correlations()))


@lru_cache(maxsize=1)
def _correlations() -> tuple[Floats, Floats]:
    spread = np.r_[0.0, np.geomspace(0.02, 20, 300)]
    d = np.linspace(0, 1, 2001)
    weight = (1 - d) * np.exp(-((d / (2 * np.maximum(spread, 1e-6)[:, None])) ** 2))
    weight = weight / weight.sum(axis=1, keepdims=True)
    of_sum, of_difference = weight @ (1 - d) ** 2 / 3, weight @ d**2
    return spread, (of_sum - of_difference) / (of_sum + of_difference)
