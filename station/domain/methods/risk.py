"""Risks of a decision (JCGM 106:2012): of this unit given its result, and of the process as a whole.

Before it is measured, a coefficient's deviation is what the process makes: normal, or anything where nothing is stated.
"""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.methods import coverage

#: Nodes of the integrals; their error is far below the digits that are shown.
NODES, SPAN = 48, 8.0
#: A probability this small changes no digit.
NEGLIGIBLE = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """The process before units (u) are measured: mean and standard deviation (u, c) of deviations, infinite where
    nothing is known. shared (u, c): part of the standard uncertainty that the process was learnt with, too, so that it
    cannot narrow it; 0 where the process is one of true values. error, error_std (u, c): what that shared error is, and
    what is left of its standard deviation, by what the results' mean says of it."""

    mean: Floats
    std: Floats
    shared: Floats
    error: Floats
    error_std: Floats

    def take(self, which: slice | NDArray[np.intp]) -> "Prior":
        """Of some coefficients."""
        return Prior(*(part[:, which] for part in self._parts()))

    def of_units(self, which: NDArray[np.bool_]) -> "Prior":
        """Of some units."""
        return Prior(*(part[which] for part in self._parts()))

    def _parts(self) -> tuple[Floats, ...]:
        return self.mean, self.std, self.shared, self.error, self.error_std

    @staticmethod
    def of_truths(mean: Floats, std: Floats) -> "Prior":
        """Of a process of true values."""
        nothing = np.zeros_like(mean)
        return Prior(mean, std, nothing, nothing, nothing)

    @staticmethod
    def unknown(units: int, count: int) -> "Prior":
        """Anything is as likely."""
        nothing = np.zeros((units, count))
        return Prior.of_truths(nothing, np.full_like(nothing, np.inf))


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Deviations (u, c) from nominal as measured, distribution of their errors, correlation (u, c, c), and what was
    known before."""

    deviation: Floats
    error: coverage.ErrorDistribution
    correlation: Floats
    prior: Prior

    def of_coefficient(self, c: int) -> "Measured":
        """One coefficient by itself."""
        one = slice(c, c + 1)
        parts = (self.deviation[:, one], self.error.take(slice(None), one), self.correlation[:, one, one])
        return Measured(*parts, self.prior.take(one))

    def of_units(self, which: NDArray[np.bool_]) -> "Measured":
        """Some of the units."""
        parts = (self.deviation[which], self.error.take(which), self.correlation[which])
        return Measured(*parts, self.prior.of_units(which))

    def believed(self, *, again: bool = False) -> tuple[Floats, coverage.ErrorDistribution]:
        """Mean (u, c) of the true deviation given result and process (JCGM 106, eq. 17–18), and how it lies about that;
        again: of another result, which has an error of its own, and shares the rest with this one."""
        error, prior = self.error, self.prior
        own = np.sqrt(np.maximum(error.std**2 - prior.shared**2, 0.0))
        share = 1 / (1 + (np.maximum(own, 1e-300) / prior.std) ** 2)
        mean = share * self.deviation + (1 - share) * prior.mean
        dof = np.maximum(error.dof, 1.0)
        if again:
            std = np.sqrt((1 + share) * own**2)
            return mean, coverage.ErrorDistribution.plain(np.maximum(std, 1e-300), dof)
        std = np.maximum(np.sqrt(share * own**2 + prior.error_std**2), 1e-300)
        left = coverage.ErrorDistribution(std, dof, share * error.rectangle, share * error.shift)
        return mean - prior.error, left


def beyond(measured: Measured, limit: Floats, *, again: bool = False) -> Floats:
    """Probability (u) that any true deviation is beyond its limit (u, c); again: that any result of another measurement
    is, which has the error of this one and its own."""
    mean, error = measured.believed(again=again)
    above, below = (limit - mean) / error.std, (-limit - mean) / error.std
    each = np.clip(error.tail(limit - mean) + error.tail(limit + mean), 0.0, 1.0)
    side = np.where(mean >= 0, 1.0, -1.0)
    distance = np.where(side > 0, above, -below)
    likely = each > NEGLIGIBLE
    total = np.where(likely, each, 0.0).sum(axis=1)
    for u in np.flatnonzero(likely.sum(axis=1) > 1):
        total[u] = _any(each[u], distance[u], measured.correlation[u] * side[u][:, None] * side[u])
    return np.asarray(total)


def _any(each: Floats, distance: Floats, correlation: Floats) -> float:
    """Probability of any of some events: Hunter's bound (1976, J. Appl. Prob. 13), which is exact for two.

    each (c): their probabilities; distance (c) of their bounds in standard deviations, for what pairs have in common.
    """
    order = [i for i in np.argsort(-each, kind="stable") if each[i] > NEGLIGIBLE]
    total = 0.0
    for n, i in enumerate(order):
        common = max((_both(distance[i], distance[j], correlation[i, j]) for j in order[:n]), default=0.0)
        total += max(float(each[i]) - common, 0.0)
    return min(total, 1.0)


def _both(a: float, b: float, correlation: float) -> float:
    """P(x > a and y > b) of two standard normal values: ∫ φ(x) Φ((ρx − b)/√(1 − ρ²)) dx over x > a."""
    if correlation <= 0 or not np.isfinite(a + b):
        return 0.0
    root = np.sqrt(max(1 - correlation**2, 1e-12))
    node, weight = _legendre(NODES)
    low = min(max(a, -SPAN), SPAN)
    x = low + (node + 1) / 2 * SPAN
    density = np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi)
    return float((weight * density * scipy.special.ndtr((correlation * x - b) / root)).sum() * SPAN / 2)


@cache
def _legendre(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss–Legendre, found once: they are the eigenvalues of a matrix."""
    return np.polynomial.legendre.leggauss(count)


def global_risks(
    process: tuple[float, float], uncertainty: float, limit: float, guard: float, error: float = 0.0
) -> tuple[float, float]:
    """Global consumer's and producer's risk (JCGM 106, eq. 24 and 26): that a unit of this process (mean and standard
    deviation of its deviations) is beyond ± limit and accepted, and that it is within and rejected; guard: w; error:
    mean of the error of results.
    """
    mean, std = process
    room, u = max(limit - guard, 0.0), max(uncertainty, 1e-300)
    node, weight = _legendre(2 * NODES)

    def share(low: float, high: float, *, accepted: bool) -> float:
        true = (low + high) / 2 + (high - low) / 2 * node
        density = np.exp(-(((true - mean) / std) ** 2) / 2) / (np.sqrt(2 * np.pi) * std)
        taken = scipy.special.ndtr((room - error - true) / u) - scipy.special.ndtr((-room - error - true) / u)
        return float((weight * density * (taken if accepted else 1 - taken)).sum() * (high - low) / 2)

    # Where the rule decides, the integrand is steep: the acceptance limits are edges, too.
    ends = mean - SPAN * std, mean + SPAN * std
    edges = sorted({min(max(e, ends[0]), ends[1]) for e in (*ends, -limit, limit, -room - error, room - error, -error)})
    pieces = [(low, high, abs(low + high) / 2 < limit) for low, high in pairwise(edges)]
    wrong = sum(share(low, high, accepted=True) for low, high, good in pieces if not good)
    return wrong, sum(share(low, high, accepted=False) for low, high, good in pieces if good)
