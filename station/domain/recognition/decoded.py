"""Decoded CAN signals → raw tables, one a message: from frames, or from the rows that a decoded log was written as."""

from collections.abc import Iterable

import numpy as np

from station.domain.can.signals import FrameLayout, decode
from station.domain.core.types import Frames
from station.domain.recognition.raw_table import RawColumn, RawTable

#: The columns of a decoded log, one row a signal value.
LONG_FORM = ("time_ns", "message", "signal", "value")
#: Readings that make a recording.
LEAST = 8


def of_frames(source: str, frames: Frames, layouts: Iterable[FrameLayout]) -> list[RawTable]:
    """A table of each message that was received: its stamps and its signals."""
    tables = []
    for layout in layouts:
        found = decode(frames, layout)
        if len(found.rows) < LEAST:
            continue
        stamps = RawColumn("time_ns", frames.time_ns[found.rows], None, "ns")
        columns = [RawColumn(s.name, found.values[s.name], None, s.unit) for s in layout.signals]
        tables.append(RawTable(f"{source}, message {layout.name}", (stamps, *columns)))
    return tables


def of_long_form(table: RawTable) -> list[RawTable]:
    """Of a table with one row a signal value the tables of its messages; the table itself where it is none such."""
    places = {column.name: i for i, column in enumerate(table.columns)}
    if not all(name in places for name in LONG_FORM):
        return [table]
    time_ns, message, signal, value = (table.columns[places[name]] for name in LONG_FORM)
    if message.text is None or signal.text is None or value.values is None or time_ns.values is None:
        return [table]
    tables = []
    for code, name in enumerate(message.text.names):
        rows = np.flatnonzero(message.text.code == code)
        stamps, place = np.unique(time_ns.values[rows], return_inverse=True)
        if len(stamps) < LEAST:
            continue
        columns = []
        for kind in np.unique(signal.text.code[rows]).tolist():
            cells = np.full(len(stamps), np.nan)
            own = signal.text.code[rows] == kind
            cells[place[own]] = np.asarray(value.values, float)[rows[own]]
            columns.append(RawColumn(signal.text.names[kind], cells))
        tables.append(RawTable(f"{table.source}, message {name}", (RawColumn("time_ns", stamps, None, "ns"), *columns)))
    return tables or [table]
