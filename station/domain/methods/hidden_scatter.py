"""Scatter along the stimulus that no residual shows, bounded by the stated errors of poses.

An error of a pose moves the reading across the stimulus and not the one along it. Of six faces, each visited once, a
gain is what the two readings along its axis say, and no combination of readings feels anything else of them but
together with readings across, among whose errors of poses it is lost. Residuals rule out scatter above those errors;
below them nothing is known, and it is taken to be as large: a bound (JCGM 100, 4.3.1), no estimate.
"""

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods import coverage
from station.domain.methods.method import FitProblem
from station.domain.recipe import assumptions
from station.domain.recipe.recipe import Recipe

#: Variance (u, v, 3) of readings by one kind of scatter, and its degrees of freedom (u).
Kind = tuple[Floats, Floats]


def bound(recipe: Recipe, problem: FitProblem, pose_std_rad: Floats) -> Kind:
    """By errors of poses of pose_std_rad (u) about each axis: along the stimulus as much as they make across it."""
    u, v, _ = problem.mean.shape
    dof = np.full(u, coverage.MANY)
    poses = np.unique(problem.pose, return_index=True)[1]
    if len(poses) < v or not assumptions.hides_scatter(recipe, problem.true[0, poses]):
        return np.zeros((u, v, 3)), dof
    return np.asarray((pose_std_rad[:, None, None] * problem.true) ** 2), dof
