"""Rows of two lengths, as a slower sensor behind a faster one makes them: the shorter ones end in empty cells."""

from collections import Counter
from dataclasses import replace

import numpy as np

from station.adapters.recordings import dialect
from station.adapters.recordings.dialect import Dialect

#: Of the rows this share has one of two lengths, and each of the two at least so many.
OF_TWO, OF_EACH = 0.98, 0.02
#: Of the shorter rows at least so many columns, and so many longer rows to compare with.
LEAST_COLUMNS, LEAST_LONG = 3, 8
#: The middle of a column's cells in longer rows lies within this share of its cells in shorter ones.
WITHIN = (0.01, 0.99)


def filled(lines: list[str], found: Dialect) -> tuple[list[str], Dialect] | None:
    """Rows of the longer length, with the dialect that has as many columns; None where the rows are even, or are not of
    two lengths whose first columns hold the same."""
    if found.delimiter == " ":
        return None
    rows = [dialect.split(line, found.delimiter, closed=found.closed) for line in lines]
    times = Counter(map(len, rows)).most_common(2)
    if len(times) < 2 or sum(n for _, n in times) < OF_TWO * len(rows) or times[1][1] < OF_EACH * len(rows):
        return None
    short, long = sorted(length for length, _ in times)
    if short < LEAST_COLUMNS or not _go_on(rows, short, long, found.decimal):
        return None
    by = found.delimiter
    whole = [by.join([*cells, *[""] * (long - len(cells))]) for cells in rows]
    names = None if found.names is None else _longer(found.names, long)
    units = (*found.units, *[""] * long)[:long]
    return whole, replace(found, columns=long, names=names, units=units, closed=False)


def _longer(names: tuple[str, ...], columns: int) -> tuple[str, ...]:
    return (*names, *(f"column {i}" for i in range(len(names), columns)))[:columns]


def _go_on(rows: list[list[str]], short: int, long: int, decimal: str) -> bool:
    """Whether longer rows hold in the columns of the shorter ones what those hold, and numbers behind."""
    own = np.array([_numbers(row, decimal) for row in rows if len(row) == short])
    more = np.array([_numbers(row, decimal) for row in rows if len(row) == long])
    if len(more) < LEAST_LONG or np.isnan(own).any() or np.isnan(more).any():
        return False
    low, high = np.quantile(own, WITHIN, axis=0)
    middle = np.median(more[:, :short], axis=0)
    return bool(((low <= middle) & (middle <= high)).all())


def _numbers(row: list[str], decimal: str) -> list[float]:
    return [dialect.cell_value(cell, decimal) for cell in row]
