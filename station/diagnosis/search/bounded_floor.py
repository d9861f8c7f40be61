"""Floors at their bounds: whether sets of noise would be fitted there, too.

A few visits hardly tell how much of their scatter is a walk or turns: by chance alone the fit of such a variance ends
at nothing, or at the most that a healthy rig may have. Readings that took it there are not like all others, so that
chance is drawn from those that take it there as well. Where a set would be fitted is told by its slopes and the
information at the floor of the readings: the best of the parabola that they make, within the bounds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.linear.noise_floor import FittedFloor, newton
from station.domain.core.types import Array, Floats

#: A turn of the visits and a step of the walk below these shares of the noise change nothing that chance does: the turn
#: adds a hundredth to a variance, the walk as much by the end of a hundred visits.
LEAST_DETECTED = (0.1, 0.01)
#: A variance is at a bound within this share of the most that is allowed.
AT_BOUND = 0.01
#: Rounds in which each variance in turn is put at its best beside the others.
ROUNDS = 20


def bound_sides(fitted: FittedFloor, upper: Floats) -> tuple[int, int]:
    """Of turn and walk: −1 at nothing, 1 at the most allowed, 0 between, or where nothing depends on it."""
    _, turn, walk = _sides(fitted.floor.variances, _most(fitted, upper))
    return int(turn), int(walk)


@dataclass(frozen=True, slots=True, eq=False)
class BoundedFloor:
    """A fitted floor of which something stands at a bound; most (3): the bounds of its variances; expected (3): the
    squares by each variance where it has no slope; information (3, 3)."""

    fitted: FittedFloor
    most: Floats
    expected: Floats
    information: Floats

    @staticmethod
    def of(fitted: FittedFloor, upper: Floats) -> "BoundedFloor | None":
        """The floor, None where nothing of it stands at a bound."""
        if not any(bound_sides(fitted, upper)):
            return None
        slope, information = newton(fitted.parts, fitted.space)
        squares = _squares(fitted, fitted.space.residual[..., None])[0]
        return BoundedFloor(fitted, _most(fitted, upper), squares - 2 * slope, information)

    def holds(self, visits: Array) -> NDArray[np.bool_]:
        """Which sets (n) of noise of the visits (U, R, m, n) would be fitted at the same bounds, and there alone."""
        at = self.fitted.floor.variances
        best = self._best(0.5 * (_squares(self.fitted, self._residual(visits)) - self.expected), at)
        return np.asarray(np.all(_sides(best, self.most) == _sides(at, self.most), axis=1))

    def _best(self, slope: Floats, at: Floats) -> Floats:
        """The variances (n, 3) within their bounds that are best by slopes (n, 3) at the fitted ones."""
        moved = np.zeros_like(slope)
        for _ in range(ROUNDS):
            for i in np.flatnonzero((self.most > 0) & (np.diag(self.information) > 0)):
                rest = slope[:, i] - moved @ self.information[i]
                moved[:, i] = np.clip(moved[:, i] + rest / self.information[i, i], -at[i], self.most[i] - at[i])
        return np.asarray(at + moved)

    def _residual(self, visits: Array) -> Floats:
        """Sets of noise (U, R, m, n) as the space sees the readings (U, M, n)."""
        space = self.fitted.space
        U, R, m, n = visits.shape
        white = np.zeros((U, space.basis.shape[1], n))
        white[:, : R * m] = space.covariance.runs.whiten(visits).reshape(U, R * m, n)
        white = np.asarray(white - space.basis @ (space.basis.swapaxes(1, 2) @ white))
        flat = space.shared_basis.reshape(U * white.shape[1], -1)
        return np.asarray(white - (flat @ (flat.T @ white.reshape(len(flat), n))).reshape(white.shape))


def _most(fitted: FittedFloor, upper: Floats) -> Floats:
    """The bounds of the variances; 0 for one that nothing here depends on, or as good as nothing."""
    least = np.array([0.0, *LEAST_DETECTED]) * fitted.floor.noise
    return np.where(fitted.parts.shown & (upper > least**2), upper, 0.0)


def _sides(at: Floats, most: Floats) -> NDArray[np.intp]:
    """On which bound variances (…, 3) are: −1 at nothing, 1 at the most, 0 between, or where there is no such part."""
    least = AT_BOUND * np.where(np.isfinite(most), most, 0.0)
    return np.asarray(np.select([most <= 0, at >= (1 - AT_BOUND) * most, at <= least], [0, 1, -1], 0))


def _squares(fitted: FittedFloor, residual: Floats) -> Floats:
    """rᵀ·L⁻¹·V·L⁻ᵀ·r (n, 3) of each variance's part V, of residuals (U, M, n)."""
    runs = fitted.space.covariance.runs
    (U, R), m = runs.member.shape, runs.rows
    rows = runs.transposed(residual[:, : R * m].reshape(U, R, m, -1))
    return np.asarray(np.einsum("urmn,urmin->ni", rows, fitted.parts.times(rows)))
