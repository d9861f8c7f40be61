"""Readings that come in several messages: which frames belong together. No Python runs per frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats

Times = NDArray[np.int64]
Rows = NDArray[np.intp]

#: Counters are told apart modulo this; equal ones of a longer counter are so many periods away that time tells.
KEY_VALUES = 1024
_NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class PartFrames:
    """Frames of one part of a reading: time_ns (n), readings (n, k, 3), key (n) or None: a counter."""

    time_ns: Times
    readings: Floats
    key: Array | None

    def __getitem__(self, rows: NDArray[np.bool_]) -> "PartFrames":
        return PartFrames(self.time_ns[rows], self.readings[rows], None if self.key is None else self.key[rows])

    @staticmethod
    def join(parts: "Sequence[PartFrames]") -> "PartFrames":
        """Frames of one part, one after the other."""
        keys = [part.key for part in parts if part.key is not None]
        return PartFrames(
            np.concatenate([part.time_ns for part in parts]),
            np.concatenate([part.readings for part in parts]),
            np.concatenate(keys) if keys else None,
        )


@dataclass(frozen=True, slots=True, eq=False)
class JoinedReadings:
    """rows (m): the leading frames whose reading is whole, None: all; readings (m, k, 3); gaps: readings, between the
    first whole one and the last, of which a message is missing."""

    rows: Rows | None
    readings: Floats
    gaps: int


def join_messages(
    lead: PartFrames, others: "tuple[PartFrames, ...]", within_ns: float | None, key_values: int
) -> JoinedReadings:
    """Puts readings together. Of each other part a frame belongs to the leading frame that has the same key and is
    nearest in time, at most `within_ns` away (None: half a period, with keys half of their turn of `key_values`)."""
    reach_ns = _reach_ns(lead, key_values) if within_ns is None else within_ns
    if len(lead.time_ns) and all(_in_step(lead, other, reach_ns) for other in others):
        together = sum((part.readings for part in others), start=lead.readings)
        return JoinedReadings(None, together, 0)
    readings, whole = lead.readings.copy(), np.ones(len(lead.time_ns), bool)
    matches = [_partners(lead, other, reach_ns) for other in others]
    for other, partner in zip(others, matches, strict=True):
        found = partner != _NONE
        whole &= found
        readings[found] += other.readings[partner[found]]
    rows = np.flatnonzero(whole)
    if not len(rows):
        return JoinedReadings(rows, readings[rows], 0)
    first, last = int(rows[0]), int(rows[-1])
    gaps = last - first + 1 - len(rows)
    for partner in matches:
        inside = partner[first : last + 1]
        used = inside[inside != _NONE]
        gaps += int(used.max() - used.min() + 1 - len(used))  # these have no leading frame
    return JoinedReadings(rows, readings[rows], gaps)


def key_of_sync(time_ns: Times, sync_ns: Times) -> Array:
    """Which SYNC each frame (n) follows: the number of those before it."""
    return np.asarray(np.searchsorted(sync_ns, time_ns, side="right").astype(np.uint64))


def _reach_ns(lead: PartFrames, key_values: int) -> float:
    """Half a period; with keys half of a turn, since equal ones come again after it."""
    if len(lead.time_ns) < 2:
        return float(np.inf)
    period_ns = _median(lead.time_ns[1:] - lead.time_ns[:-1])
    return period_ns * (0.5 if lead.key is None else max(key_values / 2, 0.5))


def _median(values: Times) -> float:
    """As np.median finds it, without what that does beside: few values are a fifth of its time."""
    middle = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, middle)[middle])
    low, high = np.partition(values, (middle - 1, middle))[middle - 1 : middle + 1]
    return (float(low) + float(high)) / 2


def _partners(lead: PartFrames, other: PartFrames, reach_ns: float) -> Rows:
    """Row of `other` for each leading frame (n); −1 where there is none."""
    n = len(lead.time_ns)
    if not len(other.time_ns):
        return np.full(n, _NONE)
    if _in_step(lead, other, reach_ns):
        return np.arange(n)
    at, of = _ranks(lead, other)
    order = np.argsort(of, kind="stable")
    right = np.clip(np.searchsorted(of[order], at), 0, len(order) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.abs(at - of[order[left]]) <= np.abs(at - of[order[right]])
    partner = np.where(nearer, order[left], order[right])
    apart = np.abs(lead.time_ns - other.time_ns[partner])
    fits = apart <= reach_ns
    if lead.key is not None and other.key is not None:
        fits &= lead.key == other.key[partner]
    return _each_once(np.where(fits, partner, _NONE), apart)


def _in_step(lead: PartFrames, other: PartFrames, reach_ns: float) -> bool:
    """Whether the n-th frame of one belongs to the n-th of the other, as it should be."""
    if len(lead.time_ns) != len(other.time_ns):
        return False
    apart = np.abs(lead.time_ns - other.time_ns)
    if lead.key is None or other.key is None:
        return bool((apart <= reach_ns).all())
    # An adapter that held frames back tears some pairs apart; equal counters all along say that none is missing.
    return bool((lead.key == other.key).all()) and _median_within(apart, reach_ns)


def _median_within(apart: Times, reach_ns: float) -> bool:
    """Whether the median is within reach: counted, which takes a tenth of the time, unless just half of them are."""
    near = 2 * int(np.count_nonzero(apart <= reach_ns))
    return near > len(apart) or (near == len(apart) and float(np.median(apart)) <= reach_ns)


def _ranks(lead: PartFrames, other: PartFrames) -> tuple[Times, Times]:
    """Numbers by which frames of one key lie together in the order of time, and far from those of another key."""
    zero = min(int(times.min()) for times in (lead.time_ns, other.time_ns) if len(times))
    times = lead.time_ns - zero, other.time_ns - zero
    if lead.key is None or other.key is None:
        return times
    span = 4 * (max(int(t.max(initial=0)) for t in times) + 1)
    keys = [(key % np.uint64(KEY_VALUES)).astype(np.int64) for key in (lead.key, other.key)]
    return times[0] + span * keys[0], times[1] + span * keys[1]


def _each_once(partner: Rows, apart: Times) -> Rows:
    """A frame belongs to one reading only, the nearest."""
    found = np.flatnonzero(partner != _NONE)
    order = found[np.lexsort((apart[found], partner[found]))]
    again = order[1:][partner[order[1:]] == partner[order[:-1]]]
    if len(again):
        partner = partner.copy()
        partner[again] = _NONE
    return partner
