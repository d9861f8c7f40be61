"""Readings of several sensors in one table, row by row, told apart by a column of their names or numbers."""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels
from station.domain.recognition.raw_table import RawColumn, RawTable

#: Sensors that take turns in a table, at most; each has at least so many rows.
MOST_SENSORS, LEAST_ROWS = 64, 16
#: Names of columns that tell sensors.
_SENSOR = re.compile(r"(^|[^a-z])(id|sensor|device|node|imu|mac|addr|address)($|[^a-z])", re.IGNORECASE)
#: They take turns where so many rows are followed by one of another sensor, and most often by the same other one.
TURNS, IN_TURN = 0.5, 0.8
#: Rows of one sensor follow each other more closely, by this, than rows of different ones: a counter of frames that
#: goes round tells no sensors.
CLOSER = 0.5
#: What a sensor that is turned scatters by, beside the scatter of all.
MOVES = 0.1


def sensors(table: RawTable) -> Iterator[tuple[str, RawTable]]:
    """The name and the table of each sensor that takes turns with others in a table; nothing where none does."""
    for place, column in enumerate(table.columns):
        code = _codes(column)
        called = table.named and _SENSOR.search(column.name) is not None
        if code is None or not _take_turns(code) or not _closer_apart(table, place, code, still=called):
            continue
        for one in np.unique(code):
            rows = np.flatnonzero(code == one)
            name = _name(table.columns[place], int(rows[0]))
            yield name, replace(_rows(table, place, rows), source=f"{table.source}, sensor {name}")
        return


def _codes(column: RawColumn) -> NDArray[np.int64] | None:
    """A number for each row of a column (n) of few labels; None for any other."""
    if column.text is not None:
        return np.asarray(column.text.code, np.int64) if 1 < len(column.text.names) <= MOST_SENSORS else None
    values = column.values
    if values is None or values.dtype.kind not in "iuf" or not np.all(np.isfinite(values)):
        return None
    if len(np.unique(values[: 4 * MOST_SENSORS])) > MOST_SENSORS or np.any(values % 1 != 0):
        return None
    found, code = np.unique(values, return_inverse=True)
    return np.asarray(code, np.int64) if 1 < len(found) <= MOST_SENSORS else None


def _take_turns(code: NDArray[np.int64]) -> bool:
    changes = code[1:] != code[:-1]
    if len(code) < 2 * LEAST_ROWS or np.mean(changes) < TURNS or np.bincount(code).min() < LEAST_ROWS:
        return False
    count = int(code.max()) + 1
    follow = np.bincount(code[:-1] * count + code[1:], minlength=count * count).reshape(count, count)
    return bool(follow.max(axis=1).sum() > IN_TURN * (len(code) - 1))


def _closer_apart(table: RawTable, place: int, code: NDArray[np.int64], *, still: bool) -> bool:
    """Whether the other columns change less from row to row of one sensor than from row to row of the table, and yet
    change in the end: rows of one still pose each are visits. still: the column's name says that it tells sensors,
    which may lie still, too."""
    known = [r for i in table.numeric() if i != place and (r := _ratios(table.numbers(i), code)) is not None]
    closest = sorted(known)[:3]
    if len(closest) < 3 or closest[1][0] >= CLOSER:
        return False
    return still or float(np.median([spread for _, spread in closest])) > MOVES


def _ratios(values: Floats, code: NDArray[np.int64]) -> tuple[float, float] | None:
    """Usual step from row to row and scatter of one sensor's values beside those of all (n); None where all are one."""
    apart, scatter = _usual_step(values), float(np.nanstd(values))
    if not (apart > 0 and scatter > 0):
        return None
    own = [values[code == one] for one in np.unique(code)]
    steps, scatters = [_usual_step(v) for v in own], [float(np.nanstd(v)) for v in own]
    return float(np.median(steps)) / apart, float(np.median(scatters)) / scatter


def _usual_step(values: Floats) -> float:
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if len(steps) else 0.0


def _name(column: RawColumn, row: int) -> str:
    if column.text is not None:
        return str(column.text.names[column.text.code[row]])
    assert column.values is not None
    return f"{float(column.values[row]):g}"


def _rows(table: RawTable, labels: int, rows: NDArray[np.intp]) -> RawTable:
    """Rows of a table; its column of labels stays in its place, as text."""
    columns = list(table[rows].columns)
    columns[labels] = RawColumn(columns[labels].name, None, Labels(("",), np.zeros(len(rows), np.int32)))
    return replace(table[rows], columns=tuple(columns))
