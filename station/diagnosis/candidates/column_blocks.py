"""The columns of a bank in blocks that are whitened and multiplied together.

Most columns move a single axis, and so need a third of the numbers and of the factors that whiten them. The columns of
a cause that acts in each run separately are zero in all other runs: they are stored once and evaluated run by run.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import Bank
from station.diagnosis.candidates.bank_columns import BankColumns, scattered
from station.diagnosis.linear.evidence import Pattern
from station.diagnosis.linear.grid import RowLayout, VisitGrid
from station.diagnosis.linear.projection import AxisColumns, DataColumns

#: Columns whitened together at the most, a megabyte and a half of eight units of 216 readings.
COLUMNS_AT_ONCE = 96


class ShapeGroup(NamedTuple):
    """Candidates of the same shape: which, their pattern, groups within a unit, and the sets of columns (b) of the
    block that they use; several may use one."""

    which: tuple[int, ...]
    pattern: Pattern
    groups: int
    sets: NDArray[np.intp]


class ColumnBlock(NamedTuple):
    """Sets of columns of one width, and the candidates that see them.

    by_run: the groups are the runs, and the columns are those of all of them; axes: which columns of each group move
    each axis (3), where each moves one axis alone, else none.
    """

    made: tuple[BankColumns, ...]
    width: int
    by_run: bool
    axes: tuple[slice, ...]
    kinds: tuple[ShapeGroup, ...]

    @property
    def one_axis(self) -> bool:
        """Whether each column moves one axis alone."""
        return bool(self.axes)

    @property
    def groups(self) -> int:
        """Into how many groups every set falls of which no candidate sees more than one at a time."""
        return math.gcd(*(kind.groups if kind.pattern == "scan" else 1 for kind in self.kinds))

    def rows(self, bank: Bank, layout: RowLayout, units: slice) -> Iterator[DataColumns | AxisColumns]:
        """The columns of some units, some sets at a time, few enough for a processor's cache."""
        step = max(1, COLUMNS_AT_ONCE // self.width)
        for first in range(0, len(self.made), step):
            some = self.made[first : first + step]
            if self.by_run:
                some = tuple(m._replace(at=slice(0, m.columns.count)) for m in some)
            yield _axis_columns(some, layout, units) if self.one_axis else bank.rows(layout, units, some)


def _axis_columns(made: Sequence[BankColumns], layout: RowLayout, units: slice) -> AxisColumns:
    """Columns as they are before a gain of each axis (`axis_gain`) is taken off."""
    grid, visits = layout.grid.part(units)
    parts = [m.columns.on_their_axes(visits) for m in made]
    if all(m.groups == 1 for m in made):
        values = np.concatenate(parts, axis=1, dtype=float)[:, None]
    else:
        values = scattered(made, [part[:, None] for part in parts], visits)
    axes = np.concatenate([m.columns.axis for m in made for _ in range(m.groups)])
    return AxisColumns(VisitGrid(grid.slot, 1).spread(values), axes)


def column_blocks(bank: Bank, layout: RowLayout, *, whole: bool) -> list[ColumnBlock]:
    """The columns of a bank by width; `whole`: as the bank has them, in its order."""
    runs, plain = _run_of_visit(layout.grid), whole or bank.moving
    separate = not plain and layout.keeps_axes_apart
    of_shape: dict[tuple[int, bool, tuple[range, ...]], list[BankColumns]] = {}
    for m in bank.made:
        width, axes = m.at.stop - m.at.start, m.columns.count
        by_run = not plain and width == axes * layout.grid.slot.shape[1] > axes and np.array_equal(m.code, runs)
        places = _places_of_axes(m, by_run=by_run) if separate and m.columns.on_one_axis else ()
        # What the bank has laid out already is not split.
        by_run = by_run and (bool(places) or bank.all_columns is None)
        of_shape.setdefault((axes if by_run else width, by_run, places), []).append(m)
    seen: dict[int, list[int]] = {}
    for i, (c, at) in enumerate(zip(bank.candidates, bank.place, strict=True)):
        if not c.scans_visits:
            seen.setdefault(at.start, []).append(i)
    return [_block(bank, seen, tuple(made), *shape) for shape, made in of_shape.items()]


def _places_of_axes(made: BankColumns, *, by_run: bool) -> tuple[range, ...]:
    """Which columns of a set move each axis (3), each one alone; none where those of an axis are not evenly spaced."""
    return _evenly_spaced(tuple(made.columns.axis.tolist()), 1 if by_run else made.groups)


@cache
def _evenly_spaced(axes: tuple[int, ...], groups: int) -> tuple[range, ...]:
    axis = axes * groups
    where = [[k for k, a in enumerate(axis) if a == i] for i in range(3)]
    if not all(where):
        return ()
    even = tuple(range(at[0], at[-1] + 1, at[1] - at[0] if len(at) > 1 else 1) for at in where)
    return even if all(list(r) == at for r, at in zip(even, where, strict=True)) else ()


def _block(
    bank: Bank,
    seen: Mapping[int, list[int]],
    made: tuple[BankColumns, ...],
    width: int,
    by_run: bool,
    places: tuple[range, ...],
) -> ColumnBlock:
    """A block of some sets; seen: the candidates that see the set that begins at a column."""
    alike: dict[tuple[Pattern, int], list[tuple[int, int]]] = {}
    for place, m in enumerate(made):
        for i in seen[m.at.start]:
            c, groups = bank.candidates[i], bank.groups[i]
            alike.setdefault((c.pattern, groups if c.pattern == "scan" else 1), []).append((i, place))
    kinds = (
        ShapeGroup(tuple(i for i, _ in found), *shape, np.array([at for _, at in found], np.intp))
        for shape, found in alike.items()
    )
    axes = tuple(slice(r.start, r.stop, r.step) for r in places)
    return ColumnBlock(made, width, by_run, axes, tuple(kinds))


def _run_of_visit(grid: VisitGrid) -> NDArray[np.intp]:
    """The run (v) within its unit that each visit is in."""
    there = grid.slot >= 0
    runs = np.empty(int(np.count_nonzero(there)), np.intp)
    runs[grid.slot[there]] = np.nonzero(there)[1]
    return runs
