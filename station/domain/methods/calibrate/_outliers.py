"""Which visit does not fit with the others: deletion tests at a level held for the whole unit."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: Probability that a unit without any disturbance loses a visit.
LEVEL = 1e-3
#: Two visits whose residuals are correlated more than this cannot be told apart: neither is named.
MAX_CORRELATION = 0.95
#: Leverage above which the others say nothing about a visit.
FULL_LEVERAGE = 1 - 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class HatMatrix:
    """fitted = left · right · reading, left (u, a, v, k), right (u, a, k, v) for each of a readings a visit; a = 1
    where it is the same for all. The product of the two (u, a, v, v) is never made: it would grow with the square of
    the visits. Sums run in the order of k, so that a unit's bits do not depend on its neighbours."""

    left: Floats
    right: Floats

    def diagonal(self) -> Floats:
        """Leverages (u, v, a)."""
        found = sum(self.left[..., j] * self.right[..., j, :] for j in range(self.left.shape[3]))
        return np.ascontiguousarray(np.swapaxes(found, 1, 2))

    def row(self, visit: NDArray[np.intp]) -> Floats:
        """The row (u, v, a) of one visit (u) of each unit."""
        own = self.left[np.arange(len(visit)), :, visit]
        found = sum(own[..., j, None] * self.right[..., j, :] for j in range(own.shape[2]))
        return np.ascontiguousarray(np.swapaxes(found, 1, 2))


def worst_visit(residual: Floats, hat: HatMatrix, variance: Floats, keep: Floats, parameters: int) -> NDArray[np.bool_]:
    """Marks, in each unit, the visit to leave out, if any: (u, v).

    residual, variance (u, v, a) of a readings a visit; keep (u, v) 0 or 1.
    The drop in χ² when a stop is left out is measured against noise where the rest agrees with noise, against the
    rest's own scatter otherwise (externally studentised residual, Cook & Weisberg 1982, eq. 2.2.8): a rig with loose
    poses loses no visit for it.
    """
    a = residual.shape[2]
    free = 1 - hat.diagonal()
    testable = (free > 1 - FULL_LEVERAGE).all(axis=2) & (keep > 0)
    drop = (residual**2 / (variance * np.maximum(free, 1 - FULL_LEVERAGE))).sum(axis=2) * testable
    chi2 = (keep[..., None] * residual**2 / variance).sum(axis=(1, 2))
    dof = a * keep.sum(axis=1) - parameters - a
    suspect, largest = drop.argmax(axis=1), drop.max(axis=1)
    rest = np.maximum(chi2 - largest, 0.0)
    scatter = rest / np.maximum(dof, 1)
    p = np.where(
        scipy.special.chdtrc(np.maximum(dof, 1), rest) > LEVEL,
        scipy.special.chdtrc(a, largest),
        scipy.special.fdtrc(a, np.maximum(dof, 1), largest / a / np.maximum(scatter, 1e-300)),
    )
    found = (p * keep.sum(axis=1) < LEVEL) & (dof >= a)
    if found.any():
        found &= ~_ambiguous(hat, free, keep, suspect)
    return np.asarray(found[:, None] & (np.arange(drop.shape[1]) == suspect[:, None]))


def _ambiguous(hat: HatMatrix, free: Floats, keep: Floats, suspect: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether another visit's residuals would look the same (u), as those of opposite faces do: −h / √((1−h)(1−h))."""
    u = np.arange(len(suspect))
    root = np.sqrt(np.maximum(free * free[u, suspect][:, None], 1e-300))
    correlation = (np.abs(hat.row(suspect)) / root).mean(axis=2) * (keep > 0)
    correlation[u, suspect] = 0.0
    return np.asarray((correlation > MAX_CORRELATION).any(axis=1))
