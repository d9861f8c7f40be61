"""A space of some units, and the products of columns in it with one another and with what is known.

Where the floor walks, columns of one axis are whitened as a whole. Where nothing walks, each visit has a factor of its
own: zᵀV⁻¹y is then a sum over the visits of z·y times a weight of their two axes, and no column is whitened.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from station.diagnosis.candidates.column_blocks import ColumnBlock, ShapeGroup
from station.diagnosis.candidates.visit_scan import NormalProducts
from station.diagnosis.linear.projection import AxisColumns, DataColumns, ResidualSpace
from station.domain.core.types import Array, Floats

#: Sets of so few columns are multiplied faster number by number than as matrices.
FEW_COLUMNS = 3
#: Columns that keep less than this share of their squares beside what is known are combinations of it.
LEAST_LEFT = 1e-13
#: And columns of a smaller square are rounding; the amplitudes that they would need have no number in single precision.
LEAST_SQUARE = 1e-28


class VisitWeights(NamedTuple):
    """What numbers of one axis of a visit meet in a space where nothing walks: known (3, U, R, V, q) what columns are
    compared with, and weight (3, 3, U, R, V) of the products of two axes."""

    known: Floats
    weight: Floats

    @staticmethod
    def of(factors: Array, known: Floats) -> "VisitWeights":
        """From factors (3, U, R, V, s, 1) that whiten the axes' numbers, and rows (U, q, ·) of what is known."""
        factors = factors[..., 0]
        _, U, R, V, s = factors.shape
        rows = known[..., : R * V * s].reshape(U, -1, R, V, s)
        return VisitWeights(
            np.einsum("aurvs,uqrvs->aurvq", factors, rows), np.einsum("aurvs,burvs->aburv", factors, factors)
        )

    def products(self, block: ColumnBlock, rows: AxisColumns) -> tuple[Floats, Floats]:
        """See `PartOfSpace._products`."""
        U, R, V, C = rows.values.shape
        runs, groups = (R, 1) if block.by_run else (1, block.groups)
        visits, each = R * V // runs, block.width // groups
        known = self.known.reshape(3, U, runs, visits, -1)
        weight = self.weight.reshape(3, 3, U, runs, 1, visits)
        values = rows.values.reshape(U, runs, visits, -1, each)
        normal = np.empty((U, runs, values.shape[3], each, each))
        taken = np.empty((U, runs, values.shape[3], each, known.shape[-1]))
        by_axis = [np.ascontiguousarray(values[..., at]) for at in block.axes]
        for i, (at, mine) in enumerate(zip(block.axes, by_axis, strict=True)):
            taken[..., at, :] = _along(mine, known[i])
            for j, other in enumerate(block.axes[: i + 1]):
                normal[..., at, other] = _weighted(mine, by_axis[j], weight[i, j])
                normal[..., other, at] = normal[..., at, other].swapaxes(-1, -2)
        if block.by_run:
            normal, taken = normal.swapaxes(1, 2), taken.swapaxes(1, 2)
        sets = C // block.width
        return normal.reshape(U, sets, -1, each, each), taken.reshape(U, sets, -1, known.shape[-1])


def _along(columns: Floats, known: Floats) -> Floats:
    """Products (U, B, n, f, q) of columns (U, B, T, n, f) with what is known (U, B, T, q)."""
    U, B, T, n, f = columns.shape
    return np.asarray((columns.reshape(U, B, T, n * f).swapaxes(-1, -2) @ known).reshape(U, B, n, f, -1))


def _weighted(some: Floats, others: Floats, weight: Floats) -> Floats:
    """Sums (U, B, n, f, g) over T of the products of columns (U, B, T, n, f) and (U, B, T, n, g), of each weight
    (U, B, 1, T)."""
    U, B, T, n, f = some.shape
    if f <= FEW_COLUMNS:
        products = some[..., :, None] * others[..., None, :]
        return np.asarray((weight @ products.reshape(U, B, T, -1)).reshape(U, B, n, f, -1))
    left = some * weight[..., 0, :, None, None]
    return np.asarray(left.transpose(0, 1, 3, 4, 2) @ others.transpose(0, 1, 3, 2, 4))


class PartOfSpace(NamedTuple):
    """The space of some units, and what a column is compared with in it, as rows (U, 1 + c + p, ·): the readings, the
    known columns shared by all units, and those of each unit. For columns of one axis, if there are any: factors (3, U,
    R, B, s, v) that whiten them, or weights of the visits where nothing walks."""

    space: ResidualSpace
    known: Floats
    factors: Array | None
    weights: VisitWeights | None

    @staticmethod
    def of(space: ResidualSpace, gain: Floats | None) -> "PartOfSpace":
        """From the space, and the gain (U, R, V, 3) of columns of one axis. The basis is made orthonormal to the last
        digit, since squares of columns are compared with squares of what it takes from them."""
        near = space.basis.swapaxes(1, 2) @ space.basis
        basis = space.basis @ (1.5 * np.eye(near.shape[-1]) - 0.5 * near)
        known = np.concatenate([space.data[..., None], space.shared_basis, basis], axis=2)
        covariance = replace(space.covariance, runs=space.covariance.runs.run_by_run())
        known = np.ascontiguousarray(known.swapaxes(1, 2))
        factors = None if gain is None else covariance.runs.axis_factors(gain)
        by_visit = factors is not None and not covariance.runs.walks and factors.shape[-1] == 1
        weights = VisitWeights.of(factors, known) if factors is not None and by_visit else None
        return PartOfSpace(replace(space, covariance=covariance), known, factors, weights)

    def products(self, block: ColumnBlock, rows: Sequence[DataColumns | AxisColumns]) -> Iterator[NormalProducts]:
        """The products of the columns of a block, of each of its kinds: (b, U, K, …), (b, U, G, K, …) of a scan,
        (b, K, …) summed over the units of a shared one."""
        found = [self._products(block, some) for some in rows]
        normal, taken = (np.concatenate(x, axis=1) if len(x) > 1 else x[0] for x in zip(*found, strict=True))
        own = 1 + self.space.shared_basis.shape[2]
        for kind in block.kinds:
            yield _products_of(kind, normal[:, kind.sets], taken[:, kind.sets], own)

    def _products(self, block: ColumnBlock, rows: DataColumns | AxisColumns) -> tuple[Floats, Floats]:
        """Of columns of some sets the normal matrices of their groups (U, b, G, K/G, K/G) before anything is taken off,
        and their products with what is known (U, b, K, 1 + c + p)."""
        if self.weights is not None and isinstance(rows, AxisColumns):
            return self.weights.products(block, rows)
        white = self._white(rows)
        (U, C, M), (_, R) = white.shape, self.space.covariance.runs.member.shape
        known = self.known[..., :M]
        if not block.by_run:
            taken = (white @ known.swapaxes(1, 2)).reshape(U, C // block.width, block.width, -1)
            return _squares(white.reshape(U, C // block.width, block.groups, -1, M)), taken
        m = self.space.covariance.runs.rows
        by_run, known = (x[..., : R * m].reshape(U, -1, R, m).swapaxes(1, 2) for x in (white, known))
        taken = (by_run @ known.swapaxes(-1, -2)).reshape(U, R, C // block.width, block.width, -1).swapaxes(1, 2)
        sets = by_run.reshape(U, R, C // block.width, block.width, m).swapaxes(1, 2)
        return _squares(sets), taken.reshape(U, C // block.width, R * block.width, -1)

    def _white(self, rows: DataColumns | AxisColumns) -> Floats:
        """Columns, each as a row of white numbers (U, C, M)."""
        covariance, dwell = self.space.covariance, self.space.dwell
        if isinstance(rows, DataColumns):
            U, R, m, C = rows.visit.shape
            white = np.empty((U, C, R * m + dwell))
            covariance.whiten(rows, dwell, out=white.swapaxes(1, 2))
            return white
        assert self.factors is not None
        (U, R, _, C), (blocks, s, v) = rows.values.shape, self.factors.shape[-3:]
        white = np.empty((U, C, R * blocks * s + dwell))
        white[..., R * blocks * s :] = 0.0
        out = white[..., : R * blocks * s].reshape(U, C, R, blocks, s).transpose(0, 2, 3, 4, 1)
        # One number and a few need no matrices.
        times = np.multiply if v == 1 else np.matmul
        for axis, factor in enumerate(self.factors):
            mine = np.flatnonzero(rows.axis == axis)
            values = np.ascontiguousarray(rows.values[..., mine]).reshape(U, R, blocks, v, -1)
            step = np.diff(mine)
            if len(mine) > 1 and np.all(step == step[0]):
                times(factor, values, out=out[..., mine[0] : mine[-1] + 1 : step[0]])
            elif len(mine):
                out[..., mine] = times(factor, values)
        return white

    def free(self, rows: Sequence[DataColumns | AxisColumns]) -> list[Array]:
        """The same columns as white rows (U, M, …) without what the units' own known ones take up, in single
        precision."""
        return [self.space.project(some).astype(np.float32) for some in rows if isinstance(some, DataColumns)]


def _squares(sets: Floats) -> Floats:
    """Products (…, K, K) of the rows (…, K, M) of each set with one another."""
    if sets.shape[-2] <= FEW_COLUMNS:
        return np.asarray(np.einsum("...km,...lm->...kl", sets, sets))
    return np.asarray(sets @ sets.swapaxes(-1, -2))


def _products_of(kind: ShapeGroup, normal: Floats, taken: Floats, own: int) -> NormalProducts:
    """The products of a kind from those of its sets, `own` being how many come before the units' own known columns."""
    U, b, K = taken.shape[:3]
    if kind.pattern == "scan":
        a = K // kind.groups
        taken = taken.reshape(U, b, kind.groups, a, -1)
        # The normal matrices of a set's groups are blocks on the diagonal of its own.
        G, each = normal.shape[2], kind.groups // normal.shape[2]
        normal = np.einsum("ubGgigj->ubGgij", normal.reshape(U, b, G, each, a, each, a)).reshape(U, b, -1, a, a)
    else:
        normal = normal[:, :, 0] if normal.shape[2] == 1 else _block_diagonal(normal)
    known = taken[..., own:]
    left = normal - known @ known.swapaxes(-1, -2)
    before, after = (np.einsum("...kk->...", x)[..., None, None] for x in (normal, left))
    lost = after <= np.maximum(LEAST_LEFT * before, LEAST_SQUARE)
    if lost.any():
        # What the known columns take up is as small as rounding in all directions, and explains nothing.
        rest = np.where(before > 0, np.maximum(LEAST_LEFT**2 * before, LEAST_SQUARE), 0.0)
        left = np.where(lost, rest * np.eye(left.shape[-1]), left)
        taken = np.where(lost, 0.0, taken)
    found = left, taken[..., 1:own], taken[..., 0]
    return NormalProducts(*(x.sum(0) if kind.pattern == "shared" else x.swapaxes(0, 1) for x in found))


def _block_diagonal(normal: Floats) -> Floats:
    """Normal matrices of the groups of each set (U, b, G, a, a) as one of the set (U, b, G·a, G·a)."""
    U, b, G, a, _ = normal.shape
    out = np.zeros((U, b, G, a, G, a))
    np.einsum("ubgigj->ubgij", out)[...] = normal
    return out.reshape(U, b, G * a, G * a)
