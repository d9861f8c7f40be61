"""Stamps in two columns, whole seconds and what is beyond them, as ROS and `struct timeval` write them."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np

from station.domain.core.types import Array
from station.domain.recognition.raw_table import RawColumn, RawTable

#: Parts of a second that the second column counts: their number, unit and names, the finest first.
_PARTS = (
    (10**9, "ns", re.compile(r"n(ano)?_?sec(ond)?s?$|nanos$|(^|[^a-z])ns$")),
    (10**6, "us", re.compile(r"(u|micro)_?sec(ond)?s?$|micros$|(^|[^a-z])us$")),
    (10**3, "ms", re.compile(r"(m|milli)_?sec(ond)?s?$|millis$|(^|[^a-z])ms$")),
)
_SECONDS = re.compile(r"(^|[^a-z])(tv_?)?s(ec(ond)?s?)?$")
#: Without names seconds are those of an epoch, and their parts so fine that they differ.
LEAST_EPOCH, LEAST_FINE = 10**8, 10**5
#: Of stamps put together so much rises.
RISES = 0.9


def with_whole_stamps(table: RawTable) -> RawTable:
    """The table with each such pair in its first column, as whole parts of a second; the second one holds nothing, so
    that columns keep their numbers."""
    columns = list(table.columns)
    for i, (one, two) in enumerate(pairwise(table.columns)):
        stamps = _together(one, two, named=table.named)
        if stamps is not None:
            columns[i : i + 2] = stamps, replace(two, values=None)
    return replace(table, columns=tuple(columns))


def _together(seconds: RawColumn, parts: RawColumn, *, named: bool) -> RawColumn | None:
    whole, fine = _counts(seconds), _counts(parts)
    if whole is None or fine is None or len(whole) < 3 or fine.min() < 0:
        return None
    if named and not _SECONDS.search(seconds.name.strip().lower()):
        return None
    if not named and (whole.min() < LEAST_EPOCH or fine.max() < LEAST_FINE):
        return None
    told = [p for p in _PARTS if (p[2].search(parts.name.strip().lower()) if named else p[0] > LEAST_FINE)]
    for number, unit, _ in reversed(told):
        if fine.max() >= number or np.abs(whole).max() > 2**62 // number:
            continue
        stamps = whole * number + fine
        if np.mean(np.diff(stamps) > 0) > RISES and _wraps(whole, fine):
            return replace(seconds, values=stamps, unit=unit)
    return None


def _wraps(whole: Array, fine: Array) -> bool:
    """Whether the parts begin anew where the seconds go on."""
    on = np.diff(whole) == 1
    return not on.any() or bool(np.mean(np.diff(fine)[on] < 0) > RISES)


def _counts(column: RawColumn) -> Array | None:
    """Whole numbers (n) of a column; None where it holds others."""
    if column.values is None:
        return None
    values = np.asarray(column.values)
    whole = values.dtype.kind != "f" or (
        bool(np.isfinite(values).all()) and not np.any(values % 1) and np.abs(values).max(initial=0) <= 2**53
    )
    return values.astype(np.int64) if whole else None
