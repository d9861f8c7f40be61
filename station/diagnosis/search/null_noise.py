"""Noise of a floor that is known only as well as the readings tell it, and of which they may stand at a bound."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from station.diagnosis.linear.noise_floor import FittedFloor, covariance_root
from station.diagnosis.linear.projection import DataColumns
from station.diagnosis.linear.run_filter import RunFilter
from station.diagnosis.search.bounded_floor import BoundedFloor
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.domain.core.types import Array

#: Sets drawn for one that is wanted where the floor stands at a bound, and floors looked at for one; then any set does.
DRAWN_FOR_ONE, FLOORS_FOR_ONE = 3, 4


class NullNoise(NamedTuple):
    """White noise (n, U, ·) of everything, and what a floor makes of the visits' part of it (U, R, m, n)."""

    noise: Array
    visits: Array

    @staticmethod
    def of(noise: Array, true: RunFilter) -> "NullNoise":
        """Noise of a true floor."""
        return NullNoise(noise, coloured(noise[:, :, : true.member.shape[1] * true.rows], true))

    def beside(self, signal: DataColumns) -> "NullNoise":
        """The same with a column added to every set."""
        noise = self.noise
        if signal.dwell is not None:
            start, noise = self.visits[0, ..., 0].size, noise.copy()
            noise[:, :, start : start + signal.dwell.shape[1]] += signal.dwell[..., 0]
        return NullNoise(noise, self.visits + signal.visit.astype(np.float32))


def coloured(white: Array, true: RunFilter) -> Array:
    """What a true floor makes of white rows of visits (n, U, R·m): (U, R, m, n)."""
    (U, R), m = true.member.shape, true.rows
    return true.coloured(np.ascontiguousarray(white.reshape(-1, U, R, m).transpose(1, 2, 3, 0)))


def noise_of_floor(
    problem: ScoringProblem,
    fitted: FittedFloor,
    now: WalkMarginal,
    rng: np.random.Generator,
    floors: int,
    sets: int,
    bounded: BoundedFloor | None,
) -> Iterator[NullNoise]:
    """White noise of the widest space, floor by floor, so many sets of each; bounded: only such as would be fitted at
    the same bounds, so many of all floors together."""
    mean, root = fitted.floor.variances, covariance_root(fitted.covariance)
    spaces = [s.space for stage in now.stages for s in stage.projected if s.space is not None]
    widest = max(spaces, key=lambda space: space.live.shape[1])
    live, contrasts, member = widest.live, widest.dwell, spaces[0].covariance.runs.member
    shape = problem.view.contrast_noise.noise.shape
    wanted, draws, most = floors * sets, sets, floors
    if bounded is not None:
        draws, most = DRAWN_FOR_ONE * sets, FLOORS_FOR_ONE * floors
    for left in range(most, 0, -1):
        variances = np.clip(mean + root @ rng.standard_normal(3), [0.25 * mean[0], 0.0, 0.0], problem.upper)
        true = replace(problem.structure.covariance(variances).runs.single_precision(), member=member)
        rows = true.rows * member.shape[1]
        white = rng.standard_normal((draws, len(live), rows), dtype=np.float32) * live[:, :rows]
        visits = coloured(white, true)
        if bounded is not None:
            # Once as many floors are left as it takes, any set does.
            there = np.flatnonzero(bounded.holds(visits) | (left * draws <= wanted))[:wanted]
            if not len(there):
                continue
            white, visits = white[there], visits[..., there]
        others = rng.standard_normal((len(white), len(live), live.shape[1] - rows), dtype=np.float32) * live[:, rows:]
        inside = others[:, :, :contrasts]
        truth = problem.view.contrast_noise.of_truth(inside.reshape(*inside.shape[:2], -1, *shape), rng)
        others[:, :, :contrasts] = truth.reshape(inside.shape)
        yield NullNoise(np.concatenate([white, others], axis=2), visits)
        wanted -= len(white)
        if wanted == 0:
            return
