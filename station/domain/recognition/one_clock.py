"""Signals that came at stamps of their own, one axis each, on the clock of the first of them."""

from collections.abc import Sequence

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition import axis_names
from station.domain.recognition.raw_table import RawColumn, RawTable

#: Signals of one sensor come equally often, to within this share.
COUNT_SPREAD = 0.1


def joined(tables: Sequence[RawTable]) -> RawTable | None:
    """A table of the axes that lie in several tables, whose first columns are stamps in one unit; None where none do.

    A row holds what each axis read nearest to the stamp of the first.
    """
    places = [(t, c) for t, table in enumerate(tables) for c in range(1, len(table.columns))]
    names = [tables[t].columns[c].name for t, c in places]
    groups = [axes for _, axes in axis_names.triples(enumerate(names)) if _apart([places[i][0] for i in axes], tables)]
    if not groups:
        return None
    first = tables[places[groups[0][0]][0]]
    stamps = first.numbers(0)
    taken = dict.fromkeys(i for axes in groups for i in axes)
    columns = [_nearest(stamps, tables[places[i][0]], places[i][1]) for i in taken]
    return RawTable(first.source, (first.columns[0], *columns), first.named, first.rate_hz)


def _apart(own: Sequence[int], tables: Sequence[RawTable]) -> bool:
    """Whether axes lie in different tables of one length, about."""
    counts = [len(tables[t]) for t in own]
    return len(set(own)) > 1 and max(counts) - min(counts) <= COUNT_SPREAD * max(counts)


def _nearest(stamps: Floats, table: RawTable, place: int) -> RawColumn:
    own = table.numbers(0)
    after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
    return table.columns[place][np.where(stamps - own[after - 1] < own[after] - stamps, after - 1, after)]
