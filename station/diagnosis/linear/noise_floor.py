"""The noise floor, estimated on the data at hand by restricted maximum likelihood.

V = σ²·D + τ_r²·T + τ_w²·K for the stops of one run: D white noise (1/samples), T a small random turn of each stop
(the positioner's repeatability, `repeatability`), K a random walk from stop to stop (`bias-walk`). T and K are made
of those causes' own signatures. The estimate is Newton's on the average information (Gilmour, Thompson, Cullis,
Biometrics 51 (1995) 1440, eq. 5), inside bounds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.linear.grid import VisitGrid
from station.diagnosis.linear.projection import (
    DataColumns,
    FloorCovariance,
    NuisanceColumns,
    ResidualSpace,
    residual_space,
)
from station.domain.core.types import Floats

#: Nats of log-likelihood below which a floor is not worth improving.
CONVERGED_NATS = 2e-5


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """noise: sd of the mean of a stop of average length, turn: rad a stop, walk: a stop; both in the recipe's unit."""

    noise: float
    turn: float
    walk: float

    @property
    def variances(self) -> Floats:
        """σ², τ_r², τ_w²."""
        return np.array([self.noise, self.turn, self.walk]) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class FloorStructure:
    """parts (classes, 3, m, m): D, T and K of each kind of run; pad (classes, m): 1 where there is no stop;
    member (U, R): the kind of each unit's run."""

    parts: Floats
    pad: Floats
    member: NDArray[np.intp]

    def covariance(self, variances: Floats) -> FloorCovariance:
        """The floor with the variances (3)."""
        V = np.einsum("i,cijk->cjk", variances, self.parts)
        V = V + np.eye(V.shape[1]) * self.pad[:, None, :]
        L = np.linalg.cholesky(V)
        logdet = 2 * np.log(np.einsum("cii->ci", L)).sum(1)
        live = self.pad[self.member].reshape(len(self.member), -1) == 0
        return FloorCovariance(np.linalg.inv(L), self.member, live, float(logdet[self.member].sum()))

    def relative(self, inverse: Floats) -> Floats:
        """The parts as whitened rows see them (classes, 3, m, m)."""
        return np.asarray(inverse[:, None] @ self.parts @ inverse[:, None].transpose(0, 1, 3, 2))


def floor_structure(grid: VisitGrid, weight: Floats, turn: Floats, steps: Floats, project: Floats) -> FloorStructure:
    """From, for each stop: weight (v) relative precision; turn (v, k, 3) signature of its turn; steps (v) taken by
    the walk so far; project (v, k, 3) from readings to the numbers kept."""
    U, R, V = grid.slot.shape
    k = grid.k
    rows = np.concatenate([turn, project, np.broadcast_to((1 / weight)[:, None, None], (*turn.shape[:2], 1))], axis=2)
    rows = np.concatenate([rows, np.broadcast_to(steps[:, None, None], (*turn.shape[:2], 1))], axis=2)
    kinds, member = np.unique(np.round(grid.spread(rows), 7).reshape(U * R, -1), axis=0, return_inverse=True)
    kinds = kinds.reshape(len(kinds), V, k, 8)
    parts = np.zeros((len(kinds), 3, V * k, V * k))
    at = np.arange(V * k).reshape(V, k)
    parts[:, 0, at, at] = kinds[..., 6]
    parts[:, 1, at[:, :, None], at[:, None, :]] = kinds[..., :3] @ kinds[..., :3].transpose(0, 1, 3, 2)
    walked = np.minimum(kinds[:, :, None, 0, 7], kinds[:, None, :, 0, 7])
    parts[:, 2] = np.einsum("cvw,cvia,cwja->cviwj", walked, kinds[..., 3:6], kinds[..., 3:6]).reshape(-1, V * k, V * k)
    return FloorStructure(parts, (parts[:, 0].diagonal(axis1=1, axis2=2) == 0).astype(float), member.reshape(U, R))


@dataclass(frozen=True, slots=True, eq=False)
class FittedFloor:
    """A floor with its structure and the space it makes."""

    floor: NoiseFloor
    space: ResidualSpace
    parts: FloorStructure

    @property
    def covariance(self) -> Floats:
        """Covariance (3, 3) of the variances σ², τ_r², τ_w²."""
        return np.asarray(np.linalg.pinv(_newton(self.parts, self.space)[1]), float)


def fit(
    parts: FloorStructure,
    known: NuisanceColumns,
    readings: DataColumns,
    count: int,
    upper: Floats,
    start: NoiseFloor | None = None,
    least: float = 0.0,
) -> FittedFloor:
    """The floor of `count` readings. upper (3): bounds of the variances, 0 for a part left out; least: the lower bound
    of the white one."""
    upper = np.where(np.abs(parts.parts).max(axis=(0, 2, 3)) > 0, upper, 0.0)
    free = upper > 0
    lower = np.array([least, 0.0, 0.0])
    var = np.clip(_initial_variances(parts, known, readings, count) if start is None else start.variances, lower, upper)
    now = residual_space(parts.covariance(var), known, readings, count)
    for _ in range(30):
        slope, information = _newton(parts, now)
        held = ~free | ((var <= lower) & (slope < 0)) | ((var >= upper) & (slope > 0))
        step = _step(slope, information, held)
        # What a step promises: half of the slope along it.
        if 0.5 * float(slope @ step) < CONVERGED_NATS:
            break
        last, (var, now) = now, _line_search(parts, known, readings, count, (lower, upper), var, now, step)
        if now.loglik - last.loglik < CONVERGED_NATS:
            break
    sigma = np.sqrt(var)
    return FittedFloor(NoiseFloor(*(float(s) for s in sigma)), now, parts)


def _initial_variances(parts: FloorStructure, known: NuisanceColumns, readings: DataColumns, count: int) -> Floats:
    """Where the search starts: mostly white noise."""
    flat = residual_space(parts.covariance(np.array([1.0, 0.0, 0.0])), known, readings, count)
    white = max(float(np.sum(flat.residual**2)) / max(flat.dof, 1), 1e-30)
    return white * np.array([0.8, 0.2, 0.02])


def _newton(parts: FloorStructure, now: ResidualSpace) -> tuple[Floats, Floats]:
    """Slope (3) and average information (3, 3) of the restricted log-likelihood by the variances."""
    relative = parts.relative(now.covariance.inverse)
    member = now.covariance.member
    U, R = member.shape
    m = relative.shape[-1]

    def act(i: int, rows: Floats) -> Floats:
        wide = rows[:, : R * m].reshape(U, R, m, -1)
        out = (relative[member, i] @ wide).reshape(U, R * m, -1)
        return np.asarray(np.pad(out, ((0, 0), (0, rows.shape[1] - R * m), (0, 0))))

    residual = now.residual[..., None]
    moved = np.stack([act(i, residual)[..., 0] for i in range(3)], axis=-1)
    free = now.free(moved)
    to_shared = now.shared_basis.reshape(residual.size, -1).T @ free.reshape(-1, 3)
    information = 0.5 * (moved.reshape(-1, 3).T @ free.reshape(-1, 3) - to_shared.T @ to_shared)
    trace = [float(np.einsum("cii->c", relative[:, i])[member].sum()) - _known_trace(now, act, i) for i in range(3)]
    return -0.5 * (np.array(trace) - np.einsum("umi,um->i", moved, residual[..., 0])), information


def _known_trace(now: ResidualSpace, act: Callable[[int, Floats], Floats], i: int) -> float:
    """The part of a trace that the known columns take up."""
    own = float(np.sum(now.basis * act(i, now.basis)))
    return own + float(np.sum(now.shared_basis * act(i, now.shared_basis)))


def _step(slope: Floats, information: Floats, held: NDArray[np.bool_]) -> Floats:
    """Newton's step in the variances that are not held."""
    step = np.zeros(3)
    go = ~held
    if go.any():
        scale = 1 / np.sqrt(np.maximum(np.diag(information)[go], 1e-300))
        normal = information[np.ix_(go, go)] * np.outer(scale, scale) + 1e-9 * np.eye(int(go.sum()))
        step[go] = scale * np.linalg.solve(normal, slope[go] * scale)
    return step


def _line_search(
    parts: FloorStructure,
    known: NuisanceColumns,
    readings: DataColumns,
    count: int,
    bounds: tuple[Floats, Floats],
    var: Floats,
    now: ResidualSpace,
    step: Floats,
) -> tuple[Floats, ResidualSpace]:
    """The best point along the step, halved until the likelihood rises."""
    for half in range(12):
        trial = np.clip(var + step * 0.5**half, *bounds)
        trial[0] = max(trial[0], 0.01 * var[0])
        there = residual_space(parts.covariance(trial), known, readings, count)
        if there.loglik > now.loglik:
            return trial, there
    return var, now
