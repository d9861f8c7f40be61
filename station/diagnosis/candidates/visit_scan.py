"""Scans of single visits without their columns.

Of a cause that hits one visit nobody knows which; there is a group of columns for every visit, zero at all others. With
E the few columns of a visit v, ZᵀZ = Eᵀ·(V⁻¹ − G·Gᵀ)_vv·E and Zᵀr = Eᵀ·(L⁻ᵀr)_v, where G = L⁻ᵀ·(the own known columns'
basis): all that is needed is a block on the diagonal of V⁻¹ a visit, and a few columns passed back through the runs.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import Bank
from station.diagnosis.linear.grid import RowLayout
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.linear.run_filter import RunFilter
from station.domain.core.types import Array, Floats


class NormalProducts(NamedTuple):
    """Of some units' columns Z of a kind: normal ZᵀZ (b, …, K, K), cross ZᵀC (b, …, K, c), readings Zᵀr (b, …, K)."""

    normal: Floats
    cross: Floats
    readings: Floats


@dataclass(frozen=True, slots=True, eq=False)
class VisitColumns:
    """place (U, G): where among its unit's visits each group's stands, −1 for none; columns (U, G, k, a) there."""

    place: NDArray[np.intp]
    columns: Array

    def products(self, back: Array) -> Array:
        """Zᵀ times data (U, G, a, n) that passed back through the runs (U, R·V, k, n)."""
        unit = np.arange(len(self.place))[:, None]
        return np.asarray(self.columns.swapaxes(-1, -2) @ back[unit, self.place])

    def turned(self, E: Floats) -> "VisitColumns":
        """The columns along eigenvectors (U, G, a, a), in single precision."""
        return VisitColumns(self.place, (self.columns @ E).astype(np.float32))


def visit_columns(bank: Bank, i: int, layout: RowLayout, units: slice) -> VisitColumns:
    """The columns of a scan of a bank for some units."""
    candidate, code = bank.candidates[i], bank.codes[i]
    grid, visits = layout.grid.part(units)
    retained, code = candidate.columns.retained(layout.keep, visits), code[visits]
    slot = grid.slot.reshape(grid.units, -1)
    unit, at = np.nonzero(slot >= 0)
    visit = slot[unit, at]
    place = np.full((grid.units, bank.groups[i]), -1)
    columns = np.zeros((*place.shape, grid.k, candidate.axes))
    place[unit, code[visit]], columns[unit, code[visit]] = at, retained[visit]
    return VisitColumns(place, columns)


def passed_back(runs: RunFilter, rows: Array, k: int) -> Array:
    """L⁻ᵀ times the visits' rows of data (U, M, n): (U, R·V, k, n)."""
    U, R = runs.member.shape
    visits = rows[:, : R * runs.rows].reshape(U, R, runs.rows, -1)
    return runs.transposed(visits).reshape(U, R * runs.rows // k, k, -1)


@dataclass(frozen=True, slots=True, eq=False)
class VisitSpace:
    """A space as single visits of some units are seen in it: precision (U, R·V, k, k) of each with the own known
    columns free; cross (U, R·V, k, c) and readings (U, R·V, k, 1)."""

    precision: Floats
    cross: Floats
    readings: Floats

    @staticmethod
    def of(space: ResidualSpace, k: int) -> "VisitSpace":
        """From the space."""
        runs = space.covariance.runs
        rows = np.concatenate([space.data[..., None], space.shared_basis, space.basis], axis=2)
        readings, cross, own = np.split(passed_back(runs, rows, k), [1, 1 + space.shared_basis.shape[2]], axis=3)
        blocks = runs.precision_blocks(k)[runs.member].reshape(*readings.shape[:2], k, k)
        return VisitSpace(blocks - own @ own.swapaxes(-1, -2), cross, readings)

    def products(self, scan: VisitColumns) -> NormalProducts:
        """The products (1, U, G, …) of a scan."""
        normal = scan.products(self.precision) @ scan.columns
        cross, readings = scan.products(self.cross), scan.products(self.readings)[..., 0]
        return NormalProducts(normal[None], cross[None], readings[None])
