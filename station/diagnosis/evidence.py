"""Evidence for a cause as a random effect with its amplitude integrated out.

A cause adds Z·c to white readings r, c ~ N(0, ρ σ² I). With the normal matrix ZᵀZ = E diag(m) Eᵀ and u = EᵀZᵀr,
the log-likelihood ratio against ρ = 0 with σ profiled is (method notes, section 2)

    L(ρ) = −½ n·log(1 − Σ w u² / RSS) − ½ Σ log(1 + ρ m),      w = ρ / (1 + ρ m)

and the evidence the log of the mean of e^L over a logarithmic grid of q = ρ·mean(m). Known shared columns C that
stand beside Z are taken off exactly: for unit-wise causes their normal matrix is renewed for each ρ (Woodbury).
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from station.diagnosis.space import RANK, Space
from station.domain.types import Array, Floats

#: The grid of q. Below the first a cause cannot be seen, beyond the last the evidence no longer depends on q.
RATIOS = np.geomspace(1e-2, 1e5, 33)
#: The same for one of many groups, of few coefficients each.
COARSE = RATIOS[::2]

#: Shares of the groups that a rare cause may hit.
SHARES = (0.003, 0.02, 0.1, 0.3)

#: The largest share of the sum of squares that a cause may take up: all of it leaves nothing to measure by.
MOST = 1 - 1e-6

Pattern = Literal["own", "shared", "scan"]


@dataclass(frozen=True, slots=True, eq=False)
class Sets:
    """Any number (n) of data sets in one space: data (n, U, M); shared (n, c) their products with the border;
    rest (n) sums of squares without anything known."""

    data: Floats
    shared: Floats
    rest: Floats

    @staticmethod
    def of(space: Space, data: Floats) -> "Sets":
        """Data sets (n, U, M) that are free of the own known columns."""
        rest = np.einsum("num,num->n", data, data)
        shared = np.zeros((len(data), 0), data.dtype)
        if space.border.shape[2]:
            shared = (data.transpose(1, 0, 2) @ space.border.astype(data.dtype)).sum(0)
            rest = rest - np.einsum("nc,cd,nd->n", shared, space.inner, shared)
        return Sets(data, shared, rest)


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """What a cause can show in a space.

    own: one set of coefficients a unit; shared: one for all; scan: few of many groups are hit, nobody knows which.
    m (…, K) eigenvalues of the normal matrix, … being units or groups or nothing; cross (…, K, c) EᵀZᵀC; space: where
    it was seen; mean eigenvalue of the directions that can be seen; weight (…, K, ρ) w; logdet (…, ρ) Σ log(1 + ρ m).
    """

    pattern: Pattern
    space: Space
    m: Floats
    cross: Floats
    mean: float
    weight: Floats
    logdet: Floats

    @property
    def ratios(self) -> Floats:
        """The grid of q."""
        return COARSE if self.pattern == "scan" else RATIOS

    def light(self) -> "Spectrum":
        """The same in single precision."""
        f = np.float32
        return replace(self, weight=self.weight.astype(f), logdet=self.logdet.astype(f), cross=self.cross.astype(f))

    def components(self, products: Floats, sets: Sets) -> Floats:
        """u (n, …, K) of the products EᵀZᵀr (n, U, C)."""
        if self.pattern == "shared":
            products = products.sum(1)
        elif self.pattern == "scan":
            products = products.reshape(*products.shape[:2], *self.m.shape[1:])
        if self.pattern != "own" and self.cross.shape[-1]:
            products = products - np.einsum("...kc,cd,nd->n...k", self.cross, self.space.inner, sets.shared)
        return products

    def evidence(self, u: Floats, sets: Sets) -> Floats:
        """Log evidence (n)."""
        if self.pattern != "scan":
            return log_mean(self.likelihood(u, sets))
        odds = self.odds(u, sets).reshape(len(u), -1)
        share = np.array(SHARES)[:, None, None]
        total = np.logaddexp(np.log1p(-share), np.log(share) + odds).sum(axis=2)
        return log_mean(total.T)

    def odds(self, u: Floats, sets: Sets) -> Floats:
        """Log evidence (n, …) of each group of a scan."""
        return log_mean(self.likelihood(u, sets))

    def likelihood(self, u: Floats, sets: Sets) -> Floats:
        """L (n, …, ρ); … are the groups of a scan."""
        if self.pattern == "scan":
            drop = np.moveaxis(np.moveaxis(u**2, 0, -2) @ self.weight, -2, 0)
            return np.asarray(self._ratio(drop, sets.rest.reshape(-1, *[1] * (drop.ndim - 1))) - 0.5 * self.logdet)
        K = self.m.size
        drop = (u**2).reshape(len(u), K) @ self.weight.reshape(K, -1)
        total = self.logdet.reshape(-1, drop.shape[1]).sum(0)
        if self.pattern == "own" and self.cross.shape[-1]:
            more, bent = self._bordered(u, sets)
            drop, total = drop + more, total + bent
        return np.asarray(self._ratio(drop, sets.rest[:, None]) - 0.5 * total)

    def _ratio(self, drop: Floats, rest: Floats) -> Floats:
        """−½ n·log(1 − drop / rest)."""
        return np.asarray(-0.5 * self.space.dof * np.log1p(-np.minimum(drop / rest, MOST)))

    def _bordered(self, u: Floats, sets: Sets) -> tuple[Floats, Floats]:
        """What the known shared columns change for each ρ: the drop of the sum of squares (n, ρ) and the
        log-determinant (ρ)."""
        h = self.cross.reshape(-1, self.cross.shape[-1])
        w = self.weight.reshape(len(h), -1)
        inner = self.space.inner
        before = np.einsum("nc,cd,nd->n", sets.shared, inner, sets.shared)
        # In the basis that makes the normal matrix one, what is not estimable drops out by itself.
        values, vectors = np.linalg.eigh(inner)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        h, d = h @ root, sets.shared @ root
        A = np.eye(len(inner)) - np.einsum("kr,kc,kd->rcd", w, h, h)
        b = d[:, None, :] - np.einsum("nk,kr,kc->nrc", u.reshape(len(u), -1), w, h)
        solved = np.linalg.solve(A, b.transpose(1, 2, 0)).transpose(2, 0, 1)
        after = np.einsum("nrc,nrc->nr", b, solved)
        return after - before[:, None], np.linalg.slogdet(A)[1]


def spectrum(
    space: Space, columns: Floats, groups: int, pattern: Pattern, most: float = np.inf
) -> tuple[Spectrum, Floats]:
    """The spectrum of columns (U, M, groups · axes) as `space.see` gives them, and the columns turned to ZE.

    most: amplitudes beyond it are impossible, so what needs them cannot be this cause.
    """
    U, M, K = columns.shape
    # One set of axes a unit, one for all, or one a group.
    split = columns.reshape(U, M, groups, -1).transpose(0, 2, 3, 1) if pattern == "scan" else columns.transpose(0, 2, 1)
    normal, cross = split @ np.swapaxes(split, -1, -2), (columns.transpose(0, 2, 1) @ space.border)
    cross = cross.reshape(*normal.shape[:-1], -1)
    if pattern == "shared":
        normal, cross = normal.sum(0), cross.sum(0)
    if pattern != "own" and cross.shape[-1]:
        normal = normal - cross @ space.inner @ np.swapaxes(cross, -1, -2)
    m, E = np.linalg.eigh(normal)
    seen = m > RANK * m.max(initial=0.0)
    m, E = np.where(seen, m, 0.0), E * seen[..., None, :]
    mean = float(m[seen].mean()) if seen.any() else 0.0
    rho = np.minimum((COARSE if pattern == "scan" else RATIOS) / (mean or 1.0), most**2)
    grown = 1 + m[..., None] * rho
    found = Spectrum(pattern, space, m, np.swapaxes(E, -1, -2) @ cross, mean, rho / grown, np.log(grown).sum(-2))
    turned = (np.swapaxes(E, -1, -2) @ split).reshape(U, K, M).transpose(0, 2, 1)
    return found, np.ascontiguousarray(turned)


def log_mean(values: Array) -> Floats:
    """log of the mean of e^values over the last axis."""
    top = values.max(axis=-1, keepdims=True)
    return np.asarray(top[..., 0] + np.log(np.mean(np.exp(values - top), axis=-1)))
