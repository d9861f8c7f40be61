"""The noise floor, estimated on the data at hand by restricted maximum likelihood.

V = σ²·D + τ_r²·T + τ_w²·K for the stops of one run: D white noise (1/samples), T a small random turn of each stop
(the positioner's repeatability, `repeatability`), K a random walk from stop to stop (`bias-walk`). T and K are made
of those causes' own signatures. The estimate is Newton's on the average information (Gilmour, Thompson, Cullis,
Biometrics 51 (1995) 1440, eq. 5), inside bounds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
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
#: Rows of a run up to which its parts are worth writing out.
MAX_DENSE_ROWS = 150


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
    member (U, R): the kind of each unit's run. What the parts are made of, so that no product of whole matrices is
    needed: white (classes, m) the diagonal of D; turn (classes, V, k, 3) with T = turn·turnᵀ stop by stop; walk
    (classes, V, k, 3) and step (classes, V) with K = Σ_j step_j w_j w_jᵀ, w_j being walk from stop j on."""

    parts: Floats
    pad: Floats
    member: NDArray[np.intp]
    white: Floats
    turn: Floats
    walk: Floats
    step: Floats

    def covariance(self, variances: Floats) -> FloorCovariance:
        """The floor with the variances (3)."""
        V = np.einsum("i,cijk->cjk", variances, self.parts)
        V = V + np.eye(V.shape[1]) * self.pad[:, None, :]
        L = np.linalg.cholesky(V)
        logdet = 2 * np.log(np.einsum("cii->ci", L)).sum(1)
        live = self.pad[self.member].reshape(len(self.member), -1) == 0
        return FloorCovariance(_triangular_inverse(L), self.member, live, float(logdet[self.member].sum()))

    def traces(self, inverse: Floats) -> Floats:
        """Trace (classes, 3) of each part as whitened rows see it."""
        by_stop = inverse.reshape(*inverse.shape[:2], *self.walk.shape[1:3])
        white = np.einsum("cab,cab,cb->c", inverse, inverse, self.white, optimize=True)
        turned = np.matmul(by_stop.transpose(0, 2, 1, 3), self.turn)
        # Sums over the stops from each on.
        walked = np.matmul(by_stop.transpose(0, 2, 1, 3), self.walk)[:, ::-1].cumsum(1)[:, ::-1]
        squares = [np.einsum("cvai,cvai->cv", x, x) for x in (turned, walked)]
        return np.stack([white, squares[0].sum(1), (squares[1] * self.step).sum(1)], axis=1)

    def relative(self, inverse: Floats) -> Floats | None:
        """The parts as whitened rows see them (classes, 3, m, m), where runs are so short that these are cheaper made
        once than their factors multiplied each time; else None."""
        if inverse.shape[-1] > MAX_DENSE_ROWS:
            return None
        return np.asarray(inverse[:, None] @ self.parts @ inverse[:, None].transpose(0, 1, 3, 2))

    def act(self, i: int, inverse: Floats, relative: Floats | None, rows: Floats) -> Floats:
        """A part as whitened rows see it, times rows (U, R, m, c) of them."""
        if relative is not None:
            return np.asarray(relative[self.member, i] @ rows)
        back = inverse.transpose(0, 2, 1)[self.member] @ rows
        return np.asarray(inverse[self.member] @ (self.parts[:, i][self.member] @ back))


def _triangular_inverse(L: Floats) -> Floats:
    """Inverse (classes, m, m) of lower triangular matrices."""
    return np.stack([scipy.linalg.lapack.dtrtri(one, lower=1)[0] for one in L])


def floor_structure(grid: VisitGrid, weight: Floats, turn: Floats, steps: Floats, project: Floats) -> FloorStructure:
    """From, for each stop: weight (v) or (v, k) relative precision; turn (v, k, 3) signature of its turn; steps (v)
    taken by the walk so far; project (v, k, 3) from readings to the numbers kept."""
    U, R, V = grid.slot.shape
    k = grid.k
    shape = (*turn.shape[:2], 1)
    precision = weight.reshape(len(weight), -1, 1)
    rows = np.concatenate(
        [turn, project, np.broadcast_to(1 / precision, shape), np.broadcast_to(steps[:, None, None], shape)], axis=2
    )
    kinds, member = np.unique(np.round(grid.spread(rows), 7).reshape(U * R, -1), axis=0, return_inverse=True)
    kinds = kinds.reshape(len(kinds), V, k, 8)
    turned, walk, white, so_far = kinds[..., :3], kinds[..., 3:6], kinds[..., 6], kinds[..., 0, 7]
    parts = np.zeros((len(kinds), 3, V * k, V * k))
    at = np.arange(V * k).reshape(V, k)
    parts[:, 0, at, at] = white
    parts[:, 1, at[:, :, None], at[:, None, :]] = turned @ turned.transpose(0, 1, 3, 2)
    so_far = np.maximum.accumulate(so_far, axis=1)
    walked = np.minimum(so_far[:, :, None], so_far[:, None, :])
    parts[:, 2] = (walked[:, :, None, :, None] * np.einsum("cvia,cwja->cviwj", walk, walk, optimize=True)).reshape(
        -1, V * k, V * k
    )
    pad = (parts[:, 0].diagonal(axis1=1, axis2=2) == 0).astype(float)
    step = np.diff(so_far, axis=1, prepend=0.0)
    return FloorStructure(parts, pad, member.reshape(U, R), white.reshape(-1, V * k), turned, walk, step)


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
    inverse, member = now.covariance.inverse, now.covariance.member
    U, R = member.shape
    m = inverse.shape[-1]
    relative = parts.relative(inverse)

    def act(i: int, rows: Floats) -> Floats:
        wide = rows[:, : R * m].reshape(U, R, m, -1)
        out = parts.act(i, inverse, relative, wide).reshape(U, R * m, -1)
        return np.asarray(np.pad(out, ((0, 0), (0, rows.shape[1] - R * m), (0, 0))))

    residual = now.residual[..., None]
    moved = np.stack([act(i, residual)[..., 0] for i in range(3)], axis=-1)
    free = now.free(moved)
    to_shared = now.shared_basis.reshape(residual.size, -1).T @ free.reshape(-1, 3)
    information = 0.5 * (moved.reshape(-1, 3).T @ free.reshape(-1, 3) - to_shared.T @ to_shared)
    whole = parts.traces(inverse)[member].sum((0, 1))
    trace = [float(whole[i]) - _known_trace(now, act, i) for i in range(3)]
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
