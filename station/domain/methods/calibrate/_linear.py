"""Least squares for every method that is linear in offset and matrix, for many units at once.

Each axis i has its own regression on the truth: mean_i = offset_i + Σ_j matrix_ij · true_j (+ nuisance), with the
coefficients the method does not estimate kept at those of a perfect sensor.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core import linear_algebra
from station.domain.core.types import Floats
from station.domain.methods import coefficients, scatter
from station.domain.methods.calibrate import _outliers, _shared_fit
from station.domain.methods.calibrate._shared_fit import Columns
from station.domain.methods.method import Fit, FitProblem, same_at_all_visits

#: Columns of the regression of each axis: 0 is the offset, 1 + j the gain of true_j.
OFFSET_ONLY = ((0,), (0,), (0,))
OFFSET_GAIN = ((0, 1), (0, 2), (0, 3))
MATRIX = ((0, 1, 2, 3),) * 3
COLUMNS_OF_MODEL = {"matrix": MATRIX, "offset-gain": OFFSET_GAIN}


def matrix_names(axes: int) -> tuple[str, ...]:
    """What each column of a full regression determines, for all axes together."""
    there = "xyz"[:axes]
    return (f"offset {', '.join(there)}", *(f"gain {a} and cross-axis from {a}" for a in there))


@dataclass(frozen=True, slots=True, eq=False)
class _Regressions:
    """Those of the three axes: G (u, a, k, v) estimate = G · reading, a = 1 where all axes share it, else 3;
    hat: fitted = hat · reading; r (u, v, 3) residual; b (u, 3, k)."""

    G: Floats
    hat: _outliers.HatMatrix
    r: Floats
    b: Floats


def fit_shared(problem: FitProblem, columns: Columns, *, weighted: bool) -> Fit | None:
    """The short way (`_shared_fit`), right for units that it calls consistent; None where for none."""
    if problem.nuisance.shape[1] or problem.axes < 3 or not _one_truth(problem) or not _all_poses_differ(problem):
        return None
    variance, even = _variances_of_first_visit(problem) if weighted else _mean_variances(problem)
    even &= (problem.scatter_pose == 0) & (problem.scatter_visit == 0)
    if not even.any():
        return None
    return _shared_fit.fit(problem, columns, variance, _explained(problem, columns), even)


def solve(problem: FitProblem, columns: Columns, *, weighted: bool) -> Fit:
    """Fits `columns` of each axis, every unit by itself; visits that do not fit with the rest are left out and marked.

    weighted: weights are inverse variances of noise and declared pose error; otherwise all visits count alike.
    """
    noise, pose = variances(problem)
    columns = _of_axes(columns, problem.axes)
    if not weighted:
        noise, pose = _spread(noise), _spread(pose)
    variance = noise + pose * problem.visits_of_pose()[:, None] + problem.scatter()[..., None]
    explained = _explained(problem, columns)
    tested = variance + (explained**2).sum(axis=0) if len(explained) else variance
    keep = np.ones(variance.shape[:2])
    for _ in range(max(len(problem.pose) // 4, 1)):
        axes = _regressions(problem, columns, variance, keep, weighted)
        worst = _outliers.worst_visit(axes.r, axes.hat, tested, keep, _parameters(columns, problem))
        if not worst.any():
            break
        keep = np.where(worst, 0.0, keep)
    fit = _fit(problem, columns, axes, (noise, pose), keep)
    return replace(fit, explained=scatter.basis(explained[..., : problem.axes]))


def _of_axes(columns: Columns, axes: int) -> Columns:
    """The columns of a device of so many axes; one that is not there and reads 0 goes along with the first."""
    there = tuple(tuple(c for c in own if c <= axes) for own in columns[:axes])
    return (*there, *there[:1] * (3 - axes))


def _explained(problem: FitProblem, columns: Columns) -> Floats:
    """Residuals (k, v, 3) that stated errors shared by all visits make."""
    if not len(problem.patterns):
        return problem.patterns
    truth = np.ascontiguousarray(problem.true[0]).tobytes()
    patterns = np.ascontiguousarray(problem.patterns).tobytes()
    return _shared_fit.explained_residuals(patterns, truth, len(problem.pose), columns)


def _variances_of_first_visit(problem: FitProblem) -> tuple[tuple[Floats, Floats], NDArray[np.bool_]]:
    """Variances (u, 1, 3) of each unit's first mean, and whether those of the others are the same (u)."""
    if problem.pose_std_rad == 0 and same_at_all_visits(problem.cov).all():
        return variances(problem, slice(1)), np.ones(len(problem.mean), bool)
    noise, pose = variances(problem)
    even = same_at_all_visits(noise) & same_at_all_visits(pose)
    return (noise[:, :1], pose[:, :1]), even


def _mean_variances(problem: FitProblem) -> tuple[tuple[Floats, Floats], NDArray[np.bool_]]:
    """Mean variances (u, 1, 3): plain least squares spreads every error over all residuals of its axis."""
    noise, pose = variances(problem)
    return (_spread(noise)[:, :1], _spread(pose)[:, :1]), np.ones(len(problem.mean), bool)


def _spread(variance: Floats) -> Floats:
    if not variance.strides[1]:
        return variance
    return np.broadcast_to(variance.mean(axis=1, keepdims=True), variance.shape)


def _one_truth(problem: FitProblem) -> bool:
    return len(problem.true) == 1 or problem.true.strides[0] == 0


def _all_poses_differ(problem: FitProblem) -> bool:
    return int(problem.pose.max()) + 1 == len(problem.pose)


def variances(problem: FitProblem, visits: slice = slice(None)) -> tuple[Floats, Floats]:
    """Variances (u, v, 3) of some visits' means about the model: by noise, and by the declared error of their pose.

    A pose turned by δ about each axis moves the truth t by δ × t: variance δ²(|t|² − t_i²) on axis i.
    """
    # Readings without any noise still count alike.
    scale = np.maximum(problem.magnitude.max(axis=1), 1e-12)[:, None, None]
    noise = np.maximum(np.einsum("uvii->uvi", problem.cov[:, visits]), (1e-9 * scale) ** 2)
    if problem.pose_std_rad == 0:
        return noise, np.broadcast_to(0.0, noise.shape)
    if problem.turned is not None:
        across = (problem.turned[:, visits] ** 2).sum(axis=0)
        return noise, np.broadcast_to(problem.pose_std_rad**2 * across, noise.shape)
    square = problem.true[:, visits] ** 2
    across = problem.magnitude[:, visits, None] ** 2 - square
    # Along itself the truth is shortened by |φ|²/2, whose mean square is 2δ⁴.
    return noise, problem.pose_std_rad**2 * (np.maximum(across, 0.0) + 2 * problem.pose_std_rad**2 * square)


def _regressions(problem: FitProblem, columns: Columns, variance: Floats, keep: Floats, weighted: bool) -> _Regressions:
    """Weighted least squares of y (u, 3, v) on X (u, a, v, k)."""
    weight = (keep[..., None] / variance).transpose(0, 2, 1) if weighted else keep[:, None]
    X, y = _design(problem, columns), _readings(problem, columns)
    scale = np.sqrt((X**2).mean(axis=2, keepdims=True))
    Z = X / np.where(scale > 0, scale, 1.0)
    ZW = np.ascontiguousarray(Z * weight[..., None]).transpose(0, 1, 3, 2)
    G = linear_algebra.solve(ZW @ Z, ZW)
    b = G @ y[..., None]
    r = (y - (Z @ b)[..., 0]).transpose(0, 2, 1)
    own = G / scale.transpose(0, 1, 3, 2)
    return _Regressions(own, _outliers.HatMatrix(Z, G), np.ascontiguousarray(r), b[..., 0] / scale[:, :, 0])


def _design(problem: FitProblem, columns: Columns) -> Floats:
    """X (u, a, v, k): one for all axes where their columns are the same."""
    u, v = problem.mean.shape[:2]
    T = np.concatenate([np.ones((u, v, 1)), problem.true], axis=2)
    more = np.broadcast_to(problem.nuisance, (u, *problem.nuisance.shape))
    each = [np.concatenate([T[..., list(own)], more], axis=2) for own in dict.fromkeys(columns)]
    return np.stack(each, axis=1)


def _readings(problem: FitProblem, columns: Columns) -> Floats:
    """What is regressed (u, 3, v): readings without what a coefficient that is not fitted makes of the truth."""
    fixed = np.array([1 + i not in own for i, own in enumerate(columns)])
    return np.ascontiguousarray((problem.mean - np.where(fixed, problem.true, 0.0)).transpose(0, 2, 1))


def _parameters(columns: Columns, problem: FitProblem) -> int:
    return sum(len(c) for c in columns[: problem.axes]) + problem.axes * int(problem.nuisance.shape[1])


def _fit(
    problem: FitProblem,
    columns: Columns,
    axes: _Regressions,
    variance: tuple[Floats, Floats],
    keep: Floats,
) -> Fit:
    u, v = keep.shape
    theta = np.tile(coefficients.NOMINAL, (u, 1))
    jacobian = np.zeros((u, 12, v, 3))
    free = np.zeros(12, bool)
    for i, own in enumerate(columns[: problem.axes]):
        at = _shared_fit.coefficients_of(i, own)
        theta[:, at] = axes.b[:, i, : len(at)]
        jacobian[:, at, :, i] = axes.G[:, i % axes.G.shape[1], : len(at)].transpose(1, 0, 2)
        free[at] = True
    return Fit(
        theta=theta,
        jacobian=jacobian,
        free=free,
        residual=axes.r,
        tilt=None,
        disturbed=keep == 0,
        misfit=axes.r[..., : problem.axes],
        noise=variance[0][..., : problem.axes],
        pose_variance=variance[1][..., : problem.axes],
        parameters=_parameters(columns, problem),
        explained=np.zeros((0, v, 3)),
        consistent=np.zeros(u, bool),
        pose_std_rad=np.zeros(u),
        pose_dof=np.ones(u),
        notes=((),) * u,
    )
