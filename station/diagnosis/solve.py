"""The coefficients of everything known, with their covariance: generalised least squares under the floor."""

from dataclasses import dataclass

import numpy as np

from station.diagnosis.known import Place
from station.diagnosis.space import Known, Rows, Space
from station.domain.types import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """own (U, p) and shared (c) coefficients; own_cov (U, p, p) and shared_cov (c, c)."""

    own: Floats
    own_cov: Floats
    shared: Floats
    shared_cov: Floats

    def at(self, place: Place) -> tuple[Floats, Floats]:
        """Coefficients and standard deviations (groups, axes) at a place; zero where no group acts."""
        on = place.column >= 0
        value, std = np.zeros(place.column.shape), np.zeros(place.column.shape)
        column = place.column[on]
        if place.own:
            unit = place.unit[on]
            value[on], std[on] = self.own[unit, column], np.sqrt(self.own_cov[unit, column, column])
        else:
            value[on], std[on] = self.shared[column], np.sqrt(self.shared_cov[column, column])
        return value, std


def solve(space: Space, known: Known, readings: Rows) -> Solved:
    """Best coefficients of the known columns, priors included (the estimate of a random effect is its mean)."""
    shared = space.inner @ np.einsum("umc,um->c", space.border, space.data)
    white = space.covariance.whiten(readings, space.dwell)
    rows = [space.covariance.whiten(r, space.dwell) for r in (known.own, known.shared)]
    normal = np.einsum("ump,umq->upq", rows[0], rows[0])
    at = np.arange(normal.shape[1])
    normal[:, at, at] += known.own_precision
    # Scaling the columns to length one keeps the pseudo-inverse's cut about directions, not about units.
    size = np.sqrt(np.maximum(np.einsum("upp->up", normal), 1e-300))
    inverse = np.linalg.pinv(normal / (size[:, :, None] * size[:, None, :]), 1e-12, hermitian=True)
    inverse = inverse / (size[:, :, None] * size[:, None, :])
    said = np.einsum("ump,um->up", rows[0], white[..., 0]) + known.own_precision * known.own_target
    cross = inverse @ np.einsum("ump,umc->upc", rows[0], rows[1])
    own = np.einsum("upq,uq->up", inverse, said) - cross @ shared
    return Solved(own, inverse + cross @ space.inner @ cross.transpose(0, 2, 1), shared, space.inner)
