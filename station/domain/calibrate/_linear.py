"""Least squares for every method that is linear in offset and matrix, for many units at once.

Each axis i has its own regression on the truth: mean_i = offset_i + Σ_j matrix_ij · true_j (+ nuisance), with the
coefficients the method does not estimate kept at those of a perfect sensor.
"""

from dataclasses import dataclass

import numpy as np

from station.domain import coefficients, linear_algebra
from station.domain.calibrate import _even, _outliers
from station.domain.calibrate._even import Columns
from station.domain.method import Fit, Problem
from station.domain.types import Floats

#: Columns of the regression of each axis: 0 is the offset, 1 + j the gain of true_j.
OFFSET_ONLY = ((0,), (0,), (0,))
OFFSET_GAIN = ((0, 1), (0, 2), (0, 3))
MATRIX = ((0, 1, 2, 3),) * 3
#: What each column of a full regression determines, for all three axes together.
MATRIX_NAMES = ("offset x, y, z", *(f"gain {a} and cross-axis from {a}" for a in "xyz"))


@dataclass(frozen=True, slots=True, eq=False)
class _Axis:
    """Regression of one axis: G (u, k, v) estimate = G · reading; hat: fitted = hat · reading; r (u, v) residual;
    b (u, k)."""

    G: Floats
    hat: _outliers.Hat
    r: Floats
    b: Floats


def solve(problem: Problem, columns: Columns, *, weighted: bool) -> Fit:
    """Fits `columns` of each axis; stops that do not fit with the rest are left out and marked.

    weighted: weights are inverse variances of noise and declared pose error; otherwise all stops count alike.
    """
    noise, pose = variances(problem)
    even = (noise == noise[:, :1]).reshape(len(noise), -1).all(axis=1)
    if problem.pose_std_rad > 0:
        even &= (pose == pose[:, :1]).all(axis=(1, 2))
    if not weighted:
        # Plain least squares spreads every error over all residuals of its axis.
        noise, pose = (np.broadcast_to(part.mean(axis=1, keepdims=True), part.shape) for part in (noise, pose))
        even[:] = True
    even &= (problem.scatter_pose == 0) & (problem.scatter_stop == 0)
    if problem.nuisance.shape[1] or not _one_truth(problem) or not _all_poses_differ(problem):
        even[:] = False
    if not even.any():
        return _at_length(problem, columns, (noise, pose), weighted=weighted)
    fit = _even.fit(problem, columns, (noise[:, :1], pose[:, :1]), even)
    rest = np.flatnonzero(~fit.calm)
    if not len(rest):
        return fit
    longer = _at_length(problem.take(rest), columns, (noise[rest], pose[rest]), weighted=weighted)
    return fit.with_units(rest, longer)


def _one_truth(problem: Problem) -> bool:
    return len(problem.true) == 1 or problem.true.strides[0] == 0


def _all_poses_differ(problem: Problem) -> bool:
    return int(problem.pose.max()) + 1 == len(problem.pose)


def _at_length(problem: Problem, columns: Columns, parts: tuple[Floats, Floats], *, weighted: bool) -> Fit:
    """Every unit with a regression of its own; parts: variances by noise and by declared pose error."""
    noise, pose = parts
    variance = noise + pose * problem.visits_of_pose()[:, None] + problem.scatter()[..., None]
    keep = np.ones(variance.shape[:2])
    for _ in range(max(len(problem.pose) // 4, 1)):
        axes = _regressions(problem, columns, variance, keep, weighted)
        worst = _outliers.worst(_residuals(axes), [a.hat for a in axes], variance, keep, _parameters(columns, problem))
        if not worst.any():
            break
        keep = np.where(worst, 0.0, keep)
    return _fit(problem, columns, axes, (noise, pose), keep)


def variances(problem: Problem) -> tuple[Floats, Floats]:
    """Variances (u, v, 3) of a mean about the model: by noise, and by the declared error of its pose.

    A pose turned by δ about each axis moves the truth t by δ × t: variance δ²(|t|² − t_i²) on axis i.
    """
    # Readings without any noise still count alike.
    scale = np.maximum(problem.magnitude.max(axis=1), 1e-12)[:, None, None]
    noise = np.maximum(np.einsum("uvii->uvi", problem.cov), (1e-9 * scale) ** 2)
    if problem.pose_std_rad == 0:
        return noise, np.broadcast_to(0.0, noise.shape)
    across = problem.magnitude[..., None] ** 2 - problem.true**2
    return noise, problem.pose_std_rad**2 * np.maximum(across, 0.0)


def _regressions(
    problem: Problem, columns: Columns, variance: Floats, keep: Floats, weighted: bool
) -> tuple[_Axis, _Axis, _Axis]:
    u, v = keep.shape
    T = np.concatenate([np.ones((u, v, 1)), problem.true], axis=2)
    more = np.broadcast_to(problem.nuisance, (u, *problem.nuisance.shape))
    out = []
    for i in range(3):
        weight = keep / variance[..., i] if weighted else keep
        X = np.concatenate([T[..., list(columns[i])], more], axis=2)
        fixed = 0.0 if 1 + i in columns[i] else problem.true[..., i]
        out.append(_regression(X, problem.mean[..., i] - fixed, weight))
    return out[0], out[1], out[2]


def _regression(X: Floats, y: Floats, weight: Floats) -> _Axis:
    """Weighted least squares of y (u, v) on X (u, v, k)."""
    scale = np.sqrt((X**2).mean(axis=1, keepdims=True))
    Z = X / np.where(scale > 0, scale, 1.0)
    ZW = (Z * weight[..., None]).transpose(0, 2, 1)
    G = linear_algebra.solve(ZW @ Z, ZW)
    b = (G @ y[..., None])[..., 0]
    r = y - (Z @ b[..., None])[..., 0]
    return _Axis(G / scale.transpose(0, 2, 1), _outliers.Hat(Z, G), r, b / scale[:, 0])


def _residuals(axes: tuple[_Axis, _Axis, _Axis]) -> Floats:
    return np.stack([a.r for a in axes], axis=2)


def _parameters(columns: Columns, problem: Problem) -> int:
    return sum(len(c) for c in columns) + 3 * int(problem.nuisance.shape[1])


def _fit(
    problem: Problem,
    columns: Columns,
    axes: tuple[_Axis, _Axis, _Axis],
    variance: tuple[Floats, Floats],
    keep: Floats,
) -> Fit:
    u, v = keep.shape
    theta = np.tile(coefficients.NOMINAL, (u, 1))
    jacobian = np.zeros((u, 12, v, 3))
    free = np.zeros(12, bool)
    for i, axis in enumerate(axes):
        at = _even.coefficients_of(i, columns[i])
        theta[:, at] = axis.b[:, : len(at)]
        jacobian[:, at, :, i] = axis.G[:, : len(at)].transpose(1, 0, 2)
        free[at] = True
    residual = _residuals(axes)
    return Fit(
        theta=theta,
        jacobian=jacobian,
        free=free,
        residual=residual,
        tilt=None,
        disturbed=keep == 0,
        misfit=residual,
        noise=variance[0],
        pose_variance=variance[1],
        parameters=_parameters(columns, problem),
        calm=np.zeros(u, bool),
        pose_std_rad=np.zeros(u),
        notes=((),) * u,
    )
