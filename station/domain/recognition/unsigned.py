"""Counts below zero that a logger wrote as unsigned numbers: -1 as 65535."""

from dataclasses import replace

import numpy as np

from station.domain.core.types import Array, Floats
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.messages import Message

BITS = (8, 10, 12, 14, 16, 20, 24, 32)
#: Neighbours that are farther apart than this share of the range wrapped; so many show that a column wraps, if
#: so many times more readings are at the ends of the range than in its middle.
WRAP, LEAST_WRAPS, MORE_AT_ENDS = 0.75, 5, 5
#: Readings about zero leave this middle part of the range empty, whatever their scale, and lie on either side of it.
EMPTY, LEAST_SHARE = (0.375, 0.625), 0.005


def signed(table: RawTable) -> RawTable:
    """The table with such columns below zero where they are; any other as it is."""
    found = [bits for c in table.columns if (bits := _bits(c.values))]
    if not found:
        return table
    span = float(2 ** max(found))
    columns = tuple(_column(c, span) for c in table.columns)
    note = Message("counts-unsigned", file=table.source, bits=max(found))
    return replace(table, columns=columns, remarks=(*table.remarks, note))


def _column(column: RawColumn, span: float) -> RawColumn:
    values = _counts(column.values)
    if values is None or _never_falls(values) or values.max() >= span:
        return column
    if _in_middle(values, span) and not _wraps(values, span):
        return column
    return replace(column, values=np.where(values >= span / 2, values - span, values))


def _bits(values: Array | None) -> int:
    """The bits of a column (n) that wraps below zero; 0 where none shows."""
    counts = _counts(values)
    if counts is None or _never_falls(counts):
        return 0
    bits = next((b for b in BITS if counts.max() < 2**b), 0)
    span = float(2**bits)
    low, high = np.mean(counts < EMPTY[0] * span), np.mean(counts > EMPTY[1] * span)
    apart = bits and min(low, high) > LEAST_SHARE and not _in_middle(counts, span)
    return bits if apart or (bits and _wraps(counts, span)) else 0


def _wraps(counts: Floats, span: float) -> bool:
    """Whether counts (n) jump from one end of the range to the other and back, as those about zero do, and few lie
    about the middle, where the sign changes."""
    jumps = int(np.count_nonzero(np.abs(np.diff(counts)) > WRAP * span))
    ends = np.count_nonzero(np.minimum(counts, span - counts) < span / 16)
    middle = np.count_nonzero(np.abs(counts - span / 2) < span / 32)
    return bool(jumps >= LEAST_WRAPS and ends > MORE_AT_ENDS * middle)


def _counts(values: Array | None) -> Floats | None:
    """Whole numbers from 0 of which there are many; None for anything else."""
    if values is None or len(values) < 20 or values.dtype.kind not in "iuf":
        return None
    numbers = np.asarray(values, float)
    known = numbers[np.isfinite(numbers)]
    if len(known) < len(numbers) or known.min() < 0 or known.max() < 128 or np.any(known % 1 != 0):
        return None
    return numbers if len(np.unique(known)) > 8 else None


def _never_falls(values: Floats) -> bool:
    return bool(np.mean(np.diff(values) < 0) < 0.02)


def _in_middle(values: Floats, span: float) -> bool:
    return bool(np.mean((values > EMPTY[0] * span) & (values < EMPTY[1] * span)) > 0.001)
