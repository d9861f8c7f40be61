"""Offsets that differ from run to run, as stated: the budget counts them by themselves, so residuals that they explain
are no scatter. Coefficients are not fitted anew."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from station.domain.core.types import Floats, ReducedVisits
from station.domain.methods import contributions, scatter
from station.domain.methods.method import Fit, FitProblem
from station.domain.recipe.recipe import Recipe


def without_offsets_of_runs(
    recipe: Recipe, problem: FitProblem, fit: Fit, visits: ReducedVisits
) -> tuple[FitProblem, Fit]:
    """Problem and fit, their scatter without what stated offsets of runs make of it. visits: of one of the units."""
    if not recipe.device.turn_on_std or not problem.pose_known or len(np.unique(visits.run)) < 2:
        return problem, fit
    keep, misfit, felt = ~fit.disturbed, fit.misfit.copy(), contributions.offsets_of_runs(visits)
    more = np.zeros((len(felt), *misfit.shape[1:]))
    for axis, (columns, runs) in enumerate(_designs(problem, fit, felt)):
        # The fit weighed by a scatter that holds these offsets; here all visits count alike.
        both = np.column_stack([columns, runs.T])
        found = np.linalg.pinv(keep[..., None] * both) @ (keep * misfit[..., axis])[..., None]
        misfit[..., axis] = keep * (misfit[..., axis] - (both @ found)[..., 0])
        more[..., axis] = runs - runs @ (columns @ np.linalg.pinv(columns)).T
    fit = replace(fit, misfit=misfit, explained=scatter.basis(np.concatenate([fit.explained, more])))
    nothing = np.zeros(len(fit.theta))
    alone = replace(problem, scatter_pose=nothing, scatter_visit=nothing)
    known = replace(alone, scatter_visit=scatter.estimate(alone, fit, "within"))
    return replace(known, scatter_pose=scatter.estimate(known, fit, "between")), fit


def _designs(problem: FitProblem, fit: Fit, felt: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Of each kind of misfit the columns (v, c) that coefficients make of it, and patterns (k, v) that errors of
    readings (k, v, 3) do. A fit of magnitudes feels what lies along the stimulus."""
    if fit.tilt is not None:
        t = problem.true[0] / problem.magnitude[0][:, None]
        squares = t[:, :, None] * t[:, None, :]
        yield np.column_stack([t, squares[:, *np.triu_indices(3)]]), (felt * t).sum(axis=2)
        return
    T = np.column_stack([np.ones(len(problem.pose)), problem.true[0]])
    for axis in range(fit.misfit.shape[2]):
        fitted = np.flatnonzero(np.r_[fit.free[axis], fit.free[3 + 3 * axis : 6 + 3 * axis]])
        yield np.column_stack([T[:, fitted], problem.nuisance]), felt[..., axis]
