"""The short way through a linear fit: units with one truth whose visits all count alike share one solution.

Which units are sound enough for it is asked of each unit by itself, so that a unit takes the same way alone as among
many. The tests are those of the long way (a visit that does not fit, scatter), asked of the whole unit at once.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core import linear_algebra
from station.domain.core.types import Floats
from station.domain.methods import coefficients, scatter
from station.domain.methods.calibrate import _outliers
from station.domain.methods.method import Fit, FitProblem

Columns = tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True, eq=False)
class SharedSolution:
    """What one truth comes to: T (v, 4) = [1, truth]; jacobian (12, v, 3); ideal (12) coefficients of a perfect sensor
    that are not fitted, else 0; free (12) bool; spread (v, 3) = 1/(1 − leverage), 0 where the others say nothing."""

    T: Floats
    jacobian: Floats
    ideal: Floats
    free: NDArray[np.bool_]
    spread: Floats


def fit(
    problem: FitProblem,
    columns: Columns,
    variance: tuple[Floats, Floats],
    explained: Floats,
    even: NDArray[np.bool_],
) -> Fit:
    """The fit of all units as if their visits counted equally; `consistent`: which of the `even` ones (u) it holds for.

    variance: of a mean by noise and by the declared error of its pose, each (u, 1, 3); explained (k, v, 3): see
    explained_residuals.
    """
    v = len(problem.pose)
    shared = shared_solution(np.ascontiguousarray(problem.true[0]).tobytes(), v, columns)
    theta = shared.ideal + _times(shared.jacobian.reshape(12, -1), problem.mean - _readings(shared, shared.ideal))
    residual = problem.mean - _readings(shared, theta)
    chi2, drop = _misfit(residual**2, shared.spread, variance[0] + variance[1], explained)
    parameters = sum(map(len, columns))
    consistent = even & (chi2 <= chi2_limit(3 * v - parameters)) & (drop < outlier_limit(v))
    return replace(_fit(shared, theta, residual, variance, parameters, consistent), explained=scatter.basis(explained))


def _misfit(square: Floats, spread: Floats, variance: Floats, explained: Floats) -> tuple[Floats, Floats]:
    """χ² (u), and the largest drop (u) of it when a stop is left out."""
    if len(explained):
        of_axis = square / (variance + (explained**2).sum(axis=0))
        return of_axis.sum(axis=(1, 2)), (of_axis * spread).sum(axis=2).max(axis=1)
    weight = 1 / variance.reshape(-1, 3, 1)
    return (square @ weight).sum(axis=(1, 2)), ((square * spread) @ weight).max(axis=(1, 2))


@lru_cache(maxsize=64)
def explained_residuals(patterns: bytes, truth: bytes, v: int, columns: Columns) -> Floats:
    """Residuals (k, v, 3) that errors of the truth with these patterns (k, v, 3) leave of a perfect sensor."""
    true, errors = np.frombuffer(truth).reshape(v, 3), np.frombuffer(patterns).reshape(-1, v, 3)
    T, out = np.column_stack([np.ones(v), true]), np.zeros_like(errors)
    for i, own in enumerate(columns):
        X = T[:, list(own)]
        out[:, :, i] = (errors[:, :, i].T - X @ linear_algebra.solve(X.T @ X, X.T @ errors[:, :, i].T)).T
    return out


@lru_cache(maxsize=64)
def outlier_limit(visits: int) -> float:
    """Drop in χ² beyond which one of so many visits does not fit with the others."""
    return float(scipy.special.chdtri(3, _outliers.LEVEL / visits))


@lru_cache(maxsize=64)
def chi2_limit(dof: int) -> float:
    """χ² beyond which residuals are larger than noise explains."""
    return float(scipy.special.chdtri(dof, _outliers.LEVEL)) if dof > 0 else float("inf")


@lru_cache(maxsize=64)
def shared_solution(truth: bytes, v: int, columns: Columns) -> SharedSolution:
    """Shared parts for the truth (v, 3) with these bytes."""
    true = np.frombuffer(truth).reshape(v, 3)
    T = np.column_stack([np.ones(v), true])
    jacobian, free, leverage = np.zeros((12, v, 3)), np.zeros(12, bool), np.zeros((v, 3))
    for i, own in enumerate(columns):
        at = coefficients_of(i, own)
        X = T[:, list(own)]
        G = linear_algebra.solve(X.T @ X, X.T)
        jacobian[at, :, i] = G
        free[at] = True
        leverage[:, i] = (X * G.T).sum(axis=1)
    alone = leverage > _outliers.FULL_LEVERAGE
    spread = np.where(alone, 0.0, 1 / np.where(alone, 1.0, 1 - leverage))
    return SharedSolution(T, jacobian, np.where(free, 0.0, coefficients.NOMINAL), free, spread)


def coefficients_of(axis: int, columns: tuple[int, ...]) -> list[int]:
    """Which of the twelve the columns of an axis' regression are."""
    return [axis if c == 0 else 2 + 3 * axis + c for c in columns]


def _times(J: Floats, readings: Floats) -> Floats:
    """J (12, 3v) times readings (u, v, 3), unit by unit: (u, 12)."""
    return np.asarray((J @ readings.reshape(len(readings), -1, 1))[..., 0])


def _readings(shared: SharedSolution, theta: Floats) -> Floats:
    """What units with coefficients (…, 12) read: (…, v, 3)."""
    by_column = np.concatenate([theta[..., None, :3], np.swapaxes(coefficients.matrix_of(theta), -1, -2)], axis=-2)
    return np.asarray(shared.T @ by_column)


def _fit(
    shared: SharedSolution,
    theta: Floats,
    residual: Floats,
    variance: tuple[Floats, Floats],
    parameters: int,
    consistent: NDArray[np.bool_],
) -> Fit:
    u, v, _ = residual.shape
    return Fit(
        theta=theta,
        jacobian=np.broadcast_to(shared.jacobian, (u, 12, v, 3)),
        free=shared.free,
        residual=residual,
        tilt=None,
        disturbed=np.broadcast_to(np.zeros(1, bool), (u, v)),
        misfit=residual,
        noise=np.broadcast_to(variance[0], residual.shape),
        pose_variance=np.broadcast_to(variance[1], residual.shape),
        parameters=parameters,
        explained=np.zeros((0, v, 3)),
        consistent=consistent,
        pose_std_rad=np.zeros(u),
        pose_dof=np.ones(u),
        notes=((),) * u,
    )
