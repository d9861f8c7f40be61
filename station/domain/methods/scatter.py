"""What visits differ by beyond their noise: loose poses, slow drift, a bent response. Estimated, then weighted with.

Two levels, each a variance of its own: between poses (visits of one pose share it) and between visits of one pose. Each
is what makes χ² equal to its degrees of freedom (Paule & Mandel 1982, J. Res. NBS 87, 377), and is taken up only where
chance would hardly make residuals that large; dwells that differ in length then no longer count by noise alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.methods.method import Fit, FitProblem, Method

#: Residuals are larger than noise explains when chance would do it this rarely.
LEVEL = 1e-3
#: Visits looked at together: enough to be fast, few enough for a processor's cache.
PORTION = 6144
#: Rounds of estimating the scatter and fitting with it.
ROUNDS = 4
#: A pattern of misfit smaller than this, in the recipe's unit, is rounding.
NEGLIGIBLE_PATTERN = 1e-9
#: Visits of one pose of which a pattern, of size 1 in all, says less than this different are the same to it.
EQUAL = 1e-6
#: Newton steps on χ²(τ²) = ν, which is convex and falls: it arrives from below.
STEPS = 60
#: χ² has arrived at ν when it is above it by no more than this share.
CONVERGED = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LackOfFit:
    """Squared misfits (u, n) of pose means and of visits about them, their variances (u, n), degrees of freedom (u).

    Of the pose means also the misfits (u, n) themselves, their variances (u, n) without errors of poses, and whether
    any visit of the pose counts (u, n).
    """

    between: Floats
    of_between: Floats
    dof_between: Floats
    within: Floats
    of_within: Floats
    dof_within: Floats
    mean: Floats
    of_mean: Floats
    observed: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SolvedUnits:
    """Units (n) that were solved in one go: which ones, and in which rows they stand of the problem, which knows the
    scatter that was found, and of the fit."""

    units: NDArray[np.intp]
    rows: NDArray[np.intp]
    problem: FitProblem
    fit: Fit


def solve(method: Method, problem: FitProblem) -> Iterator[SolvedUnits]:
    """All units, in parts: those without scatter portion by portion, then together those that need a closer look."""
    rest, units = [], max(PORTION // len(problem.pose), 1)
    for first in range(0, len(problem.mean), units):
        own = problem.take(slice(first, first + units))
        fit = method.together(own)
        consistent = np.zeros(len(own.mean), bool) if fit is None else fit.consistent
        rest.append(first + np.flatnonzero(~consistent))
        if fit is not None and consistent.any():
            rows = np.flatnonzero(consistent)
            yield SolvedUnits(first + rows, rows, own, fit)
    if len(others := np.concatenate(rest)):
        few = problem.take(others)
        yield SolvedUnits(others, np.arange(len(others)), *_with_scatter(method, few, method.fit(few)))


def _with_scatter(method: Method, problem: FitProblem, fit: Fit) -> tuple[FitProblem, Fit]:
    """Estimates the scatter and fits with it in turn, until it stays."""
    repeated, visit = int(problem.visits_of_pose().max()) > 1, np.zeros(len(problem.mean))
    for _ in range(ROUNDS):
        if repeated:
            visit = estimate(replace(problem, scatter_visit=np.zeros(len(problem.mean))), fit, "within")
        pose = estimate(replace(problem, scatter_visit=visit), fit, "between")
        by = np.abs(pose - problem.scatter_pose) + np.abs(visit - problem.scatter_visit)
        moved = by > 1e-3 * (pose + visit)
        if not moved.any():
            break
        # Those that stay keep what they have, so that their bits do not depend on how long their neighbours move.
        pose, visit = np.where(moved, pose, problem.scatter_pose), np.where(moved, visit, problem.scatter_visit)
        problem, rows = replace(problem, scatter_pose=pose, scatter_visit=visit), np.flatnonzero(moved)
        fit = fit.with_units(rows, method.fit(problem.take(rows)))
    return problem, fit


def estimate(problem: FitProblem, fit: Fit, level: Literal["between", "within"]) -> Floats:
    """Variance (u) of the scatter between poses or within them: 0 unless noise cannot explain the misfit."""
    found = lack_of_fit(problem, fit)
    square, variance, dof = (getattr(found, name) for name in (level, f"of_{level}", f"dof_{level}"))
    chi2 = (square / variance).sum(axis=1)
    significant = (dof > 0) & (scipy.special.chdtrc(np.maximum(dof, 1), chi2) < LEVEL)
    out = np.zeros(len(significant))
    if significant.any():
        out[significant] = _paule_mandel(square[significant], variance[significant], dof[significant])
    return out


def lack_of_fit(problem: FitProblem, fit: Fit) -> LackOfFit:
    """Misfits of poses, whose variance is that of their mean plus the declared pose error, and of visits about them.

    Scatter of visits already in the problem counts as noise; scatter of poses does not, for it is what is asked.
    """
    u, _, a = fit.misfit.shape
    keep = np.where(fit.disturbed, 0.0, 1.0)[..., None]
    noise = fit.noise + problem.scatter_visit[:, None, None]
    group = (problem.pose[:, None] == np.arange(problem.pose.max() + 1)).astype(float)
    weight = (keep / noise).transpose(0, 2, 1) @ group
    observed = weight > 0
    of_mean = np.where(observed, 1 / np.where(observed, weight, 1.0), 1.0)
    misfit = _unexplained(fit)
    mean = ((keep * misfit / noise).transpose(0, 2, 1) @ group) * of_mean
    declared = (keep * fit.pose_variance).transpose(0, 2, 1) @ group / np.maximum(keep[..., 0] @ group, 1)[:, None]
    about = (misfit - (mean @ group.T).transpose(0, 2, 1)) * keep
    poses, visits = observed[:, 0].sum(axis=1), keep.sum(axis=(1, 2))
    apart = _differing(fit.explained, group)
    return LackOfFit(
        between=(mean**2).reshape(u, -1),
        of_between=(of_mean + declared).reshape(u, -1),
        dof_between=a * poses - float(fit.parameters) - (len(fit.explained) - apart),
        within=(about**2).reshape(u, -1),
        of_within=noise.reshape(u, -1),
        dof_within=a * (visits - poses).astype(float) - apart,
        mean=mean.reshape(u, -1),
        of_mean=of_mean.reshape(u, -1),
        observed=observed.reshape(u, -1),
    )


def basis(explained: Floats) -> Floats:
    """Orthonormal patterns (k', v, a) that span those of misfit (k, v, a), rounding errors apart."""
    if not len(explained):
        return explained
    flat = explained.reshape(len(explained), -1)
    _, size, rows = np.linalg.svd(flat, full_matrices=False)
    rank = int((size > NEGLIGIBLE_PATTERN).sum())
    return np.asarray(rows[:rank].reshape(rank, *explained.shape[1:]))


def _differing(explained: Floats, group: Floats) -> int:
    """How many of the explained patterns (k, v, a) are of visits of one pose that differ. group (v, p): of which."""
    if not len(explained) or group.shape[1] == len(group):
        return 0
    within = np.eye(len(group)) - (group / group.sum(axis=0)) @ group.T
    about = np.einsum("vw,kwa->kva", within, explained).reshape(len(explained), -1)
    return int((np.linalg.svd(about, compute_uv=False) > EQUAL).sum())


def _unexplained(fit: Fit) -> Floats:
    """The misfit (u, v, a) without what stated errors shared by all visits make of it."""
    if not len(fit.explained):
        return fit.misfit
    basis = fit.explained.reshape(len(fit.explained), -1)
    flat = fit.misfit.reshape(len(fit.misfit), -1)
    return np.asarray((flat - flat @ basis.T @ basis).reshape(fit.misfit.shape))


def _paule_mandel(square: Floats, variance: Floats, dof: Floats) -> Floats:
    """τ² (u) with Σ square/(variance + τ²) = dof, by Newton's steps from 0."""
    tau2 = np.zeros(len(square))
    for _ in range(STEPS):
        spread = variance + tau2[:, None]
        over = (square / spread).sum(axis=1) - dof
        # Each unit stops by itself, so that its bits do not depend on its neighbours.
        open_ = over > CONVERGED * dof
        if not open_.any():
            break
        slope = (square / spread**2).sum(axis=1)
        tau2 = tau2 + np.where(open_, over / np.maximum(slope, 1e-300), 0.0)
    return tau2
