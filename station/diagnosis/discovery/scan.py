"""All terms of a library judged at once: one product of matrices with what the causes of the library left.

The columns are whitened by the floor and freed of what is known. A choice is a term with some of its axes and one set
of coefficients, for all units or for each; its evidence needs only the share of the sum of squares that it takes up.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.discovery.evidence import log_evidence
from station.diagnosis.discovery.library import ColumnProduct, Library
from station.diagnosis.discovery.price import family_price
from station.diagnosis.linear.eigen import eigenvectors
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import DataColumns, ResidualSpace
from station.diagnosis.search.scoring import ScoringProblem, ScoringSetting
from station.domain.core.types import Array, Floats
from station.model.formula.grammar import FormulaColumn
from station.model.formula.term import Term

#: Columns that are laid out at once.
COLUMNS_AT_ONCE = 1500
#: A direction that keeps less than this share of its length is lost in what is known.
VISIBLE_SHARE = 1e-6
#: Squared length below which a column has died away: in single precision nothing of it can be turned to length one.
LEAST_SQUARE = 1e-60
#: Coefficients of one unit beyond which a term is not tried unit by unit.
MOST_PER_UNIT = 6


class Choice(NamedTuple):
    """One product with some of its columns, shared by all or own to each unit."""

    product: ColumnProduct
    columns: tuple[int, ...]
    of: str

    @property
    def term(self) -> Term:
        """The term that it is."""
        return self.product.term(self.columns, self.of)


@dataclass(frozen=True, slots=True, eq=False)
class ChoiceBatch:
    """Choices of as many columns each: turn (U or 1, F, K, K) to orthonormal directions; rank (F) of them; prices."""

    choices: tuple[Choice, ...]
    index: NDArray[np.intp]
    turn: Floats
    rank: NDArray[np.intp]
    prices: Floats

    def taken(self, products: Array) -> Array:
        """The sum of squares (F, n) that each takes up of data whose products with all columns are (U, C, n), or those
        summed over the units (1, C, n) where they share a coefficient."""
        turn = self.turn.astype(products.dtype, copy=False)
        if self.index.shape[1] == 1:
            along = products[:, self.index[:, 0]] * turn[:, :, 0]
            return np.asarray(np.einsum("ufn,ufn->fn", along, along))
        along = turn @ products[:, self.index]
        return np.asarray(np.einsum("ufkn,ufkn->fn", along, along))


@dataclass(frozen=True, eq=False)
class Scan:
    """A library in a space: white columns (U, C, M) free of the own known ones, and every choice of them. Single
    precision is enough to find what is then judged exactly."""

    space: ResidualSpace
    columns: Array
    batches: tuple[ChoiceBatch, ...]

    def scores(self, data: Array) -> Iterator[tuple[ChoiceBatch, Floats]]:
        """Log evidence less price (F, n) of each batch for residuals (U, M, n)."""
        for batch, share in zip(self.batches, self._shares(data), strict=True):
            value = np.empty(share.shape)
            for rank in np.unique(batch.rank):
                at = batch.rank == rank
                value[at] = log_evidence(share[at], int(rank), self.space.dof) if rank else -np.inf
            yield batch, value - batch.prices[:, None]

    def largest_scores(self, data: Array) -> Floats:
        """The largest of these (n): of choices of one rank and price, that of the largest share."""
        found = [np.full(data.shape[2], -np.inf)]
        for kinds, share in zip(self._kinds, self._shares(data), strict=True):
            for (rank, price), at in kinds.items():
                found += [log_evidence(share[at].max(axis=0), rank, self.space.dof) - price] if rank else []
        return np.asarray(np.max(found, axis=0))

    @cached_property
    def _kinds(self) -> list[dict[tuple[int, float], list[int]]]:
        """Of each batch the places of the choices of each rank and price."""
        found = [dict[tuple[int, float], list[int]]() for _ in self.batches]
        for batch, kinds in zip(self.batches, found, strict=True):
            for i, kind in enumerate(zip(batch.rank.tolist(), batch.prices.tolist(), strict=True)):
                kinds.setdefault(kind, []).append(i)
        return found

    def _shares(self, data: Array) -> Iterator[Floats]:
        """The share (F, n) of the sum of squares of residuals (U, M, n) that each choice of each batch takes up."""
        products, rest = self.columns @ data.astype(np.float32, copy=False), np.einsum("umn,umn->n", data, data)
        summed = products.sum(0, keepdims=True)
        for batch in self.batches:
            yield np.asarray(batch.taken(summed if len(batch.turn) == 1 else products) / rest)


class ScannedUnits(NamedTuple):
    """The units that a scan goes over: their setting, and which visits (v) are theirs."""

    setting: ScoringSetting
    visits: Array


def scanned_units(problem: ScoringProblem, most: int) -> ScannedUnits:
    """All units of a problem, or the first so many of a fleet."""
    units = problem.view.grid.units
    if units <= most:
        return ScannedUnits(problem.setting, np.ones(len(problem.view.reduced.mean), bool))
    return ScannedUnits(*problem.setting.of_units(np.arange(most)))


def scan_of(library: Library, view: ResidualView, units: ScannedUnits, floor: NoiseFloor) -> Scan:
    """The library as some units see it under a floor."""
    space = units.setting.space(floor, moving=library.moving)
    U, M = space.data.shape
    columns, length, end = np.empty((U, library.width, M), np.float32), np.empty((U, library.width)), 0
    for some in _portions(library):
        white, squares = _white_columns(library, some, view, units, space)
        start, end = end, end + squares.shape[1]
        columns[:, start:end], length[:, start:end] = white.swapaxes(1, 2), squares
    return Scan(space, columns, tuple(_batches(library, columns, length, space)))


def _portions(library: Library) -> Iterator[list[ColumnProduct]]:
    some: list[ColumnProduct] = []
    width = 0
    for p in library.products:
        some.append(p)
        width += len(p.columns)
        if width >= COLUMNS_AT_ONCE:
            yield some
            some, width = [], 0
    if some:
        yield some


def _white_columns(
    library: Library, some: Sequence[ColumnProduct], view: ResidualView, units: ScannedUnits, space: ResidualSpace
) -> tuple[Floats, Floats]:
    """White columns (U, M, c) of some products, and their squared lengths (U, c) before anything known is taken off."""
    values, axes = library.values(some)
    rows = (_placed_within if library.moving else _placed)(view, values, axes, units)
    _, R, m, _ = rows.visit.shape
    white = space.covariance.whiten(rows, space.dwell, space.basis.shape[1] - R * m - space.dwell)
    length = np.einsum("umc,umc->uc", white, white)
    white -= space.basis @ (space.basis.transpose(0, 2, 1) @ white)
    return white, length


def _placed(_view: ResidualView, values: Floats, axes: Sequence[int], units: ScannedUnits) -> DataColumns:
    """Values (v, c) of visits, each on its axis, as rows of the units."""
    layout = units.setting.layout
    return layout.columns(layout.keep[:, :, axes] * values[:, None], None)


def _placed_within(view: ResidualView, values: Floats, axes: Sequence[int], units: ScannedUnits) -> DataColumns:
    """The same for values (n, c) within the visits."""
    mean, contrast = view.reduced.reduce_fine(values, units.visits)
    means = np.zeros((len(mean), 3, len(axes)))
    contrasts = np.zeros((*contrast.shape[:2], 3, len(axes)))
    every = np.arange(len(axes))
    means[:, axes, every], contrasts[:, :, axes, every] = mean, contrast
    return units.setting.layout.rows(means, contrasts)


def _batches(library: Library, columns: Array, length: Floats, space: ResidualSpace) -> Iterator[ChoiceBatch]:
    by_width: dict[int, list[tuple[ColumnProduct, tuple[int, ...]]]] = {}
    for p in library.products:
        for chosen in _subsets(p.columns):
            by_width.setdefault(len(chosen), []).append((p, chosen))
    shared = (columns @ space.shared_basis.astype(np.float32)).sum(0, dtype=float)
    for width, some in by_width.items():
        index = np.array([[p.first + at for at in chosen] for p, chosen in some])
        normal, scale = _normal(columns, index), length[:, index].mean(axis=2)
        prices = np.array([family_price(p.input.factor.name, p.modulator.factor.name, width) for p, _ in some])
        for of in _levels(len(columns), width):
            choices = tuple(Choice(p, chosen, of) for p, chosen in some)
            known: tuple[Floats, Floats] = (normal, scale) if of == "unit" else _common(normal, scale, shared[index])
            turn, rank = _directions(*known, space.dof)
            yield ChoiceBatch(choices, index, turn, rank, prices)


def _levels(units: int, width: int) -> Iterator[str]:
    """Who may share choices of so many columns."""
    if width <= MOST_PER_UNIT:
        yield "unit"
    if units > 1:
        yield "common"


def _common(normal: Floats, scale: Floats, shared: Floats) -> tuple[Floats, Floats]:
    """Normal matrices (1, F, K, K) and squared lengths (1, F) of choices that all units share, without what the shared
    known columns take up; shared (F, K, s): their products with those."""
    normal = normal.sum(0, keepdims=True) - shared @ shared.swapaxes(-1, -2)
    return normal, scale.sum(0, keepdims=True)


def _directions(normal: Floats, scale: Floats, dof: int) -> tuple[Floats, NDArray[np.intp]]:
    """What turns columns to orthonormal ones (U or 1, F, K, K), zeros for what is lost, and their rank (F)."""
    m, E = (normal[..., 0], np.ones_like(normal)) if normal.shape[-1] == 1 else eigenvectors(normal)
    visible = m > np.maximum(VISIBLE_SHARE * scale, LEAST_SQUARE)[..., None]
    turn = (E * np.where(visible, 1 / np.sqrt(np.where(visible, m, 1.0)), 0.0)[..., None, :]).swapaxes(-1, -2)
    rank = np.count_nonzero(visible, axis=(0, 2))
    return turn, np.where(rank > dof // 4, 0, rank)


@cache
def _subsets(columns: tuple[FormulaColumn, ...]) -> tuple[tuple[int, ...], ...]:
    """Every axis together, and each alone with all its phases."""
    alone: dict[tuple[int, int], list[int]] = {}
    for at, c in enumerate(columns):
        alone.setdefault((c.i, c.j), []).append(at)
    each = [tuple(at) for at in alone.values()] if len(alone) > 1 else []
    return tuple(range(len(columns))), *each


def _normal(columns: Array, index: NDArray[np.intp]) -> Floats:
    """Normal matrices (U, F, K, K) of the choices' columns."""
    if index.shape[1] == 1:
        squares = np.einsum("ucm,ucm->uc", columns, columns)
        return np.asarray(squares[:, index][..., None], float)
    parts = []
    for some in np.array_split(index, max(1, len(index) // 100)):
        rows = columns[:, some].astype(float)
        parts.append(rows @ rows.swapaxes(-1, -2))
    return np.concatenate(parts, axis=1)
