"""The data as the noise floor sees them: whitened, and free of everything that is fitted anyway.

Known parameters stand beside the causes under test: `own` columns, one set a unit (its calibration), and `shared`
ones, common to all units (causes already accepted). Both are projected out, so a cause under test keeps only what
no calibration can take up. A known parameter may carry a prior: a row saying "0 ± std" is added to the data.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.linear.eigen import eigenvectors, left_singular_vectors
from station.diagnosis.linear.run_filter import RunFilter
from station.domain.core.types import Array, Floats


class DataColumns(NamedTuple):
    """Columns as the data have them: visit (U, R, m, c); dwell (U, w, c) the contrasts within the visits, in units of
    their noise, or None where they are all zero."""

    visit: Floats
    dwell: Floats | None = None

    @staticmethod
    def concatenate(parts: "Sequence[DataColumns]") -> "DataColumns":
        """All columns side by side; there must be at least one part."""
        moving = [p.dwell for p in parts if p.dwell is not None]
        visit = np.concatenate([p.visit for p in parts], axis=-1)
        if not moving:
            return DataColumns(visit)
        still = (*moving[0].shape[:2],)
        dwell = [np.zeros((*still, p.visit.shape[-1])) if p.dwell is None else p.dwell for p in parts]
        return DataColumns(visit, np.concatenate(dwell, axis=-1))

    def only(self, columns: Array | slice) -> "DataColumns":
        """Some of the columns."""
        return DataColumns(self.visit[..., columns], None if self.dwell is None else self.dwell[..., columns])

    def of_units(self, chosen: Array | slice) -> "DataColumns":
        """The same of some units."""
        return DataColumns(self.visit[chosen], None if self.dwell is None else self.dwell[chosen])


class AxisColumns(NamedTuple):
    """Columns of the visits' means of which each moves one axis alone: values (U, R, V, c) there, and axis (c)."""

    values: Floats
    axis: NDArray[np.intp]


#: All units.
ALL_UNITS = slice(None)
#: Units looked at together where each needs several times as many numbers as stay.
UNITS_AT_ONCE = 64
#: A column that keeps less than this share of its length is taken for a combination of the others.
RANK_TOLERANCE = 1e-7
#: Columns of length one whose normal matrix has no smaller eigenvalue are told apart to twelve digits by it alone.
WELL_CONDITIONED = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class NuisanceColumns:
    """own (p) and shared (c) columns with their priors: precision (U, p), (c), 0 for none, about target (U, p), (c).
    goes_round: whether of them only what goes round a healthy sensor changes within a visit."""

    own: DataColumns
    per_unit_precision: Floats
    per_unit_target: Floats
    shared: DataColumns
    shared_precision: Floats
    shared_target: Floats
    goes_round: bool = False

    @property
    def moving(self) -> bool:
        """Whether any known cause changes within a visit, so that its size is told by the contrasts, too."""
        return not self.goes_round and (self.own.dwell is not None or self.shared.dwell is not None)

    def of_units(self, chosen: Array | slice) -> "NuisanceColumns":
        """The same of some units."""
        return NuisanceColumns(
            self.own.of_units(chosen),
            self.per_unit_precision[chosen],
            self.per_unit_target[chosen],
            self.shared.of_units(chosen),
            self.shared_precision,
            self.shared_target,
            self.goes_round,
        )

    @property
    def prior_count(self) -> int:
        """How many coefficients have a prior."""
        return int(np.count_nonzero(self.per_unit_precision) + np.count_nonzero(self.shared_precision))


@dataclass(frozen=True, slots=True, eq=False)
class FloorCovariance:
    """The floor of all runs: what whitens them, which rows are measured (U, R·m), log-determinant."""

    runs: RunFilter
    live: NDArray[np.bool_]
    logdet: float

    def of_units(self, units: slice) -> "FloorCovariance":
        """The floor of some units; the log-determinant stays with the whole."""
        return FloorCovariance(self.runs.of_units(units), self.live[units], 0.0)

    def whiten(
        self, rows: DataColumns, dwell: int, more: int = 0, units: slice = ALL_UNITS, out: Floats | None = None
    ) -> Floats:
        """Rows of unit variance (U, R·m + dwell + more, c) of some units; `dwell` is how many contrasts a unit shall
        keep, `more` how many rows of zeros come after."""
        U, R, m, c = rows.visit.shape
        moving = bool(dwell) and rows.dwell is not None
        white = np.empty((U, R * m + dwell + more, c)) if out is None else out
        white[:, R * m + dwell * moving :] = 0.0
        self.runs.of_units(units).whiten(rows.visit, out=white[:, : R * m].reshape(U, R, m, c))
        if moving:
            white[:, R * m : R * m + dwell] = rows.dwell
        return white


class SpaceSize(NamedTuple):
    """Of a space what a likelihood needs beside sums of squares: logdet, dof and copies, as the space has them."""

    logdet: float
    dof: int
    copies: int


@dataclass(frozen=True, slots=True, eq=False)
class ResidualSpace:
    """White rows of each unit (visits, contrasts, priors), free of the unit's own known columns.

    dwell: contrasts kept, 0 where only the visits' means are looked at; basis (U, M, p) spans the own columns;
    border (U, M, c) is an orthonormal basis of what is left of the shared ones; common: log-determinant of their
    normal matrix, logdet: of V and of both normal matrices together; dof: numbers left; data (U, M) the readings;
    live (U, M) rows that hold anything; copies: for how many sets of such units the few here stand.
    """

    covariance: FloorCovariance
    dwell: int
    live: NDArray[np.bool_]
    basis: Floats
    shared_basis: Floats
    shared_logdet: float
    logdet: float
    dof: int
    data: Floats
    copies: int = 1

    @property
    def size(self) -> SpaceSize:
        """What stays of the space where its rows are no longer needed."""
        return SpaceSize(self.logdet, self.dof, self.copies)

    @property
    def rest(self) -> float:
        """Sum of squares of the readings without anything known."""
        return float(np.sum(self.residual**2))

    def part(self, units: slice) -> "ResidualSpace":
        """The same of some units, as columns are projected and compared with the readings in it."""
        covariance, basis, shared = self.covariance.of_units(units), self.basis[units], self.shared_basis[units]
        return replace(self, covariance=covariance, basis=basis, shared_basis=shared, data=self.data[units])

    def project(self, rows: DataColumns, units: slice = ALL_UNITS) -> Floats:
        """Columns of some units as this space sees them (U, M, c), shared known ones not yet taken off."""
        _, R, m, _ = rows.visit.shape
        more = self.basis.shape[1] - R * m - self.dwell
        white, basis = self.covariance.whiten(rows, self.dwell, more, units), self.basis[units]
        white -= basis @ (basis.transpose(0, 2, 1) @ white)
        return white

    def free(self, white: Floats) -> Floats:
        """White rows (U, M, c) without what the own known columns take up."""
        return np.asarray(white - self.basis @ (self.basis.transpose(0, 2, 1) @ white))

    def times(self, copies: int) -> "ResidualSpace":
        """The space of so many times as many units of the same kind."""
        if copies == 1:
            return self
        shared = self.shared_basis.shape[2]
        # The shared columns stay as many: their normal matrix grows, all else adds up.
        common = self.shared_logdet + shared * float(np.log(copies))
        logdet = copies * (self.logdet - self.shared_logdet) + common
        dof = copies * (self.dof + shared) - shared
        border = self.shared_basis / np.sqrt(copies)
        return replace(self, shared_basis=border, shared_logdet=common, logdet=logdet, dof=dof, copies=copies)

    @property
    def residual(self) -> Floats:
        """The readings (U, M) without anything known."""
        flat = self.shared_basis.reshape(self.data.size, -1)
        return np.asarray(self.data - (flat @ (flat.T @ self.data.ravel())).reshape(self.data.shape))

    @property
    def loglik(self) -> float:
        """Restricted log-likelihood of the readings, without its constant."""
        return -0.5 * (self.logdet + self.rest)

    @property
    def profile(self) -> float:
        """The same with the scale of the floor at its best."""
        if not self.dof:
            return -0.5 * self.logdet
        return -0.5 * (self.logdet + self.dof * (1 + float(np.log(max(self.rest, 1e-300) / self.dof))))


def residual_space(
    covariance: FloorCovariance, known: NuisanceColumns, readings: DataColumns, count: int
) -> ResidualSpace:
    """The space of `count` readings (one column). Contrasts are kept where the readings have them. Some units at a
    time: on the way to what is kept of a unit there are several times as many numbers."""
    dwell = 0 if readings.dwell is None else readings.dwell.shape[1]
    priors, units = prior_rows(known), len(readings.visit)
    parts = [
        _units_space(covariance, known, readings, priors, slice(first, first + UNITS_AT_ONCE))
        for first in range(0, units, UNITS_AT_ONCE)
    ]
    basis, free, residual, live = (_joined([getattr(p, n) for p in parts]) for n in ("basis", "free", "data", "live"))
    border, common = _orthonormal(free)
    logdet = covariance.logdet + sum(p.logdet for p in parts) + common
    dof = count + known.prior_count - sum(p.rank for p in parts) - border.shape[2]
    return ResidualSpace(covariance, dwell, live, basis, border, common, logdet, dof, residual)


class _UnitsSpace(NamedTuple):
    """Of some units the own known columns' basis (U, M, p), its rank and the log-determinant of their normal matrix;
    the shared columns (U, M, c) and the readings (U, M) free of them; live (U, M) rows that hold anything."""

    basis: Floats
    rank: int
    logdet: float
    free: Floats
    data: Floats
    live: NDArray[np.bool_]


def _units_space(
    covariance: FloorCovariance,
    known: NuisanceColumns,
    readings: DataColumns,
    priors: tuple[Floats, Floats, Floats],
    units: slice,
) -> _UnitsSpace:
    covariance, known, readings = covariance.of_units(units), known.of_units(units), readings.of_units(units)
    own_rows, shared_rows, targets = (rows[units] for rows in priors)
    dwell = 0 if readings.dwell is None else readings.dwell.shape[1]
    white = [covariance.whiten(rows, dwell) for rows in (known.own, known.shared, readings)]
    own, shared, data = (
        np.concatenate(pair, axis=1) for pair in zip(white, (own_rows, shared_rows, targets), strict=True)
    )
    basis, rank, logdet = _basis(own)
    free = shared - basis @ (basis.transpose(0, 2, 1) @ shared)
    residual = (data - basis @ (basis.transpose(0, 2, 1) @ data))[..., 0]
    live = np.concatenate([_live(covariance, readings, dwell), (own_rows != 0).any(2) | (shared_rows != 0).any(2)], 1)
    return _UnitsSpace(basis, rank, logdet, free, residual, live)


def _joined(parts: Sequence[Array]) -> Array:
    """Units one after the other; those of a single part are not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _live(covariance: FloorCovariance, readings: DataColumns, dwell: int) -> NDArray[np.bool_]:
    """Rows of visits and contrasts that were measured; a contrast of exactly 0 is one of a block without samples."""
    if not dwell or readings.dwell is None:
        return covariance.live
    return np.concatenate([covariance.live, readings.dwell[..., 0] != 0], axis=1)


def prior_rows(known: NuisanceColumns) -> tuple[Floats, Floats, Floats]:
    """Rows that stand for the priors: of own columns (U, p+c, p), shared ones (U, p+c, c), readings (U, p+c, 1).

    A shared prior is said once, among the rows of the first unit.
    """
    U, p = known.per_unit_precision.shape
    c = len(known.shared_precision)
    own, shared, targets = np.zeros((U, p + c, p)), np.zeros((U, p + c, c)), np.zeros((U, p + c, 1))
    root, common = np.sqrt(known.per_unit_precision), np.sqrt(known.shared_precision)
    own[:, np.arange(p), np.arange(p)] = root
    targets[:, :p, 0] = root * known.per_unit_target
    shared[0, p + np.arange(c), np.arange(c)] = common
    targets[0, p:, 0] = common * known.shared_target
    return own, shared, targets


def _basis(columns: Floats) -> tuple[Floats, int, float]:
    """Orthonormal basis (U, M, p) of columns (U, M, p), zeros for what is lost; rank; log det of the normal matrix."""
    length = np.linalg.norm(columns, axis=1, keepdims=True)
    scaled = columns / np.where(length > 0, length, 1.0)
    normal, p = scaled.swapaxes(1, 2) @ scaled, columns.shape[2]
    # A column of zeros, of what acts in other units, is given an eigenvalue of its own, beyond those of all others.
    normal[:, np.arange(p), np.arange(p)] += (p + 1) * (length[:, 0] == 0)
    values, turn = eigenvectors(normal)
    retained, clear = values < p + 0.5, np.all(values > WELL_CONDITIONED, axis=1)
    # The square of the condition is far from the rounding: no singular values are needed.
    # A value of 0 is of columns that tell the same; their unit goes the other way.
    basis = scaled @ (turn / np.where(retained & (values > 0), np.sqrt(np.abs(values)), np.inf)[:, None, :])
    retained &= clear[:, None]
    rank, logdet = int(np.count_nonzero(retained)), float(np.sum(np.log(values[retained])))
    if not clear.all():
        vectors, s = left_singular_vectors(scaled[~clear])
        more = s > RANK_TOLERANCE * np.max(s, axis=1, keepdims=True, initial=1e-300)
        basis[~clear] = vectors * more[:, None, :]
        rank += int(np.count_nonzero(more))
        # Of columns that tell the same no length counts twice: as many count as there are directions.
        spanned = np.linalg.qr((basis[~clear].swapaxes(1, 2) @ columns[~clear]).swapaxes(1, 2), mode="r")
        logdet += 2 * float(np.sum(np.log(np.abs(np.einsum("uii->ui", spanned)[more]))))
    told = length[clear]
    return basis, rank, logdet + 2 * float(np.sum(np.log(told[told > 0])))


def _orthonormal(columns: Floats) -> tuple[Floats, float]:
    """Orthonormal basis (U, M, rank) of columns (U, M, c) over all units; log det of their normal matrix. Columns count
    by their directions: one that is short beside the others is none of them."""
    flat = columns.reshape(columns.shape[0] * columns.shape[1], -1)
    normal = flat.T @ flat
    length = np.sqrt(np.diagonal(normal))
    length = np.where(length > 0, length, 1.0)
    # Scaled here and not in the columns, which are long.
    values, vectors = eigenvectors(normal / np.outer(length, length))
    retained = values > RANK_TOLERANCE * values.max(initial=0.0)
    basis = flat @ (vectors[:, retained] / (length[:, None] * np.sqrt(values[retained])))
    # Of columns that tell the same as many lengths count as there are directions.
    spanned = np.linalg.qr((basis.T @ flat).T, mode="r")
    logdet = 2 * float(np.sum(np.log(np.abs(np.diagonal(spanned)))))
    return basis.reshape(*columns.shape[:2], -1), logdet
