"""What a variance of the floor gains on visits that it was not fitted to.

A variance predicts no reading, but how far readings scatter and in which directions. Each visit is predicted from all
others: with P = V⁻¹ − V⁻¹X(XᵀV⁻¹X)⁻¹XᵀV⁻¹, a visit b has the log density −½ (Py)_bᵀ P_bb⁻¹ (Py)_b + ½ log|P_bb| but
for a constant. In white rows P is I − BBᵀ, B spanning what is fitted; where a bias walks, the rows of a visit are what
those before it do not tell. The floor that predicts the visits of one part is the one of several, each at its own
scale, under which the visits of all other parts are the likeliest.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from station.diagnosis.linear.eigen import eigenvectors
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.held_out_gain import HeldOutGain, folds
from station.diagnosis.search.rank import FLOOR_VARIANCES, with_bounded_variance
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats

#: Sizes of a variance that are tried, of the one that fits all visits.
WITHIN_BOUND, FREE = (0.0, 0.1, 0.4, 1.0), tuple(np.geomspace(1 / 16, 16, 9))
#: A variance may be so many times its bound once the floor has the scale of a part.
BOUND_SLACK = 1.2
#: Of a visit that others do not tell, what is left of a direction is less than this.
UNTOLD = 1e-6


def scatter_gain(problem: ScoringProblem, name: str, upper: Floats, rms: float) -> HeldOutGain:
    """The gain of a variance that is free in the problem over one within its bound, of upper (3), everything else known
    alike. rms: of the readings without what is known, in the recipe's unit, which no variance changes."""
    i = FLOOR_VARIANCES[name]
    bounded = _Sizes.of(with_bounded_variance(problem, name, upper), i, WITHIN_BOUND, BOUND_SLACK * float(upper[i]))
    free = _Sizes.of(problem, i, FREE, np.inf)
    there = problem.view.grid.slot >= 0
    gains = np.zeros(there.shape)
    for held in folds(problem, "visit"):
        kept = there & (held == 0)
        gains += np.where(held > 0, free.density(kept) - bounded.density(kept), 0.0)
    visits = gains[there]
    std_error = float(np.sqrt(np.sum((visits - visits.mean()) ** 2)))
    return HeldOutGain("visit", rms, rms, 0.0, float(visits.sum()), std_error)


class PredictedVisits(NamedTuple):
    """Of each visit (U, R, V) predicted from all others: how many numbers are told, the sum of their squares in units
    of what was expected, and the log-determinant of their covariance; variance: that under test."""

    told: Floats
    squares: Floats
    logdet: Floats
    variance: float


class _Sizes(NamedTuple):
    """The visits under floors with several sizes of one variance, which is at most `most`."""

    predicted: Sequence[PredictedVisits]
    most: float

    @staticmethod
    def of(problem: ScoringProblem, i: int, sizes: Sequence[float], most: float) -> "_Sizes":
        """Under those so many times the variance i that fits all."""
        best = problem.fit().floor.variances
        floors = [np.where(np.arange(3) == i, size * best, best) for size in sizes]
        return _Sizes([predicted_visits(problem, variances, i) for variances in floors], most)

    def density(self, kept: Floats) -> Floats:
        """Log density of each visit (U, R, V) under the floor, at the scale, that is the likeliest for those kept."""
        best, value = np.zeros(kept.shape), -np.inf
        for p in self.predicted:
            scale = float(np.sum(p.squares[kept])) / max(float(np.sum(p.told[kept])), 1.0)
            if scale <= 0 or scale * p.variance > self.most:
                continue
            density = -0.5 * (p.told * np.log(scale) + p.squares / scale + p.logdet)
            if (now := float(np.sum(density[kept]))) > value:
                best, value = density, now
        return best


def predicted_visits(problem: ScoringProblem, variances: Floats, i: int) -> PredictedVisits:
    """Each visit predicted from all others under a floor."""
    space = problem.space(NoiseFloor(*np.sqrt(variances).tolist()), moving=False)
    slot, k = problem.view.grid.slot, problem.view.grid.k
    rows, by_visit = problem.view.grid.rows, (slot.size, k)
    spans = np.concatenate([space.basis, space.shared_basis], axis=2)[:, :rows].reshape(*by_visit, -1)
    white = space.residual[:, :rows].reshape(by_visit)
    values, turn = eigenvectors(np.eye(k) - spans @ spans.swapaxes(1, 2))
    told = (values > UNTOLD) & (slot.reshape(-1, 1) >= 0)
    kept, along = np.where(told, values, 1.0), np.einsum("vij,vi->vj", turn, white)
    squares = np.sum(np.where(told, along**2 / kept, 0.0), axis=1)
    logdet = space.covariance.runs.log_variances().reshape(by_visit).sum(1) - np.sum(np.log(kept), axis=1)
    told_numbers, squares, logdet = (x.reshape(slot.shape) for x in (told.sum(1) * 1.0, squares, logdet))
    return PredictedVisits(told_numbers, squares, logdet, float(variances[i]))
