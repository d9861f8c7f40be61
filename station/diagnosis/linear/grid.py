"""Visits laid out by unit and run, so that one pass of arithmetic serves all units.

A unit's data are a vector of R runs × m rows, m = V visits × k numbers a visit: k = 3 readings, or 1 where only the
magnitude is known. Runs with fewer visits, and units with fewer runs, are filled with rows of zeros.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.linear.projection import ALL_UNITS, DataColumns
from station.diagnosis.linear.run_filter import block_visits
from station.domain.core.types import Array, Floats
from station.model.visit_table import VisitTable


@dataclass(frozen=True, slots=True, eq=False)
class VisitGrid:
    """slot (U, R, V): index of the visit, −1 where there is none; k: numbers a visit."""

    slot: NDArray[np.intp]
    k: int

    @property
    def units(self) -> int:
        """Number of units."""
        return int(self.slot.shape[0])

    @property
    def rows(self) -> int:
        """Numbers of one unit, the filled ones counted."""
        return int(self.slot[0].size) * self.k

    @property
    def data(self) -> int:
        """Numbers measured."""
        return int(np.count_nonzero(self.slot >= 0)) * self.k

    def spread(self, values: Floats) -> Floats:
        """Values of the visits (v, k, c) as (U, R, V·k, c); zeros where there is no visit."""
        U, R, V = self.slot.shape
        shape = (U, R, V * self.k, values.shape[2])
        if self.slot.size == len(values) and np.all(self.slot >= 0):
            # Nothing is missing: the visits are in this order already.
            return np.asarray(values.reshape(shape))
        padded = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
        return np.asarray(padded[self.slot].reshape(shape))

    def gathered(self, rows: Floats) -> Floats:
        """Values (v, c) of the visits from one row of each (U, R, V, c)."""
        there = self.slot >= 0
        out = np.empty((int(np.count_nonzero(there)), rows.shape[3]))
        out[self.slot[there]] = rows[there]
        return out

    def part(self, units: slice) -> tuple["VisitGrid", slice]:
        """The grid of some neighbouring units alone, and their visits."""
        slot = self.slot[units]
        first, last = int(slot[0, 0, 0]), int(slot[-1].max()) + 1
        return VisitGrid(np.where(slot >= 0, slot - first, -1), self.k), slice(first, last)

    def parts(self, units: int) -> "Iterator[slice]":
        """Units, so many at a time."""
        for first in range(0, self.units, units):
            yield slice(first, min(first + units, self.units))


@dataclass(frozen=True, slots=True, eq=False)
class RowLayout:
    """How numbers of the visits (v) become rows: the grid; keep (v, k, 3) from readings to numbers kept; sigma of a
    contrast, or of each contrast and axis (B−1, k); unit (v) of each visit; apart (3, 3) what takes off the contrasts
    what the axes share, blocks_apart (B−1, B−1) what the contrasts of an axis do, None where they share nothing."""

    grid: VisitGrid
    keep: Floats
    sigma: float | Floats
    unit: Array
    apart: Floats | None = None
    blocks_apart: Floats | None = None

    @property
    def keeps_axes_apart(self) -> bool:
        """Whether a column of one axis is one of one number of each visit, and each run is whitened as one block."""
        one_block = block_visits(self.grid.slot.shape[2], self.grid.k)[0] == 1
        return one_block and self.grid.k == 3 and not np.any(self.keep * (1 - np.eye(3)))

    def axis_gain(self, units: slice) -> Floats:
        """What is kept of each axis at the visits of some units (U, R, V, 3), where axes are kept apart."""
        grid, visits = self.grid.part(units)
        return VisitGrid(grid.slot, 1).spread(np.einsum("vii->vi", self.keep[visits])[:, None])

    def rows(self, visit: Floats, dwell: Floats | None) -> DataColumns:
        """Columns of readings (v, 3, c) and contrasts (v, B−1, 3, c) laid out by unit."""
        if dwell is not None:
            dwell = self.scaled(dwell)
            dwell = dwell.reshape(len(dwell), -1, dwell.shape[-1])
        return self.columns(self.keep @ visit, dwell)

    def columns(self, retained: Floats, dwell: Floats | None, units: slice = ALL_UNITS) -> DataColumns:
        """Numbers kept of the visits of some units (v, k, c) and contrasts (v, (B−1)·k, c), laid out by unit."""
        grid = self.grid.part(units)[0]
        if dwell is None:
            return DataColumns(grid.spread(retained))
        inside = VisitGrid(grid.slot, dwell.shape[1]).spread(dwell)
        return DataColumns(grid.spread(retained), inside.reshape(grid.units, -1, dwell.shape[-1]))

    def scaled(self, dwell: Floats, visits: slice = ALL_UNITS) -> Floats:
        """Contrasts (v, B−1, 3, c) as `within` has them, in units of their noise."""
        inside = np.asarray(self.within(dwell, visits) / np.asarray(self.sigma)[..., None])
        return inside if self.blocks_apart is None else np.einsum("ab,vbkc->vakc", self.blocks_apart, inside)

    def within(self, dwell: Floats, visits: slice = ALL_UNITS) -> Floats:
        """Contrasts (v, B−1, 3, c) of which the axes share nothing, or along the stimulus alone (v, B−1, 1, c) where a
        hand may turn."""
        if self.grid.k == 3:
            return dwell if self.apart is None else np.asarray(self.apart @ dwell)
        keep = self.keep[visits, 0]
        along = keep / np.linalg.norm(keep, axis=1, keepdims=True)
        return np.asarray(np.einsum("vi,vbi...->vb...", along, dwell)[:, :, None])

    def of_units(self, chosen: Array) -> "tuple[RowLayout, Array]":
        """The layout of the chosen units (in order) alone, and which visits (v) are theirs."""
        theirs = np.isin(self.unit, chosen)
        slot = self.grid.slot[chosen]
        slot = np.where(slot >= 0, (np.cumsum(theirs) - 1)[slot], -1)
        unit = np.searchsorted(chosen, self.unit[theirs])
        return replace(self, grid=VisitGrid(slot, self.grid.k), keep=self.keep[theirs], unit=unit), theirs


def visit_grid(visits: VisitTable, k: int) -> VisitGrid:
    """The layout of visits that are sorted by unit, run and visit."""
    starts = np.flatnonzero(visits.previous < 0)
    length = np.diff(np.append(starts, len(visits)))
    unit = visits.unit.code[starts]
    run = np.arange(len(starts)) - np.searchsorted(unit, unit)
    slot = np.full((len(visits.unit.names), int(run.max(initial=0)) + 1, int(length.max(initial=1))), -1)
    for u, r, a, n in zip(unit, run, starts, length, strict=True):
        slot[u, r, :n] = np.arange(a, a + n)
    return VisitGrid(slot, k)
