"""The data as the noise floor sees them: whitened, and free of everything that is fitted anyway.

Known parameters stand beside the causes under test: `own` columns, one set a unit (its calibration), and `shared`
ones, common to all units (causes already accepted). Both are projected out, so a cause under test keeps only what
no calibration can take up. A known parameter may carry a prior: a row saying "0 ± std" is added to the data.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.domain.types import Floats


class Rows(NamedTuple):
    """Columns as the data have them: stop (U, R, m, c); dwell (U, w, c) the contrasts within the stops, in units of
    their noise, or None where they are all zero."""

    stop: Floats
    dwell: Floats | None = None

    @staticmethod
    def beside(parts: "Sequence[Rows]") -> "Rows":
        """All columns side by side; there must be at least one part."""
        moving = [p.dwell for p in parts if p.dwell is not None]
        stop = np.concatenate([p.stop for p in parts], axis=-1)
        if not moving:
            return Rows(stop)
        still = (*moving[0].shape[:2],)
        dwell = [np.zeros((*still, p.stop.shape[-1])) if p.dwell is None else p.dwell for p in parts]
        return Rows(stop, np.concatenate(dwell, axis=-1))


#: A column that keeps less than this share of its length is taken for a combination of the others.
RANK = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """own (p) and shared (c) columns with their priors: precision (U, p), (c), 0 for none, about target (U, p), (c)."""

    own: Rows
    own_precision: Floats
    own_target: Floats
    shared: Rows
    shared_precision: Floats
    shared_target: Floats

    @property
    def moving(self) -> bool:
        """Whether anything known changes within a stop."""
        return self.own.dwell is not None or self.shared.dwell is not None

    @property
    def priors(self) -> int:
        """How many coefficients have a prior."""
        return int(np.count_nonzero(self.own_precision) + np.count_nonzero(self.shared_precision))


@dataclass(frozen=True, slots=True, eq=False)
class Covariance:
    """Inverse Cholesky factors (classes, m, m) of the floor, the class of each unit's run (U, R), which rows are
    measured (U, R·m), log-determinant."""

    inverse: Floats
    member: NDArray[np.intp]
    live: NDArray[np.bool_]
    logdet: float

    def whiten(self, rows: Rows, dwell: int) -> Floats:
        """Rows of unit variance (U, R·m + dwell, c); `dwell` is how many contrasts a unit shall keep."""
        U, R, m, c = rows.stop.shape
        stop = (self.inverse[self.member] @ rows.stop).reshape(U, R * m, c)
        if not dwell:
            return np.asarray(stop)
        moving = np.zeros((U, dwell, c)) if rows.dwell is None else rows.dwell
        return np.concatenate([stop, moving], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """White rows of each unit (stops, contrasts, priors), free of the unit's own known columns.

    dwell: contrasts kept, 0 where only the stops' means are looked at; basis (U, M, p) spans the own columns;
    border (U, M, c) is what is left of the shared ones; inner (c, c) the inverse of their normal matrix; logdet of
    V and of both normal matrices together; dof: numbers left; data (U, M) the readings; live (U, M) rows that hold
    anything.
    """

    covariance: Covariance
    dwell: int
    live: NDArray[np.bool_]
    basis: Floats
    border: Floats
    inner: Floats
    logdet: float
    dof: int
    data: Floats

    @property
    def rest(self) -> float:
        """Sum of squares of the readings without anything known."""
        return float(np.sum(self.residual**2))

    def see(self, rows: Rows) -> Floats:
        """Columns as this space sees them (U, M, c), shared known ones not yet taken off."""
        return self.free(_padded(self.covariance.whiten(rows, self.dwell), self.basis.shape[1]))

    def free(self, white: Floats) -> Floats:
        """White rows (U, M, c) without what the own known columns take up."""
        return np.asarray(white - self.basis @ (self.basis.transpose(0, 2, 1) @ white))

    @property
    def residual(self) -> Floats:
        """The readings (U, M) without anything known."""
        return np.asarray(self.data - self.border @ (self.inner @ np.einsum("umc,um->c", self.border, self.data)))

    @property
    def loglik(self) -> float:
        """Restricted log-likelihood of the readings, without its constant."""
        return -0.5 * (self.logdet + self.rest)

    @property
    def profile(self) -> float:
        """The same with the scale of the floor at its best."""
        return -0.5 * (self.logdet + self.dof * (1 + float(np.log(max(self.rest, 1e-300) / self.dof))))


def space(covariance: Covariance, known: Known, readings: Rows, count: int) -> Space:
    """The space of `count` readings (one column). Contrasts are kept where the readings have them."""
    dwell = 0 if readings.dwell is None else readings.dwell.shape[1]
    own_rows, shared_rows, said = priors(known)
    white = [covariance.whiten(rows, dwell) for rows in (known.own, known.shared, readings)]
    own, shared, data = (
        np.concatenate(pair, axis=1) for pair in zip(white, (own_rows, shared_rows, said), strict=True)
    )
    basis, rank, logdet_own = _basis(own)
    free = shared - basis @ (basis.transpose(0, 2, 1) @ shared)
    inner, shared_rank, logdet_shared = _inverse(np.einsum("umc,umd->cd", free, free))
    left = (data - basis @ (basis.transpose(0, 2, 1) @ data))[..., 0]
    logdet = covariance.logdet + logdet_own + logdet_shared
    live = np.concatenate([_live(covariance, readings, dwell), (own_rows != 0).any(2) | (shared_rows != 0).any(2)], 1)
    dof = count + known.priors - rank - shared_rank
    return Space(covariance, dwell, live, basis, free, inner, logdet, dof, left)


def _live(covariance: Covariance, readings: Rows, dwell: int) -> NDArray[np.bool_]:
    """Rows of stops and contrasts that were measured; a contrast of exactly 0 is one of a block without samples."""
    if not dwell or readings.dwell is None:
        return covariance.live
    return np.concatenate([covariance.live, readings.dwell[..., 0] != 0], axis=1)


def priors(known: Known) -> tuple[Floats, Floats, Floats]:
    """Rows that stand for the priors: of own columns (U, p+c, p), shared ones (U, p+c, c), readings (U, p+c, 1).

    A shared prior is said once, among the rows of the first unit.
    """
    U, p = known.own_precision.shape
    c = len(known.shared_precision)
    own, shared, said = np.zeros((U, p + c, p)), np.zeros((U, p + c, c)), np.zeros((U, p + c, 1))
    root, common = np.sqrt(known.own_precision), np.sqrt(known.shared_precision)
    own[:, np.arange(p), np.arange(p)] = root
    said[:, :p, 0] = root * known.own_target
    shared[0, p + np.arange(c), np.arange(c)] = common
    said[0, p:, 0] = common * known.shared_target
    return own, shared, said


def _padded(white: Floats, rows: int) -> Floats:
    """White columns (U, ·, c) with rows of zeros added."""
    return np.pad(white, ((0, 0), (0, rows - white.shape[1]), (0, 0)))


def _basis(columns: Floats) -> tuple[Floats, int, float]:
    """Orthonormal basis (U, M, p) of columns (U, M, p), zeros for what is lost; rank; log det of the normal matrix."""
    length = np.linalg.norm(columns, axis=1, keepdims=True)
    scaled = columns / np.where(length > 0, length, 1.0)
    left, s, _ = np.linalg.svd(scaled, full_matrices=False)
    kept = s > RANK * np.max(s, axis=1, keepdims=True, initial=1e-300)
    logdet = 2 * float(np.sum(np.log(s[kept])) + np.sum(np.log(length[length > 0])))
    return left * kept[:, None, :], int(np.count_nonzero(kept)), logdet


def _inverse(normal: Floats) -> tuple[Floats, int, float]:
    """Pseudo-inverse, rank and log-determinant of a normal matrix (c, c)."""
    values, vectors = np.linalg.eigh(normal)
    kept = values > RANK * values.max(initial=0.0)
    V = vectors[:, kept]
    return V / values[kept] @ V.T, int(np.count_nonzero(kept)), float(np.sum(np.log(values[kept])))
