"""Sizes of a cause whose covariate errs: c · (x + Σ z · mode), with standard normal numbers z of each run.

Given z the coefficients are normal, and given them z is; together they are not. Where a covariate is known to a third,
a coefficient may be half as large again and scarcely a quarter smaller: the curvature at the best one gives an interval
that is too short and too low. With z integrated out the white readings y of a unit, free of what else is known, are

    y ~ N(Σ c_a x_a, 1 + M Mᵀ),   M = Σ c_a · modes_a

(structural errors in variables with known variances: Fuller, Measurement Error Models, 1987, ch. 1), the coefficients
normal about 0 with a deviation that nobody knows. Of their few numbers mean and deviation are sums over draws from
Student's distributions, fitted to what was drawn before (Cappé, Douc, Guillin, Marin and Robert 2008).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.bank import candidate_in_view, with_covariate_error
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats

#: Draws of each unit and round, as many as all units may have, the least of each: a mean of so many is known to some
#: hundredths of its deviation. Rounds by the likeliest course alone, and rounds.
DRAWS, DRAWS_OF_ALL, LEAST_DRAWS = 512, 32_768, 128
ROUNDS_ALONE, ROUNDS = 2, 4
#: Degrees of freedom of the draws, and by how much they are wider than what was found; draws that weigh as much as what
#: was found before.
DRAW_DOF, WIDER, DRAWS_BEFORE = 4.0, 1.5, 5.0
#: Modes of a unit beyond which its coefficients are as well known as their curvature says: each run shows them anew.
MOST_MODES = 24
#: The same draws each time.
SEED = 20
#: Units looked at together: each has a matrix of its modes for each draw.
UNITS_AT_ONCE = 8


@dataclass(frozen=True, slots=True, eq=False)
class ErringCause:
    """What the likelihood of coefficients (a) needs of units (u): products of the columns [x, modes] (1 + k) of each
    axis with each other, products (u, 1 + k, 1 + k, a, a), and with the readings, along (u, 1 + k, a)."""

    products: Floats
    along: Floats

    def likelihood(self, c: Floats) -> Floats:
        """Log-likelihood (u, p) of coefficients (u, p, a), without what no coefficient changes."""
        parts = (slice(i, i + UNITS_AT_ONCE) for i in range(0, len(c), UNITS_AT_ONCE))
        return np.concatenate([self._of_units(c, some) for some in parts])

    def _of_units(self, c: Floats, some: slice) -> Floats:
        products, along, c = self.products[some], self.along[some], c[some]
        units, draws, a = c.shape
        k = along.shape[1] - 1
        both = (c[..., :, None] * c[..., None, :]).reshape(units, draws, a * a)
        flat = products.reshape(units, (k + 1) ** 2, a * a).swapaxes(1, 2)
        grown = (both @ flat).reshape(units, draws, k + 1, k + 1)
        toward = c @ along.swapaxes(1, 2)
        left = toward[..., 1:] - grown[..., 1:, 0]
        normal = grown[..., 1:, 1:] + np.eye(k)
        gained = np.sum(left * np.linalg.solve(normal, left[..., None])[..., 0], axis=-1)
        return np.asarray(-0.5 * (grown[..., 0, 0] - 2 * toward[..., 0] - gained + np.linalg.slogdet(normal)[1]))

    def curvature(self, c: Floats) -> Floats:
        """Precision (u, a, a) of the coefficients where what the covariate errs by is as c (u, a) says."""
        m_m = np.einsum("ua,ub,uklab->ukl", c, c, self.products[:, 1:, 1:]) + np.eye(self.along.shape[1] - 1)
        m_x = np.einsum("ua,ukab->ukb", c, self.products[:, 1:, 0])
        return np.asarray(self.products[:, 0, 0] - m_x.swapaxes(1, 2) @ np.linalg.solve(m_m, m_x))


def sizes_beside_error(
    bare: ScoringProblem, item: AcceptedCause, value: Floats, spread: Floats, fitted: FittedFloor
) -> tuple[Floats, Floats] | None:
    """Means and deviations (units, axes) of a cause's coefficients; None where nothing errs, or too many runs do.

    bare: all but the cause; value (units, axes): about where they are; spread (ρ): deviations that they may have.
    """
    spread = spread[np.isfinite(spread) & (spread > 0)]
    if item.candidate.of != "unit" or not item.hit.all() or not len(spread):
        return None
    modes = with_covariate_error(item.candidate, bare.view).axes // item.candidate.axes - 1
    if not 0 < modes <= MOST_MODES:
        return None
    space = bare.space(fitted.floor, moving=bare.known.moving)
    share, views = zip(*bare.view.by_likely_courses(), strict=True)
    likely = [_erring(replace(bare, view=view), space, item, value) for view in views]
    return _moments(np.log(share), likely, value, spread)


def _erring(bare: ScoringProblem, space: ResidualSpace, item: AcceptedCause, value: Floats) -> ErringCause:
    """The cause's columns and the readings of each unit as the rest leaves them."""
    plain = candidate_in_view(item.candidate, bare.view)
    white = space.project(with_covariate_error(plain, bare.view).rows(bare.view.layout))
    a = plain.axes
    signal = np.einsum("uma,ua->um", white[..., :a], value)
    # What units share is as the cause at its best leaves it.
    flat = space.shared_basis.reshape(space.data.size, -1)
    data = space.data - (flat @ (flat.T @ (space.data - signal).ravel())).reshape(space.data.shape)
    turned = white.swapaxes(1, 2)
    products = (turned @ white).reshape(len(white), -1, a, white.shape[2] // a, a).swapaxes(2, 3)
    along = (turned @ data[..., None]).reshape(len(white), -1, a)
    return ErringCause(products, along)


def _moments(prior: Floats, likely: Sequence[ErringCause], value: Floats, spread: Floats) -> tuple[Floats, Floats]:
    """Means and deviations (u, a) of coefficients near value (u, a). Their own deviation is one of spread (ρ), and the
    course of the covariate one of several, whose log prior is courses."""
    rng, best = np.random.default_rng(SEED), int(prior.argmax())
    count = max(LEAST_DRAWS, min(DRAWS, DRAWS_OF_ALL // len(value)))
    precision = likely[best].curvature(value) + np.eye(value.shape[1]) / spread.max() ** 2
    mean, cov = value, np.asarray(np.linalg.inv(precision), float)
    for turn in range(ROUNDS):
        c, density = _draws(mean, WIDER * cov, count, rng)
        some = slice(best, best + 1) if turn < ROUNDS_ALONE else slice(None)
        chance = _chances(prior[some], [cause.likelihood(c) - density for cause in likely[some]], c, spread)
        effective = 1 / np.sum(chance**2, axis=1)[:, None, None]
        mean = np.einsum("up,upa->ua", chance, c)
        off = c - mean[:, None]
        found = np.einsum("up,upa,upb->uab", chance, off, off)
        # Of few draws that weigh anything the scatter is none.
        cov = (effective * found + DRAWS_BEFORE * cov) / (effective + DRAWS_BEFORE)
    return mean, np.sqrt(np.einsum("uaa->ua", cov))


def _chances(prior: Floats, likelihoods: Sequence[Floats], c: Floats, spread: Floats) -> Floats:
    """How likely each of the draws c (u, p, a) is, by log-likelihoods (u, p) of courses that are so likely beforehand:
    a course and a deviation of the coefficients are those of all units."""
    usual = -0.5 * np.sum(c**2, axis=2)[..., None] / spread**2 - c.shape[2] * np.log(spread)
    nats, shares = [], []
    for before, found in zip(prior, likelihoods, strict=True):
        odds = found[..., None] + usual
        top = odds.max(axis=1, keepdims=True)
        share = np.exp(odds - top)
        total = share.sum(axis=1, keepdims=True)
        shares.append(share / total)
        nats.append(before + (top + np.log(total)).sum((0, 1)))
    joint = np.exp(np.array(nats) - np.max(nats))
    return np.asarray(sum(share @ w for share, w in zip(shares, joint / joint.sum(), strict=True)))


def _draws(mean: Floats, cov: Floats, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draws (u, count, a) of Student's distribution about mean (u, a), and the logarithm (u, count) of its density."""
    units, a = mean.shape
    values, vectors = np.linalg.eigh(cov)
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values.max(axis=1, keepdims=True)))[:, None]
    normal = rng.standard_normal((units, count, a))
    wide = np.sqrt(DRAW_DOF / rng.chisquare(DRAW_DOF, (units, count)))
    t = normal * wide[..., None]
    density = -0.5 * (DRAW_DOF + a) * np.log1p(np.sum(t**2, axis=2) / DRAW_DOF)
    return mean[:, None] + t @ root.swapaxes(1, 2), density
