"""Tables with a row for each axis, as statistics programs want them → tables with a row for each reading."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from station.domain.core.types import Floats, Labels
from station.domain.recognition import axis_names
from station.domain.recognition.raw_table import RawColumn, RawTable

#: Names of sensors and axes, at most; an axis is read at least so often, and as often as another to within this share.
MOST_NAMES, LEAST, COUNT_SPREAD = 48, 8, 0.01
#: Columns of numbers beside the readings: a stamp, a counter, a temperature.
MOST_OTHERS = 3


def of_rows_by_axis(table: RawTable) -> RawTable:
    """The table itself where a column of its names no axes.

    Its last column of numbers holds the readings: the k-th of each axis is of the k-th row, whose other numbers are
    those beside the first axis. Other columns of names tell sensors apart.
    """
    axis = next((i for i, c in enumerate(table.columns) if c.text is not None and _names_axes(c.text)), None)
    numbers = table.numeric()
    if axis is None or not 1 <= len(numbers) <= MOST_OTHERS + 1 or _has_axes(table, numbers):
        return table
    value, others = table.columns[numbers[-1]], [table.columns[i] for i in numbers[:-1]]
    names = _full_names(table.columns, axis)
    rows = {name: np.flatnonzero(names.code == code) for code, name in enumerate(names.names)}
    if not _equally_often([len(r) for r in rows.values()]):
        return table
    count = min(map(len, rows.values()))
    first = next(iter(rows.values()))[:count]
    readings = _floats(value)
    columns = [c[first] for c in others]
    columns += [RawColumn(name, readings[r[:count]], None, value.unit) for name, r in rows.items()]
    return replace(table, columns=tuple(columns))


def _has_axes(table: RawTable, numbers: Sequence[int]) -> bool:
    """Whether columns of numbers are axes already, and the names those of poses."""
    return any(axis_names.triples((i, table.columns[i].name) for i in numbers))


def _names_axes(text: Labels) -> bool:
    return 3 <= len(text.names) <= MOST_NAMES and axis_names.are_lettered(n.strip() for n in text.names)


def _full_names(columns: Sequence[RawColumn], axis: int) -> Labels:
    """Names of the axes with those of their sensors before them, where other columns tell sensors apart."""
    own = columns[axis].text
    assert own is not None
    texts = [c.text for i, c in enumerate(columns) if i != axis and c.text is not None]
    sensors = [t for t in texts if 1 < len(t.names) <= MOST_NAMES]
    if not sensors:
        return own.used()
    parts = [t.text() for t in (*sensors, own)]
    return Labels.of([" ".join(str(p) for p in row) for row in zip(*parts, strict=True)])


def _equally_often(counts: Sequence[int]) -> bool:
    return min(counts) >= LEAST and max(counts) - min(counts) <= max(1, COUNT_SPREAD * max(counts))


def _floats(column: RawColumn) -> Floats:
    return np.asarray(column.values, float)
