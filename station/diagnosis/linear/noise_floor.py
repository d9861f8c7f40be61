"""The noise floor, estimated on the data at hand by restricted maximum likelihood.

V = σ²·D + τ_r²·T + τ_w²·K for the visits of one run: D white noise (1/samples), T a small random turn of each visit
(the positioner's repeatability, `repeatability`), K a random walk from visit to visit (`bias-walk`). T and K are made
of those causes' own signatures. The estimate is Newton's on the average information (Gilmour, Thompson, Cullis,
Biometrics 51 (1995) 1440, eq. 5), inside bounds.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.linear.grid import VisitGrid
from station.diagnosis.linear.projection import (
    UNITS_AT_ONCE,
    DataColumns,
    FloorCovariance,
    NuisanceColumns,
    ResidualSpace,
    residual_space,
)
from station.diagnosis.linear.run_filter import RunFilter, block_visits, split_blocks
from station.domain.core.types import Floats

#: Nats of log-likelihood below which a floor is not worth improving.
CONVERGED_NATS = 2e-5
#: Variances that the readings tell apart by less than this share of what they tell of all are not told apart.
UNTOLD = 1e-9
#: Added to each diagonal element of their covariance, as a share of it, so that it has a root.
ROUNDING = 1e-12
#: Times that each variance is taken to its best beside the others, where Newton's step leaves the bounds.
BOX_SWEEPS = 12
#: Triangular matrices whose halves have fewer rows are inverted whole.
FEW_ROWS = 18
#: Sums up to each of more visits are made one by one: a matrix costs their square.
MANY_VISITS = 96
#: Covariances that a structure keeps of the variances asked for last, and numbers that each of them has at the most.
KEPT_COVARIANCES, MOST_KEPT_NUMBERS = 8, 1 << 18


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """noise: sd of the mean of a visit of average length, turn: rad a visit, walk: a visit; both in the recipe's
    unit."""

    noise: float
    turn: float
    walk: float

    @property
    def variances(self) -> Floats:
        """σ², τ_r², τ_w²."""
        return np.array([self.noise, self.turn, self.walk]) ** 2

    def is_multiple_of(self, other: "NoiseFloor") -> bool:
        """Whether all three are so many times as large, to rounding."""
        own, others = (np.array([floor.noise, floor.turn, floor.walk]) for floor in (self, other))
        return bool(self.noise > 0 and np.allclose(own * other.noise, others * self.noise, rtol=1e-12, atol=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class FloorStructure:
    """What D, T and K of each kind of run are made of, in B blocks of visits: white (classes, B, s) the diagonal of D;
    turn (classes, B, v, k, 3) with T = turn·turnᵀ visit by visit; walk (classes, B, v, k, 3), step and taken
    (classes, B, v) with K = Σ_j step_j w_j w_jᵀ, w_j being walk from visit j on, and taken the steps since the block
    began; inside (classes, B, s, s) the part of K that a block's own steps make. pad (classes, m): 1 where there is
    no visit; member (U, R): the kind of each unit's run; sizes: variances of the noise and the walk of each axis beside
    those in common, where they have their own."""

    white: Floats
    turn: Floats
    walk: Floats
    step: Floats
    taken: Floats
    inside: Floats
    pad: Floats
    member: NDArray[np.intp]
    sizes: tuple[float, ...] = ()
    _kept: dict[bytes, FloorCovariance] = field(default_factory=dict, init=False, repr=False)

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Which of the three variances (3) anything here depends on."""
        return np.array([self.white.any(), self.turn.any(), self.inside.any()])

    def visit_variance(self, variances: Floats) -> Floats:
        """Variance (classes, m) of each number of a visit, the walk apart."""
        turned = np.sum(self.turn**2, axis=-1).reshape(self.white.shape)
        both = variances[0] * self.white + variances[1] * turned
        return np.asarray(both.reshape(len(both), -1)[:, : self.pad.shape[1]])

    def by_visits(self) -> "FloorStructure":
        """The same in blocks of one visit each, as where nothing walks."""
        C, B, v, k = self.walk.shape[:4]
        if v == 1:
            return self
        white, step = self.white.reshape(C, B * v, k), self.step.reshape(C, B * v, 1)
        turn, walk = (x.reshape(C, B * v, 1, k, 3) for x in (self.turn, self.walk))
        inside = step[..., None] * np.einsum("cbvia,cbvja->cbij", walk, walk)
        return FloorStructure(white, turn, walk, step, step, inside, self.pad, self.member)

    def covariance(self, variances: Floats) -> FloorCovariance:
        """The floor with the variances (3). Of few runs the last ones are kept: bank, laws and fit ask for the same
        floor one after the other."""
        if self.inside.size > MOST_KEPT_NUMBERS:
            return self._covariance_of(variances)
        if (found := self._kept.get(key := variances.tobytes())) is None:
            if len(self._kept) == KEPT_COVARIANCES:
                del self._kept[next(iter(self._kept))]
            found = self._kept[key] = self._covariance_of(variances)
        return found

    def _covariance_of(self, variances: Floats) -> FloorCovariance:
        white, turn, walk = (float(x) for x in variances)
        if walk == 0.0 and self.turn.shape[2] > 1:
            return self.by_visits()._covariance_of(variances)
        C, B, s = self.white.shape
        v, k = self.turn.shape[2:4]
        V = walk * self.inside
        at = np.arange(s)
        V[..., at, at] += white * self.white + (self.white == 0)
        by_visit, i = V.reshape(C, B, v, k, v, k), np.arange(v)
        by_visit[:, :, i, :, i, :] += np.moveaxis(turn * self.turn @ self.turn.swapaxes(-1, -2), 2, 0)
        W = self.walk.reshape(C, B, s, 3)
        if walk == 0.0:
            root = np.linalg.cholesky(V)
            inverse, logs = np.asarray(np.linalg.inv(root), float), np.log(np.einsum("cbii->cbi", root))
            return self._covariance(
                inverse, inverse @ W, np.zeros((C, B, 3, s)), np.asarray(2 * logs.sum((1, 2)), float)
            )
        since = walk * np.repeat(self.taken, k, axis=2)[..., None] * W
        inverse, observed, gain, logdet = np.empty_like(V), np.empty_like(W), np.empty((C, B, 3, s)), np.zeros(C)
        P = np.zeros((C, 3, 3))
        for b in range(B):
            F = V[:, b] + W[:, b] @ P @ W[:, b].swapaxes(-1, -2)
            L = np.asarray(np.linalg.cholesky(F), float)
            inverse[:, b] = _triangular_inverse(L)
            observed[:, b] = inverse[:, b] @ W[:, b]
            gain[:, b] = (P @ W[:, b].swapaxes(-1, -2) + since[:, b].swapaxes(-1, -2)) @ inverse[:, b].swapaxes(-1, -2)
            P = P + walk * self.taken[:, b, -1, None, None] * np.eye(3) - gain[:, b] @ gain[:, b].swapaxes(-1, -2)
            logdet += 2 * np.log(np.einsum("cii->ci", L)).sum(1)
        return self._covariance(inverse, observed, gain, logdet)

    def _covariance(self, inverse: Floats, observed: Floats, gain: Floats, logdet: Floats) -> FloorCovariance:
        """The floor from the filter of each kind of run and its log-determinant (classes)."""
        live = self.pad[self.member].reshape(len(self.member), -1) == 0
        runs = RunFilter(inverse, observed, gain, self.member, self.pad.shape[1], bool(gain.any()))
        return FloorCovariance(runs, live, float(logdet[self.member].sum()))

    def traces(self, runs: RunFilter) -> Floats:
        """Trace (classes, 3) of V⁻¹ times each part."""
        each = self.axis_traces(runs)
        return np.stack([each[:, : self.walk.shape[3]].sum(1), each[:, -4], each[:, -3:].sum(1)], axis=1)

    def axis_traces(self, runs: RunFilter) -> Floats:
        """The same (classes, k + 4) of the white part of each number of a visit, of T, and of the walk of each axis."""
        C, B, s = self.white.shape
        if runs.inverse.shape[1] != B:
            return self.by_visits().axis_traces(runs)
        v, k = self.turn.shape[2:4]
        roots, later = runs.precision_roots(), runs.later_information()
        white = np.sum(np.sum(roots**2, axis=2) * self.white, axis=1).reshape(C, v, k).sum(1)
        by_visit = roots.reshape(C, B, -1, v, k).swapaxes(2, 3)
        turned = np.sum((by_visit @ self.turn) ** 2, axis=(1, 2, 3, 4))[:, None]
        # What a step from each visit on does to its block, and what it leaves to those after.
        block = _onward(by_visit[:, :, :, :s] @ self.walk)
        squares = np.sum(block**2, axis=3)
        if B > 1:
            after = np.eye(3) - runs.gain[:, :, None] @ block
            squares += np.sum(after * (later[:, :, None] @ after), axis=3)
        walked = np.sum(squares * self.step[..., None], axis=(1, 2))
        return np.concatenate([white, turned, walked], axis=1)

    def times(self, rows: Floats) -> Floats:
        """D, T and K times rows (U, R, m, c) of readings' weights: (U, R, m, 3, c)."""
        C, B, v, k = self.walk.shape[:4]
        U, R, m, c = rows.shape
        by_visit = split_blocks(rows, B * v, k, axis=2)
        white, turn, walk = (x.reshape(C, B * v, k, -1)[self.member] for x in (self.white, self.turn, self.walk))
        step = self.step.reshape(C, B * v)[self.member]
        # From each visit on, then up to each visit.
        onward = _onward(walk.swapaxes(-1, -2) @ by_visit)
        walked = walk @ _so_far(step[..., None, None] * onward)
        parts = np.stack([white * by_visit, turn @ (turn.swapaxes(-1, -2) @ by_visit), walked], axis=-2)
        return np.asarray(parts.reshape(U, R, B * v * k, 3, c)[:, :, :m])

    def walked(self, rows: Floats, units: slice) -> Floats:
        """rowᵀ·K·row (c) of the columns of rows (U, R, m, c) of some units."""
        C, B, v, k = self.walk.shape[:4]
        by_visit = split_blocks(rows, B * v, k, axis=2)
        member = self.member[units]
        each = self.walk.reshape(C, B * v, k, 3)[member].swapaxes(-1, -2) @ by_visit
        step = self.step.reshape(C, B * v)[member].reshape(-1, B * v)
        onward, squares = np.zeros((*member.shape, 3, rows.shape[-1])), np.zeros((3, rows.shape[-1]))
        for i in range(B * v)[::-1]:
            onward += each[:, :, i]
            squares += (step[:, i] @ (onward**2).reshape(len(step), -1)).reshape(squares.shape)
        return np.asarray(squares.sum(0))


def _so_far(values: Floats) -> Floats:
    """Sums (…, V, a, b) over the visits up to each: of few, products of matrices are faster than sums one by one."""
    if values.shape[-3] > MANY_VISITS:
        return values.cumsum(axis=-3)
    up_to = np.tri(values.shape[-3])
    return np.asarray(up_to @ values.reshape(*values.shape[:-2], -1)).reshape(values.shape)


def _onward(values: Floats) -> Floats:
    """The same over each visit and those after it."""
    return _so_far(values[..., ::-1, :, :])[..., ::-1, :, :]


def _triangular_inverse(L: Floats) -> Floats:
    """Inverse (…, m, m) of lower triangular matrices, by halves: [[A, 0], [B, C]]⁻¹ = [[A⁻¹, 0], [−C⁻¹·B·A⁻¹, C⁻¹]]."""
    half = L.shape[-1] // 2
    if half < FEW_ROWS:
        return np.tril(np.linalg.inv(L))
    inverse, rest = np.zeros_like(L), L[..., half:, :half]
    first = inverse[..., :half, :half] = _triangular_inverse(L[..., :half, :half])
    last = inverse[..., half:, half:] = _triangular_inverse(L[..., half:, half:])
    inverse[..., half:, :half] = -(last @ rest) @ first
    return inverse


def floor_structure(grid: VisitGrid, weight: Floats, turn: Floats, steps: Floats, project: Floats) -> FloorStructure:
    """From, for each visit: weight (v) or (v, k) relative precision; turn (v, k, 3) signature of its turn; steps (v)
    taken by the walk so far; project (v, k, 3) from readings to the numbers kept."""
    U, R, V = grid.slot.shape
    k = grid.k
    shape = (*turn.shape[:2], 1)
    precision = weight.reshape(len(weight), -1, 1)
    rows = np.concatenate(
        [turn, project, np.broadcast_to(1 / precision, shape), np.broadcast_to(steps[:, None, None], shape)], axis=2
    )
    kinds, member = _kinds_of_runs(np.round(grid.spread(rows), 7).reshape(U * R, -1))
    kinds = kinds.reshape(len(kinds), V, k, 8)
    so_far = np.maximum.accumulate(kinds[..., 0, 7], axis=1)
    step = np.diff(so_far, axis=1, prepend=0.0)
    pad = (kinds[..., 6] == 0).astype(float).reshape(len(kinds), -1)
    blocks, size = block_visits(V, k)
    turned, walk, white, step = (
        split_blocks(x, blocks, size, axis=1) for x in (kinds[..., :3], kinds[..., 3:6], kinds[..., 6], step)
    )
    taken = step.cumsum(2)
    both = np.minimum(taken[..., :, None], taken[..., None, :])[..., :, None, :, None]
    inside = both * np.einsum("cbvia,cbwja->cbviwj", walk, walk, optimize=True)
    s = size * k
    inside, white = inside.reshape(*inside.shape[:2], s, s), white.reshape(*white.shape[:2], s)
    return FloorStructure(white, turned, walk, step, taken, inside, pad, member.reshape(U, R))


def _kinds_of_runs(runs: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Rows (n, ·) that differ, and which of them each is; compared as bytes, as a run may have many numbers."""
    runs = runs + 0.0  # Zeros of one sign.
    place: dict[bytes, int] = {}
    member = np.array([place.setdefault(run.tobytes(), len(place)) for run in runs], np.intp)
    return runs[np.unique(member, return_index=True)[1]], member


@dataclass(frozen=True, slots=True, eq=False)
class FittedFloor:
    """A floor with its structure and the space it makes."""

    floor: NoiseFloor
    space: ResidualSpace
    parts: FloorStructure

    @property
    def covariance(self) -> Floats:
        """Covariance (3, 3) of the variances σ², τ_r², τ_w²; no spread along what the readings do not tell apart.

        Each is taken in its own size: about a rate table's axes a turn does what noise does, 10⁸ times larger.
        """
        information = newton(self.parts, self.space)[1]
        size = np.diag(information)
        scale = np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1.0)), 0.0)
        values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
        told = values > UNTOLD * max(float(values.max()), 1e-300)
        root = scale[:, None] * vectors[:, told] / np.sqrt(values[told])
        return np.asarray(root @ root.T, float)


def covariance_root(covariance: Floats) -> Floats:
    """Lower triangular root (3, 3) of a covariance of variances, of which some may not be told apart."""
    return np.asarray(np.linalg.cholesky(covariance + np.diag(ROUNDING * np.diag(covariance) + 1e-300)), float)


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
    upper = np.where(parts.shown, upper, 0.0)
    free = upper > 0
    lower = np.array([least, 0.0, 0.0])
    var = np.clip(_initial_variances(parts, known, readings, count) if start is None else start.variances, lower, upper)
    now = residual_space(parts.covariance(var), known, readings, count)
    for _ in range(30):
        slope, information = newton(parts, now)
        held = ~free | ((var <= lower) & (slope < 0)) | ((var >= upper) & (slope > 0))
        step = _step(slope, information, held, lower - var, upper - var)
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


def newton(parts: FloorStructure, now: ResidualSpace) -> tuple[Floats, Floats]:
    """Slope (3) and average information (3, 3) of the restricted log-likelihood by the variances; units some at a time,
    as each has three columns of every column."""
    runs, residual = now.covariance.runs, now.residual
    trace = parts.traces(runs)[runs.member].sum((0, 1))
    normal, along, to_shared = np.zeros((3, 3)), np.zeros(3), np.zeros((now.shared_basis.shape[2], 3))
    for first in range(0, len(residual), UNITS_AT_ONCE):
        units = slice(first, first + UNITS_AT_ONCE)
        some, own = now.part(units), residual[units]
        moved, free, known = _moved(replace(parts, member=parts.member[units]), some, own)
        normal += moved.reshape(-1, 3).T @ free.reshape(-1, 3)
        to_shared += some.shared_basis.reshape(own.size, -1).T @ free.reshape(-1, 3)
        along += np.einsum("umi,um->i", moved, own)
        trace = trace - known
    return -0.5 * (trace - along), 0.5 * (normal - to_shared.T @ to_shared)


def _moved(parts: FloorStructure, now: ResidualSpace, residual: Floats) -> tuple[Floats, Floats, Floats]:
    """Of some units what each variance makes of the residual (U, M, 3), the same free of the own known columns, and how
    much of it (3) all known columns take up."""
    runs = now.covariance.runs
    rows = np.concatenate([residual[..., None], now.basis, now.shared_basis], axis=2)
    U, R = runs.member.shape
    visits = rows[:, : R * runs.rows].reshape(U, R, runs.rows, -1)
    acted = parts.times(runs.transposed(visits))
    white = runs.whiten(acted.reshape(*visits.shape[:3], -1)).reshape(U, R * runs.rows, 3, -1)
    moved = np.zeros((U, rows.shape[1], 3))
    moved[:, : white.shape[1]] = white[..., 0]
    known = np.sum(rows[:, : white.shape[1], None, 1:] * white[..., 1:], axis=(0, 1, 3))
    return moved, now.free(moved), np.asarray(known)


def _step(slope: Floats, information: Floats, held: NDArray[np.bool_], least: Floats, most: Floats) -> Floats:
    """Newton's step in the variances that are not held, or the best one between least and most where it goes beyond:
    cut off there, it need not lead up."""
    step = np.zeros(3)
    go = ~held
    if not go.any():
        return step
    scale = 1 / np.sqrt(np.maximum(np.diag(information)[go], 1e-300))
    normal = information[np.ix_(go, go)] * np.outer(scale, scale) + 1e-9 * np.eye(int(go.sum()))
    step[go] = scale * np.linalg.solve(normal, slope[go] * scale)
    if np.all((least <= step) & (step <= most)):
        return step
    # The quadratic has one maximum in the box, which one variance after the other comes to.
    step = np.clip(step, least, most)
    for _ in range(BOX_SWEEPS):
        for i in np.flatnonzero(go & (np.diag(information) > 0)).tolist():
            to_best = (slope[i] - information[i] @ step) / information[i, i]
            step[i] = min(max(step[i] + to_best, least[i]), most[i])
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
