"""Single values of a samples table that a line, a logger or a thermometer corrupted, and what is said of them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.row_place import where_is
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.evaluation.unit_dwells import visit_boundaries
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import corrupt_columns, corrupt_line_columns, outliers
from station.messages import Message

Rows = NDArray[np.intp]


def repaired(recipe: Recipe, table: SampleTable) -> tuple[SampleTable, tuple[Message, ...]]:
    """A sorted table with what its neighbours say in place of corrupt values, and what is said of each column. Rows
    stay, as clocks and counters tell of lost frames by them."""
    begin, end = visit_boundaries(table)
    if not len(begin):
        return table, ()
    reading, off = outliers.replace_outliers(table.reading, begin, end, recipe.reference.strength())
    visit = np.repeat(np.arange(len(begin)), end - begin)
    new_run = (np.diff(table.unit.code[begin], prepend=-1) != 0) | (np.diff(table.run[begin], prepend=-1) != 0)
    run = np.cumsum(new_run)[visit]
    time_s = corrupt_columns.repaired_stamps(table.time_s, visit, run)
    values = {name: _column(recipe, name, read, time_s, (visit, run)) for name, read in table.values.items()}
    said = [*_readings(table, off), *_stamps(table, time_s), *_cells(table, values)]
    gold = table.gold
    if gold is not None:
        gold, off = outliers.replace_outliers(gold, begin, end, recipe.reference.strength())
        said += [_filled(table, "gold_x, gold_y, gold_z", off)] if off.any() else []
    return (replace(table, reading=reading, time_s=time_s, values=values, gold=gold) if said else table), tuple(said)


def _column(recipe: Recipe, name: str, read: Floats, time_s: Floats, of: tuple[Rows, Rows]) -> Floats:
    """A column (n), its corrupt values as far as anything tells what stood there; of: visits and runs (n) by number."""
    visit, run = of
    match name:
        case "temperature_degC":
            return corrupt_columns.repaired_temperatures(read, time_s, visit, run)
        case "since_power_s" | "since_clamp_s":
            return corrupt_line_columns.elapsed(read, time_s, visit, run)
        case "motor":
            return corrupt_line_columns.drives(read, visit, run)
        case "started_s":
            return corrupt_line_columns.starts(read, run)
        case "counter":
            return corrupt_line_columns.counts(read, visit, 2**recipe.device.counter_bits)
        case _:
            return read


def _readings(table: SampleTable, off: Floats) -> Iterator[Message]:
    """What is said of readings that were so far off (n)."""
    if off.any():
        count, time_s = int(np.count_nonzero(off)), float(table.time_s[np.argmax(off)])
        yield Message(
            "reading-outliers", count=count, time_s=time_s, off=float(off.max()), **where_is(table, int(np.argmax(off)))
        )


def _stamps(table: SampleTable, time_s: Floats) -> Iterator[Message]:
    """What is said of stamps that are others now (n)."""
    off = np.abs(table.time_s - time_s)
    if off.any():
        count, worst = int(np.count_nonzero(off)), float(table.time_s[np.argmax(off)])
        yield Message("stamp-outliers", count=count, time_s=worst, **where_is(table, int(np.argmax(off))))


def _cells(table: SampleTable, values: dict[str, Floats]) -> Iterator[Message]:
    """What is said of columns of which values are others now."""
    for name, read in table.values.items():
        if values[name] is not read:
            # What stays missing is equal to nothing.
            other = (values[name] != read) & ~np.isnan(values[name])
            if other.any():
                yield _filled(table, name, other)


def _filled(table: SampleTable, columns: str, other: Array) -> Message:
    """What is said of columns whose values are others now in some rows (n)."""
    rows = int(np.count_nonzero(other))
    return Message(
        "values-filled", column=columns, rows=rows, total=len(table), **where_is(table, int(np.argmax(other)))
    )
