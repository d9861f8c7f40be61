"""Evidence for a cause as a random effect with its amplitude integrated out.

A cause adds Z·c to white readings r, c ~ N(0, ρ σ² I). With the normal matrix ZᵀZ = E diag(m) Eᵀ and u = EᵀZᵀr,
the log-likelihood ratio against ρ = 0 with σ profiled is

    L(ρ) = −½ n·log(1 − Σ w u² / RSS) − ½ Σ log(1 + ρ m),      w = ρ / (1 + ρ m)

and the evidence the log of the mean of e^L over a logarithmic grid of q = ρ·mean(m). Known shared columns C that
stand beside Z are taken off exactly: for unit-wise causes their normal matrix is renewed for each ρ (Woodbury).
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.linear.eigen import eigenvectors
from station.diagnosis.linear.projection import RANK_TOLERANCE, ResidualSpace, SpaceSize
from station.domain.core.types import Array, Floats

#: The grid of q. Below the first a cause cannot be seen, beyond the last the evidence no longer depends on q.
AMPLITUDE_RATIOS = np.geomspace(1e-2, 1e8, 41)
#: The same for one of many groups, of few coefficients each.
COARSE_RATIOS = AMPLITUDE_RATIOS[::2]

#: Shares of the groups that a rare cause may hit.
HIT_SHARES = (0.003, 0.02, 0.1, 0.3)

#: Groups of a unit of which one at most is taken for hit: its offset being free, of two runs the one is off by as much
#: as the other is not, and to count both would count the same twice; of three each shows a quarter of another.
FEW_GROUPS = 3

#: The largest share of the sum of squares that a cause may take up: all of it leaves nothing to measure by.
MAX_EXPLAINED_SHARE, MAX_EXPLAINED_SHARE_SINGLE = 1 - 1e-9, 1 - 1e-6

Pattern = Literal["own", "shared", "scan"]
#: A normal matrix of all units together is turned to its axes where it is at most so many times as wide as there are
#: known columns: beyond, it takes longer than as many matrices of those as there are amplitudes.
WIDEST_TOGETHER = 4
#: How coefficients are grouped: by unit; not at all; by unit and group of the unit.
GROUP_AXES = {"own": 1, "shared": 0, "scan": 2}


@dataclass(frozen=True, slots=True, eq=False)
class DataSets:
    """Any number (n) of data sets in one space of a size: squares (n) their sums of squares without the own known
    columns; shared (n, c) their products with the border."""

    size: SpaceSize
    squares: Floats
    shared: Floats

    @staticmethod
    def of(space: ResidualSpace, data: Floats) -> "DataSets":
        """Data sets (n, U, M) that are free of the own known columns."""
        shared = np.zeros((len(data), 0), data.dtype)
        if space.shared_basis.shape[2]:
            shared = (data.transpose(1, 0, 2) @ space.shared_basis.astype(data.dtype)).sum(0)
        return DataSets(space.size, np.einsum("num,num->n", data, data), shared)

    def times(self, factor: float) -> "DataSets":
        """White readings that are so many times as long, as all noise is so many times smaller."""
        size = self.size._replace(logdet=self.size.logdet - 2 * self.size.dof * float(np.log(factor)))
        return DataSets(size, factor**2 * self.squares, factor * self.shared)

    def sum_over_copies(self, orders: Array | None) -> "DataSets":
        """The sets of several copies of the units, each copy in its own order (copies, n)."""
        if orders is None:
            return self
        squares, shared = (np.asarray(sum(x[order] for order in orders)) for x in (self.squares, self.shared))
        return DataSets(self.size, squares, shared)

    @property
    def rest(self) -> Floats:
        """Sums of squares (n) without anything known."""
        if not self.shared.shape[1]:
            return self.squares
        return np.asarray(self.squares - np.sum(self.shared**2, axis=1))

    @property
    def fits(self) -> Floats:
        """Log-likelihood (n) without any candidate, the floor's scale at its best."""
        return np.asarray(-0.5 * (self.size.logdet + self.size.dof * np.log(self.rest)))


@dataclass(frozen=True, slots=True, eq=False)
class EigenSpectrum:
    """What a cause, or several of one shape (b, maybe none), can show in a space.

    own: one set of coefficients a unit; shared: one for all; scan: few of many groups are hit, nobody knows which.
    m (b, …, K) eigenvalues of the normal matrix, … being units or units and groups or nothing; cross (b, …, K, c)
    EᵀZᵀC; size: of the space where it was seen; mean (b) eigenvalue of the directions that can be seen; rho (b, ρ) the
    amplitudes tried; known_logdet (b, …, ρ) Σ log(1 + ρ m), over all units where … are units, None where not kept, as
    those of a scan are.
    """

    pattern: Pattern
    size: SpaceSize
    m: Floats
    cross: Floats
    mean: Floats
    rho: Floats
    known_logdet: Floats | None

    def of(self, i: int | slice | NDArray[np.intp]) -> "EigenSpectrum":
        """One of several causes, or some of them."""
        m, cross, mean, rho = (x[i] for x in (self.m, self.cross, self.mean, self.rho))
        logdet = None if self.known_logdet is None else self.known_logdet[i]
        return EigenSpectrum(self.pattern, self.size, m, cross, mean, rho, logdet)

    def of_units(self, units: slice) -> "EigenSpectrum":
        """Several scans in some of the units."""
        return replace(self, m=self.m[:, units], cross=self.cross[:, units])

    @property
    def batch_axes(self) -> int:
        """Axes of b: 0 or 1."""
        return self.m.ndim - 1 - GROUP_AXES[self.pattern]

    @property
    def ratios(self) -> Floats:
        """The grid of q."""
        return COARSE_RATIOS if self.pattern == "scan" else AMPLITUDE_RATIOS

    @property
    def logdet(self) -> Floats:
        """Σ log(1 + ρ m) (b, …, ρ)."""
        return _logdet(self.pattern, self.size, self.m, self.rho) if self.known_logdet is None else self.known_logdet

    @property
    def weight(self) -> Floats:
        """w (b, …, K, ρ)."""
        rho = _expand_axes(self.rho, GROUP_AXES[self.pattern] + 1)
        return np.asarray(rho / (1 + self.m[..., None] * rho))

    def single_precision(self) -> "EigenSpectrum":
        """The same in single precision."""
        single: list[Array] = [x.astype(np.float32) for x in (self.m, self.cross, self.rho, self.logdet)]
        return replace(self, m=single[0], cross=single[1], rho=single[2], known_logdet=single[3])

    def of_readings(self) -> "EigenSpectrum":
        """The same without what only the evidence of new data sets needs."""
        return replace(self, cross=self.cross[..., :0].copy())

    def components(self, products: Floats, sets: DataSets) -> Floats:
        """u (b, n, …, K) of the products EᵀZᵀr: (b, n, K) of a shared cause, (b, n, U, …) of the others."""
        b = self.batch_axes
        products = products.reshape(*products.shape[: b + 1], *self.m.shape[b:])
        if self.pattern == "own" or not self.cross.shape[-1]:
            return products
        return np.asarray(products - np.moveaxis(self.cross @ sets.shared.T, -1, b))

    def likelihood_of(self, u: Floats, sets: DataSets) -> Floats:
        """L (b, n, ρ) of u; not of a scan."""
        *_, units, each, known = 1, *self.cross.shape
        alone = self.pattern != "own" or self.size.copies > 1
        if alone or units * each > WIDEST_TOGETHER * known:
            return self.likelihood(self.terms(u, sets), sets)
        together = self._flat(self.cross)
        normal = -together @ together.swapaxes(-1, -2)
        at = np.arange(normal.shape[-1])
        normal[..., at, at] += self.m.reshape(*normal.shape[:-1])
        m, E = eigenvectors(normal)
        # What the known columns take up leaves rounding, which explains nothing.
        m = np.where(m > RANK_TOLERANCE * self.m.max(axis=(-1, -2), initial=0.0)[..., None], m, 0.0)
        left = u.reshape(*u.shape[:-2], -1) - sets.shared @ together.swapaxes(-1, -2)
        along = np.where(m[..., None, :] > 0, left @ E, 0.0)
        amplified = m[..., None] * self.rho[..., None, :]
        weight, logdet = self.rho[..., None, :] / (1 + amplified), np.log1p(amplified).sum(-2)
        return np.asarray(self._ratio(along**2 @ weight, sets.rest[:, None]) - 0.5 * logdet[..., None, :])

    def evidence(self, u: Floats, sets: DataSets) -> Floats:
        """Log evidence (b, n)."""
        return self.judged(self.terms(u, sets), sets)

    def terms(self, u: Floats, sets: DataSets) -> Floats:
        """What adds up over units (b, n, …), and all that the evidence needs of u."""
        if self.pattern == "shared":
            return u
        if self.pattern == "own":
            flat, weight = u.reshape(*u.shape[:-2], -1), self._flat(self.weight)
            drop = flat**2 @ weight
            if not self.cross.shape[-1]:
                return np.asarray(drop[..., None])
            bent = (flat[..., None, :] * weight.swapaxes(-1, -2)[..., None, :, :]) @ self._flat(self.cross)[
                ..., None, :, :
            ]
            return np.concatenate([drop[..., None], bent], axis=-1)
        return self.spread(np.moveaxis(_log_mean_exp_in_place(self._by_group(u, sets)), -1, self.batch_axes))

    @staticmethod
    def spread(odds: Floats) -> Floats:
        """Log-likelihood (b, n, shares) of a scan whose groups have such log odds (b, n, U, G), if such a share of them
        is hit; of a few groups of a unit one at most."""
        share = np.array(HIT_SHARES, odds.dtype).reshape(-1, *[1] * odds.ndim)
        if 1 < odds.shape[-1] <= FEW_GROUPS:
            # Odds of a hit to none, of each group, and the chance that none or one is hit.
            hit = (share / (1 - share))[..., 0]
            found = np.logaddexp(0.0, np.log(hit) + np.logaddexp.reduce(odds, axis=-1)) - np.log1p(odds.shape[-1] * hit)
        else:
            found = np.logaddexp(np.log1p(-share), np.log(share) + odds).sum(axis=-1)
        return np.asarray(np.moveaxis(found.sum(axis=-1), 0, -1))

    def judged(self, terms: Floats, sets: DataSets) -> Floats:
        """Log evidence (b, n) of the terms."""
        return log_mean_exp(terms if self.pattern == "scan" else self.likelihood(terms, sets))

    def likelihood(self, terms: Floats, sets: DataSets) -> Floats:
        """L (b, n, ρ) of the terms; not of a scan."""
        rest, logdet = sets.rest[:, None], self.logdet[..., None, :]
        if self.pattern == "shared":
            return np.asarray(self._ratio(terms**2 @ self.weight, rest) - 0.5 * logdet)
        drop, total = terms[..., 0], logdet
        if self.cross.shape[-1]:
            more, bent = self._bordered(terms[..., 1:], sets)
            drop, total = drop + more, total + bent[..., None, :]
        return np.asarray(self._ratio(drop, rest) - 0.5 * total)

    def likelihoods(self, u: Floats, sets: DataSets) -> Floats:
        """L (b, n, U, G, ρ) of each group of a scan."""
        return np.moveaxis(self._by_group(u, sets), -2, self.batch_axes)

    def _by_group(self, u: Floats, sets: DataSets) -> Floats:
        """The same as (b, U, G, n, ρ). A copy of the units has its share of the sum of squares."""
        drop = np.moveaxis(u**2, self.batch_axes, -2) @ self.weight
        found = self._ratio(drop, (self.size.copies * sets.rest).astype(drop.dtype)[:, None])
        found -= 0.5 * self.logdet[..., None, :]
        return found

    def _flat(self, values: Floats) -> Floats:
        """Units and axes (b, U, K, x) in one row (b, U·K, x)."""
        return values.reshape(*values.shape[: self.batch_axes], -1, values.shape[-1])

    def _ratio(self, drop: Floats, rest: Floats) -> Floats:
        """−½ n·log(1 − drop / rest)."""
        share = np.asarray(drop / -rest)
        most = MAX_EXPLAINED_SHARE_SINGLE if share.dtype == np.float32 else MAX_EXPLAINED_SHARE
        np.log1p(np.maximum(share, -most, out=share), out=share)
        share *= -0.5 * self.size.dof
        return share

    def _bordered(self, bent: Floats, sets: DataSets) -> tuple[Floats, Floats]:
        """What the known shared columns change for each ρ: the drop of the sum of squares (b, n, ρ) and the
        log-determinant (b, ρ). bent (b, n, ρ, c): Σ w u h over the units.

        bᵀA⁻¹b and log|A|, A = I − Σ w h hᵀ, the latter on whichever side is the smaller (Woodbury).
        """
        h, weight = self._flat(self.cross), self._flat(self.weight).swapaxes(-1, -2)
        root = np.sqrt(self.size.copies * weight)
        b = np.moveaxis(sets.shared[:, None, :] - bent, -3, -1)
        wide = root[..., None] * h[..., None, :, :]
        if h.shape[-2] < h.shape[-1]:
            inner = (h @ h.swapaxes(-1, -2))[..., None, :, :]
            A = np.eye(h.shape[-2]) - root[..., None] * inner * root[..., None, :]
            c = wide @ b
            after = np.sum(b**2, axis=-2) + np.sum(c * np.linalg.solve(A, c), axis=-2)
        else:
            A = np.eye(h.shape[-1]) - wide.swapaxes(-1, -2) @ wide
            after = np.sum(b * np.linalg.solve(A, b), axis=-2)
        return after.swapaxes(-1, -2) - np.sum(sets.shared**2, axis=1)[:, None], np.linalg.slogdet(A)[1]


def _expand_axes(values: Floats, axes: int) -> Floats:
    """Values (…, x) with so many axes of 1 before the last."""
    return values.reshape(*values.shape[:-1], *[1] * axes, values.shape[-1])


def spectrum(
    size: SpaceSize, m: Floats, cross: Floats, pattern: Pattern, most: Floats | float = np.inf
) -> EigenSpectrum:
    """The spectrum of eigenvalues m (b, …, K), with EᵀZᵀC (b, …, K, c).

    most (b): amplitudes beyond it are impossible, so what needs them cannot be this cause.
    """
    grouped = GROUP_AXES[pattern]
    axes = tuple(range(-1 - grouped, 0))
    count = np.count_nonzero(m > 0, axis=axes)
    mean = np.asarray(m.sum(axis=axes) / np.maximum(count, 1))
    ratios = COARSE_RATIOS if pattern == "scan" else AMPLITUDE_RATIOS
    limit = np.asarray(most, float)[..., None] ** 2
    rho = np.minimum(ratios / np.where(mean > 0, mean, 1.0)[..., None], limit)
    # Those of a scan are as many as its groups, and not kept.
    logdet = None if pattern == "scan" else _logdet(pattern, size, m, rho)
    return EigenSpectrum(pattern, size, m, cross, mean, rho, logdet)


def _logdet(pattern: Pattern, size: SpaceSize, m: Floats, rho: Floats) -> Floats:
    """Σ log(1 + ρ m) (b, …, ρ)."""
    logdet = np.log1p(m[..., None] * _expand_axes(rho, GROUP_AXES[pattern] + 1)).sum(-2)
    return np.asarray(size.copies * logdet.sum(-2) if pattern == "own" else logdet)


def visible_directions(m: Floats, grouped: int = 1) -> NDArray[np.bool_]:
    """Which eigenvalues (b, …, K), … being `grouped` axes, are of directions that can be seen: not of those that are
    lost in what is known."""
    return np.asarray(m > RANK_TOLERANCE * m.max(axis=tuple(range(-1 - grouped, 0)), keepdims=True, initial=0.0))


def log_mean_exp(values: Array) -> Floats:
    """log of the mean of e^values over the last axis."""
    return _log_mean_exp_in_place(values.copy())


def _log_mean_exp_in_place(values: Array) -> Floats:
    """The same; the values are lost."""
    top = values.max(axis=-1, keepdims=True)
    values -= top
    return np.asarray(top[..., 0] + np.log(np.mean(np.exp(values, out=values), axis=-1)))
