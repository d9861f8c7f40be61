"""A state of a unit that nothing recorded shows: an offset that jumps to and fro, a bond that opens at some visits.

Such a state moves all axes of a unit along one direction, whenever it changes. What the readings leave under the floor
is white and has no direction: of a unit's e (v, 3) the matrix S = Σ φ^|i−j| e_i e_jᵀ over the pairs of visits of a run
is, but for chance, the same along every axis. Its deviation from that, squared and summed over the units, is the score
statistic of one direction for each unit (Mauchly's sphericity where φ = 0); noise drawn afresh says what is usual, a
gamma distribution of its mean and variance how rare more is. How much a state explains is the likelihood of a variance
along each unit's direction, its size and the noise integrated out as those of any cause are.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.unseen import NOTHING, Unseen
from station.domain.core.types import Floats

#: Shares of a state that are left at the next visit: none, or what one that lasts some visits has.
KEPT = (0.0, 0.5)
#: Variances of a state beside the noise over which its evidence is averaged; what each unit's direction costs, nats.
RATIOS, DIRECTION_NATS = np.geomspace(0.02, 200.0, 20), 2.0
#: Median length of three white numbers, and the length beyond which a visit says no more.
MEDIAN_LENGTH, MOST_LENGTH = 1.538, 3.5
#: Sets of noise that are drawn; visits of the longest run, and units of which a state is looked for.
DRAWN, LEAST_VISITS, MOST_VISITS, MOST_UNITS = 256, 4, 120, 24


def find_state(problem: ScoringProblem, floor: NoiseFloor) -> Unseen:
    """What a direction of each unit explains of the readings under a floor; nothing of few or of very long runs."""
    grid = problem.view.grid
    if grid.k != 3 or not LEAST_VISITS <= grid.slot.shape[2] <= MOST_VISITS:
        return NOTHING
    setting, _ = problem.setting.of_units(np.arange(min(grid.units, MOST_UNITS)))
    space, slot = setting.space(floor, moving=False), setting.layout.grid.slot
    U, _, V = slot.shape
    if not space.residual.any():
        return NOTHING
    rng = np.random.default_rng(U * V)
    noise = space.free(rng.standard_normal((*space.live.shape, DRAWN)) * space.live[..., None])
    # The readings themselves are the last of all sets.
    sets = np.concatenate([noise, space.residual[..., None]], axis=2)
    e = _calmed(sets[:, : slot[0].size * 3].reshape(*slot.shape, 3, -1), slot)
    tests = [_Directions.of(e, slot, kept) for kept in KEPT]
    chance = len(KEPT) * min(_chance(test.statistic) for test in tests)
    nats = log_mean_exp(np.concatenate([test.likelihoods(space.dof) for test in tests]))
    return Unseen.of(float(nats) - DIRECTION_NATS * U, chance)


def _calmed(e: Floats, slot: NDArray[np.intp]) -> Floats:
    """White rows (U, R, V, 3, n) in the noise of most visits, where those beyond it are drawn in: a few visits that are
    wrong by much are no state."""
    length = np.sqrt(np.sum(e**2, axis=3, keepdims=True))
    usual = np.median(length[slot >= 0], axis=0) / MEDIAN_LENGTH
    e = e / usual * np.minimum(1.0, MOST_LENGTH / np.maximum(length / usual, 1e-300))
    return np.asarray(e / np.sqrt(np.sum(e**2, axis=(0, 1, 2, 3)) / (3 * np.count_nonzero(slot >= 0))))


@dataclass(frozen=True, slots=True, eq=False)
class _Directions:
    """How much of each set (n) has a direction; of the last one the parts along it of each run (U, R, V), by the
    principal axes of what lasts, and the variances (V) of these."""

    statistic: Floats
    along: Floats
    spread: Floats
    live: Floats

    @staticmethod
    def of(e: Floats, slot: NDArray[np.intp], kept: float) -> "_Directions":
        """Of sets of white rows (U, R, V, 3, n), for states of which a share is left at the next visit."""
        V = slot.shape[2]
        lasting = kept ** np.abs(np.subtract.outer(np.arange(V), np.arange(V))).astype(float)
        smooth = np.tensordot(lasting, e, axes=(1, 2)).transpose(1, 2, 0, 3, 4) if kept else e
        S = np.einsum("urvin,urvjn->unij", e, smooth, optimize=True)
        S = S - np.trace(S, axis1=2, axis2=3)[..., None, None] / 3 * np.eye(3)
        direction = np.linalg.eigh((S[:, -1] + S[:, -1].swapaxes(1, 2)) / 2)[1][..., -1]
        spread, axes = np.linalg.eigh(lasting)
        along = np.einsum("vk,urvi,ui->urk", axes, e[..., -1], direction)
        live = np.mean(slot >= 0, axis=2, keepdims=True)
        return _Directions(np.sum(S**2, axis=(0, 2, 3)), along, np.maximum(spread, 0.0), live)

    def likelihoods(self, dof: int) -> Floats:
        """Log-likelihood of each size (ratios) beside none, the noise's at its best, of rows whose mean square is 1."""
        grown = RATIOS[:, None] * self.spread
        # All rows together, of which the known takes some, have as many squares as rows.
        rows = 3 * self.live.sum() * self.along.shape[2]
        taken = np.einsum("sk,urk->s", grown / (1 + grown), self.along**2) / rows
        return np.asarray(
            -0.5 * dof * np.log1p(-np.minimum(taken, 1 - 1e-9)) - 0.5 * self.live.sum() * np.log1p(grown).sum(1)
        )


def _chance(statistic: Floats) -> float:
    """How often noise has as much as the last of the sets, by the moments of all others."""
    usual, found = statistic[:-1], statistic[-1]
    mean, variance = float(np.mean(usual)), float(np.var(usual))
    if variance <= 0.0:
        return 1.0
    return float(scipy.special.gammaincc(mean**2 / variance, found * mean / variance))
