"""Least squares for every method that is linear in offset and matrix, for many units at once.

Each axis i has its own regression on the truth: mean_i = offset_i + Σ_j matrix_ij · true_j (+ nuisance), with the
coefficients the method does not estimate kept at those of a perfect sensor.
"""

from dataclasses import dataclass

import numpy as np

from station.domain import coefficients, linear_algebra
from station.domain.calibrate import _outliers
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
    """Regression of one axis: G (u, k, v) estimate = G · reading; H (u, v, v) fitted = H · reading; r (u, v)
    residual; b (u, k)."""

    G: Floats
    H: Floats
    r: Floats
    b: Floats


def solve(problem: Problem, columns: tuple[tuple[int, ...], ...], *, weighted: bool) -> Fit:
    """Fits `columns` of each axis; stops that do not fit with the rest are left out and marked.

    weighted: weights are inverse variances of noise and declared pose error; otherwise all stops count alike.
    """
    noise, pose = variances(problem)
    if not weighted:
        # Plain least squares spreads every error over all residuals of its axis.
        noise, pose = (np.broadcast_to(part.mean(axis=1, keepdims=True), part.shape) for part in (noise, pose))
    variance = noise + pose * problem.visits_of_pose()[:, None] + problem.scatter()[..., None]
    keep = np.ones(variance.shape[:2])
    for _ in range(max(len(problem.pose) // 4, 1)):
        axes = _regressions(problem, columns, variance, keep, weighted)
        worst = _outliers.worst(
            _residuals(axes), np.stack([a.H for a in axes], axis=1), variance, keep, _parameters(columns, problem)
        )
        if not worst.any():
            break
        keep = np.where(worst, 0.0, keep)
    return _fit(problem, columns, axes, (noise, pose), keep)


def variances(problem: Problem) -> tuple[Floats, Floats]:
    """Variances (u, v, 3) of a mean about the model: by noise, and by the declared error of its pose.

    A pose turned by δ about each axis moves the truth t by δ × t: variance δ²(|t|² − t_i²) on axis i.
    """
    noise = np.einsum("uvii->uvi", problem.cov)
    across = problem.magnitude[..., None] ** 2 - problem.true**2
    # Readings without any noise still count alike.
    scale = np.maximum(problem.magnitude.max(axis=1), 1e-12)[:, None, None]
    return np.maximum(noise, (1e-9 * scale) ** 2), problem.pose_std_rad**2 * np.maximum(across, 0.0)


def _regressions(
    problem: Problem, columns: tuple[tuple[int, ...], ...], variance: Floats, keep: Floats, weighted: bool
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
    return _Axis(G / scale.transpose(0, 2, 1), Z @ G, r, b / scale[:, 0])


def _residuals(axes: tuple[_Axis, _Axis, _Axis]) -> Floats:
    return np.stack([a.r for a in axes], axis=2)


def _leverages(axes: tuple[_Axis, _Axis, _Axis]) -> Floats:
    return np.stack([np.einsum("uvv->uv", a.H) for a in axes], axis=2)


def _parameters(columns: tuple[tuple[int, ...], ...], problem: Problem) -> int:
    return sum(len(c) for c in columns) + 3 * int(problem.nuisance.shape[1])


def _fit(
    problem: Problem,
    columns: tuple[tuple[int, ...], ...],
    axes: tuple[_Axis, _Axis, _Axis],
    variance: tuple[Floats, Floats],
    keep: Floats,
) -> Fit:
    u, v = keep.shape
    theta = np.tile(coefficients.NOMINAL, (u, 1))
    jacobian = np.zeros((u, 12, v, 3))
    free = np.zeros(12, bool)
    for i, axis in enumerate(axes):
        at = [i if c == 0 else 2 + 3 * i + c for c in columns[i]]
        theta[:, at] = axis.b[:, : len(at)]
        jacobian[:, at, :, i] = axis.G[:, : len(at)].transpose(1, 0, 2)
        free[at] = True
    residual, leverage = _residuals(axes), np.minimum(_leverages(axes), 1.0)
    tilt, tilt_std = _tilts(problem, theta, residual, leverage)
    return Fit(
        theta=theta,
        jacobian=jacobian,
        free=free,
        residual=residual,
        tilt_rad=tilt,
        tilt_std_rad=tilt_std,
        disturbed=keep == 0,
        misfit=residual,
        noise=variance[0],
        pose_variance=variance[1],
        parameters=_parameters(columns, problem),
        pose_std_rad=np.zeros(u),
        notes=((),) * u,
    )


def _tilts(problem: Problem, theta: Floats, residual: Floats, leverage: Floats) -> tuple[Floats, Floats]:
    """Angle between nominal and found direction, and its standard deviation, each (u, v).

    A linear fit takes part of every tilt into its coefficients: the share `leverage` of it is missing from the
    residual, and stands, as large as the residuals of all stops make likely, in the standard deviation.
    """
    matrix = coefficients.matrix_of(theta)[:, None]
    size = np.maximum(problem.magnitude, 1e-300)
    off = linear_algebra.solve(matrix, residual[..., None])[..., 0] / size[..., None]
    along = problem.true / size[..., None]
    across = off - along * (along * off).sum(axis=2, keepdims=True)
    tilt = np.arctan2(np.linalg.norm(across, axis=2), 1 + (along * off).sum(axis=2))
    still = 1 - leverage
    noise = (still * np.einsum("uvii->uvi", problem.cov)).mean(axis=2) / size**2
    scatter = (across**2).sum(axis=(1, 2)) / np.maximum(still.mean(axis=2).sum(axis=1), 1e-9)
    return tilt, np.sqrt(noise + leverage.mean(axis=2) * scatter[:, None] / 2)
