"""The coefficients of everything known, with their covariance: generalised least squares under the floor."""

from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.nuisance import CoefficientIndex
from station.diagnosis.linear.eigen import eigenvectors, pseudo_inverse
from station.diagnosis.linear.projection import DataColumns, FloorCovariance, NuisanceColumns, prior_rows
from station.domain.core.types import Floats

#: Directions shorter than this share of the longest are not estimated.
EIGENVALUE_CUT = 1e-12
#: Directions of columns of unit length that are shorter than the root of this say the same twice.
SAME_COLUMNS = 1e-9
#: The square of one over a shorter column is no number.
LEAST_SIZE = 1e-150


@dataclass(frozen=True, slots=True, eq=False)
class WhiteRows:
    """Everything known and the readings as white rows (U, M, …), those of the priors last; precision of those that
    have none is 0."""

    own: Floats
    shared: Floats
    data: Floats
    visits: int
    dwell: int

    def residual(self, solved: "NuisanceSolution") -> Floats:
        """Readings (U, M) without what the coefficients explain."""
        return np.asarray(self.data - np.einsum("ump,up->um", self.own, solved.own) - self.shared @ solved.shared)


@dataclass(frozen=True, slots=True, eq=False)
class NuisanceSolution:
    """own (U, p) and shared (c) coefficients; own_cov (U, p, p) and shared_cov (c, c)."""

    own: Floats
    per_unit_cov: Floats
    shared: Floats
    shared_cov: Floats

    def at(self, place: CoefficientIndex) -> tuple[Floats, Floats]:
        """Coefficients and standard deviations (groups, axes) at a place; zero where no group acts."""
        on = place.column >= 0
        value, std = np.zeros(place.column.shape), np.zeros(place.column.shape)
        column = place.column[on]
        if place.own:
            unit = place.unit[on]
            value[on], std[on] = self.own[unit, column], np.sqrt(self.per_unit_cov[unit, column, column])
        else:
            value[on], std[on] = self.shared[column], np.sqrt(self.shared_cov[column, column])
        return value, std


def whitened(covariance: FloorCovariance, known: NuisanceColumns, readings: DataColumns) -> WhiteRows:
    """Known columns and readings (one column) as white rows."""
    dwell = 0 if readings.dwell is None else readings.dwell.shape[1]
    white = [covariance.whiten(rows, dwell) for rows in (known.own, known.shared, readings)]
    own, shared, data = (np.concatenate(pair, axis=1) for pair in zip(white, prior_rows(known), strict=True))
    return WhiteRows(own, shared, data[..., 0], white[0].shape[1] - dwell, dwell)


def with_priors(white: WhiteRows, known: NuisanceColumns) -> WhiteRows:
    """The same rows with the priors of `known`, whose columns are the same."""
    measured = [x[:, : white.visits + white.dwell] for x in (white.own, white.shared, white.data[..., None])]
    own, shared, data = (np.concatenate(pair, axis=1) for pair in zip(measured, prior_rows(known), strict=True))
    return replace(white, own=own, shared=shared, data=data[..., 0])


def solve(white: WhiteRows, used: Floats | None = None) -> NuisanceSolution:
    """Best coefficients, priors included (the estimate of a random effect is its mean given the data). used (U, M):
    weight of each row, 1 for those that are fitted and 0 for the others; all where left out."""
    own, shared, data = white.own, white.shared, white.data
    if used is not None:
        own, shared, data = own * used[..., None], shared * used[..., None], data * used
    inverse = _inverse(own.transpose(0, 2, 1) @ own)
    to_shared = inverse @ (own.transpose(0, 2, 1) @ shared)
    to_data = np.einsum("upq,uq->up", inverse, np.einsum("ump,um->up", own, data))
    left = shared - own @ to_shared
    flat = left.reshape(data.size, -1)
    shared_cov = _inverse(flat.T @ flat)
    found = shared_cov @ (flat.T @ data.ravel())
    own_cov = inverse + to_shared @ shared_cov @ to_shared.transpose(0, 2, 1)
    return NuisanceSolution(to_data - to_shared @ found, own_cov, found, shared_cov)


def _inverse(normal: Floats) -> Floats:
    """Pseudo-inverse (…, p, p). Columns are scaled first, so that the cut depends on directions, not on units. A column
    of next to nothing, which nothing measured, gets a row and a column of zeros."""
    size = np.sqrt(np.einsum("...pp->...p", normal))
    live = size > LEAST_SIZE
    inverse = np.where(live, 1 / np.where(live, size, 1.0), 0.0)
    scale = inverse[..., :, None] * inverse[..., None, :]
    return np.asarray(pseudo_inverse(normal * scale, EIGENVALUE_CUT) * scale)


def with_most_in_first(columns: Floats, own: Floats, first: int) -> Floats:
    """Coefficients (U, p) of columns (U, M, p) that do the same, with as much of it as can be in the first so many:
    where columns tell the same, a solution shares it out between them. The simulation has only the calibration's."""
    length = np.linalg.norm(columns, axis=1)
    length = np.where(length > 0, length, 1.0)
    moved = own.copy()
    for u, unit in enumerate(columns / length[:, None]):
        values, vectors = eigenvectors(unit.T @ unit)
        same = vectors[:, values < SAME_COLUMNS * values.max(initial=0.0)]
        if same.shape[1]:
            by = np.linalg.lstsq(same[first:], (own[u] * length[u])[first:], rcond=None)[0]
            moved[u] -= (same @ by) / length[u]
    return moved
