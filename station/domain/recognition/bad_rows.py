"""Rows of a raw table that hold no reading: cells missing, places never filled, codes for "none", impossible values."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.recognition import outliers
from station.domain.recognition.quantities import Quantity
from station.domain.recognition.raw_table import RawTable
from station.errors import SamplesError
from station.messages import Message

#: Readings that are missing may be this share, and rows with one are left out.
MISSING = 0.6
#: More may be rows of other sensors in one log, where so many readings are left.
LEAST_OF_ONE = 50
#: A reading is impossible when it is this many times farther from the middle than all but FAR of the others, and when
#: such are few.
IMPOSSIBLE, FAR, FEW = 5.0, 0.01, 0.002
#: A code for "none" stands in all three columns and is this many times larger than the others.
CODE = 3.0
#: A turn rate of exactly 0 on three axes is no reading where so many rows of it begin or end a recording.
LEAST_UNFILLED = 20

Rows = NDArray[np.intp]


def usable(
    table: RawTable, axes: tuple[int, int, int], time: int | None, quantity: Quantity
) -> tuple[Rows, tuple[Message, ...]]:
    """The rows (k) that hold a reading and its stamp, and what is said of the others. Errors: SamplesError."""
    keep, remarks = _complete(table, (*axes, time))
    raw = np.stack([table.numbers(i) for i in axes], axis=1)
    keep, unfilled = _filled(table.source, raw, keep, quantity)
    return keep, (*remarks, *unfilled)


def corrupt_readings(source: str, raw: Floats) -> tuple[Floats, NDArray[np.bool_], tuple[Message, ...]]:
    """Raw readings (n, 3) in the order of time with what stands beside outliers in their place, which those are (n),
    and what is said of them. They were taken all the same: blocks of so many readings count them."""
    impossible, far = _impossible(source, raw)
    sound = np.flatnonzero(~impossible)
    possible = raw[sound[np.maximum(np.searchsorted(sound, np.arange(len(raw)), side="right") - 1, 0)]]
    # A sensor may read far off zero: what turns it is seen about the middle of its readings.
    size = float(np.median(np.linalg.norm(possible - np.median(possible, axis=0), axis=1)))
    calm, off = outliers.replace_outliers(possible, np.array([0]), np.array([len(raw)]), size)
    count = int(np.count_nonzero(off))
    said = Message("import-reading-outliers", file=source, rows=count, total=len(raw), worst=float(off.max()))
    return calm, impossible | (off > 0), (*far, *((said,) if count else ()))


def _complete(table: RawTable, places: tuple[int | None, ...]) -> tuple[Rows, tuple[Message, ...]]:
    """Rows whose axes and stamp are all there."""
    if len(table) < 2:
        raise SamplesError("no-table-of-numbers", file=table.source)
    whole = np.all([np.isfinite(table.numbers(i)) for i in places if i is not None], axis=0)
    missing = int(np.count_nonzero(~whole))
    own = len(table) - (_of_others(table, places) if whole.sum() >= LEAST_OF_ONE else 0)
    if own - whole.sum() > MISSING * own or whole.sum() < 2:
        raise SamplesError("readings-missing", file=table.source, missing=missing, rows=len(table))
    note = (Message("rows-left-out", file=table.source, rows=missing, total=len(table)),) if missing else ()
    return np.flatnonzero(whole), note


def _of_others(table: RawTable, places: tuple[int | None, ...]) -> int:
    """Rows of other sensors in one log: they have a stamp or, without a clock, numbers of others, and not one axis."""
    *axes, time = places
    none = np.all([~np.isfinite(table.numbers(i)) for i in axes if i is not None], axis=0)
    beside = [time] if time is not None else [i for i in table.numeric() if i not in axes]
    there = np.any([np.isfinite(table.numbers(i)) for i in beside], axis=0) if beside else np.zeros(len(none), bool)
    return int(np.count_nonzero(none & there))


def _filled(source: str, raw: Floats, keep: Rows, quantity: Quantity) -> tuple[Rows, tuple[Message, ...]]:
    """Rows without one number in all three columns that says "none": 0, as in a buffer never filled, where the stimulus
    never vanishes, or a code such as -9999."""
    x, y, z = raw[keep].T
    equal = (x == y) & (y == z)
    usual = float(np.quantile(np.abs(raw[keep][~equal]), 1 - FAR, method="higher")) if not equal.all() else np.inf
    zero = equal & (x == 0)
    if quantity.sizes is None:
        zero = _at_ends(zero)
    empty = zero | (equal & (np.abs(x) > CODE * usual))
    if not empty.any() or empty.sum() > MISSING * len(keep):
        return keep, ()
    worst = float(x[empty][np.argmax(np.abs(x[empty]))])
    note = Message("rows-unfilled", file=source, rows=int(empty.sum()), total=len(keep), value=worst)
    return keep[~empty], (note,)


def _at_ends(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of a mask (n) the runs at either end that are long enough."""
    begins, ends = int(np.argmin(mask)), int(np.argmin(mask[::-1]))
    places = np.arange(len(mask))
    return (places < (begins if begins >= LEAST_UNFILLED else 0)) | (
        places >= len(mask) - (ends if ends >= LEAST_UNFILLED else 0)
    )


def _impossible(source: str, raw: Floats) -> tuple[NDArray[np.bool_], tuple[Message, ...]]:
    """Which single readings (n) are far beyond all others, as a bus that fails for one transfer gives them."""
    middle = np.median(raw, axis=0)
    off = np.abs(raw - middle).max(axis=1)
    reach = float(np.quantile(off, 1 - FAR)) * IMPOSSIBLE + float(np.linalg.norm(middle))
    far = off > reach
    if not 0 < far.sum() <= max(FEW * len(raw), 1):
        return np.zeros(len(raw), bool), ()
    worst = float(raw[off.argmax()][np.argmax(np.abs(raw[off.argmax()] - middle))])
    return far, (Message("readings-impossible", file=source, rows=int(far.sum()), worst=worst),)
