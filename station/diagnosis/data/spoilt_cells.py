"""Single cells of a samples table that a line, a logger or a thermometer spoilt, and what is said of them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from station.domain.core.types import Array, Floats, SampleTable
from station.domain.evaluation.unit_dwells import visit_boundaries
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import spoilt_columns, wild_readings
from station.messages import Message


def mended(recipe: Recipe, table: SampleTable) -> tuple[SampleTable, tuple[Message, ...]]:
    """A sorted table with what its neighbours say in place of spoilt readings, stamps and temperatures, and what is
    said of each kind. Rows stay, as clocks and counters tell of lost frames by them."""
    begin, end = visit_boundaries(table)
    if not len(begin):
        return table, ()
    reading, off = wild_readings.calmed(table.reading, begin, end, recipe.reference.strength())
    visit = np.repeat(np.arange(len(begin)), end - begin)
    new_run = (np.diff(table.unit.code[begin], prepend=-1) != 0) | (np.diff(table.run[begin], prepend=-1) != 0)
    run = np.cumsum(new_run)[visit]
    time_s = spoilt_columns.stamps(table.time_s, visit, run)
    said = [*_readings(table, off), *_stamps(table, time_s)]
    values = dict(table.values)
    if (read := table.values.get("temperature_degC")) is not None:
        values["temperature_degC"], filled = spoilt_columns.temperatures(read, time_s, visit, run)
        if filled.any():
            rows = int(np.count_nonzero(filled))
            said.append(Message("temperatures-filled", rows=rows, total=len(table), **_place(table, filled)))
    return (replace(table, reading=reading, time_s=time_s, values=values) if said else table), tuple(said)


def _readings(table: SampleTable, off: Floats) -> Iterator[Message]:
    """What is said of readings that were so far off (n)."""
    if off.any():
        count, time_s = int(np.count_nonzero(off)), float(table.time_s[np.argmax(off)])
        yield Message("wild-readings", count=count, time_s=time_s, off=float(off.max()), **_place(table, off))


def _stamps(table: SampleTable, time_s: Floats) -> Iterator[Message]:
    """What is said of stamps that are others now (n)."""
    off = np.abs(table.time_s - time_s)
    if off.any():
        count, worst = int(np.count_nonzero(off)), float(table.time_s[np.argmax(off)])
        yield Message("wild-stamps", count=count, time_s=worst, **_place(table, off))


def _place(table: SampleTable, size: Array) -> dict[str, str | int]:
    """Where the greatest of sizes (n) is."""
    row = int(np.argmax(size))
    return {
        "serial": table.unit.names[table.unit.code[row]],
        "run": int(table.run[row]),
        "visit": int(table.visit[row]),
        "position": table.position.names[table.position.code[row]],
    }
