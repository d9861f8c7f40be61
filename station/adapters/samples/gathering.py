"""A samples table put together from pieces: each is copied to its place and let go, so that no row is there twice."""

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

import numpy as np

from station.domain.core.types import Array, Labels, SampleTable

#: By how much room grows that was too little.
GROWTH = 1.5
#: Columns that every table has.
PLAIN, TEXT = ("run", "visit", "time_s", "reading"), ("unit", "position")


def gather(pieces: Iterator[SampleTable], room: int) -> SampleTable:
    """One table of at least one piece, of about so many rows together; a column that not all of them have is left
    out."""
    first, second = next(pieces), next(pieces, None)
    if second is None:
        return first
    columns = {name: _LabelColumn(c, room) if isinstance(c, Labels) else _Column(c, room) for name, c in _of(first)}
    count, every = 0, chain([first, second], pieces)
    del first, second
    for piece in every:
        own = dict(_of(piece))
        columns = {name: column for name, column in columns.items() if name in own}
        for name, column in columns.items():
            column.put(count, own[name])
        count += len(piece)
    return _table({name: column.rows(count) for name, column in columns.items()})


class _Column:
    """Numbers row by row, in one array that has room for more."""

    def __init__(self, first: Array, room: int) -> None:
        # Pages that nobody writes to are not there.
        self._held = np.empty((max(room, len(first)), *first.shape[1:]), first.dtype, order="F")

    def put(self, at: int, values: Array) -> None:
        """The values of rows from a place on."""
        end = at + len(values)
        if end > len(self._held):
            room = max(end, int(GROWTH * len(self._held)))
            grown = np.empty((room, *self._held.shape[1:]), self._held.dtype, order="F")
            grown[:at] = self._held[:at]
            self._held = grown
        self._held[at:end] = values

    def rows(self, count: int) -> Array:
        """All of them."""
        return self._held[:count]


class _LabelColumn:
    """Text: codes, and names in the order in which they come."""

    def __init__(self, first: Labels, room: int) -> None:
        self._codes, self._names = _Column(first.code, room), dict[str, int]()

    def put(self, at: int, values: Labels) -> None:
        """The text of rows from a place on."""
        place = np.array([self._names.setdefault(name, len(self._names)) for name in values.names], np.int32)
        self._codes.put(at, place[values.code])

    def rows(self, count: int) -> Labels:
        """All of them."""
        return Labels(tuple(self._names), self._codes.rows(count))


def _of(table: SampleTable) -> Iterator[tuple[str, Any]]:
    """Every column with its name."""
    yield from ((name, getattr(table, name)) for name in (*PLAIN, *TEXT))
    yield from table.labels.items()
    yield from table.values.items()
    if table.gold is not None:
        yield "gold", table.gold


def _table(columns: Mapping[str, Any]) -> SampleTable:
    more = {name: c for name, c in columns.items() if name not in (*PLAIN, *TEXT, "gold")}
    labels = {name: c for name, c in more.items() if isinstance(c, Labels)}
    values = {name: c for name, c in more.items() if not isinstance(c, Labels)}
    plain = {name: columns[name] for name in (*PLAIN, *TEXT)}
    return SampleTable(**plain, labels=labels, values=values, gold=columns.get("gold"))
