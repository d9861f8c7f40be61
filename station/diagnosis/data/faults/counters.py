"""Lost, repeated and reordered frames, from the frame counter, visit by visit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import FaultParameter, GrossFault, block_gain, halves_of, unit_label
from station.diagnosis.data.faults.tone_power import NORMAL_95
from station.domain.core.types import Floats, SampleTable
from station.domain.methods import coverage
from station.domain.recipe.recipe import Recipe

#: Events in the whole table from which a bus is not healthy.
MIN_EVENTS = 2
#: By so many more events the square root of a count is what 1.96 of it cover the mean with, be it as small as two.
MORE_EVENTS = 2
#: Chance of an event on a healthy bus, for the evidence.
HEALTHY_EVENT_RATE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FrameTally:
    """Per visit (v): its unit; frames sent, arrived, different; and how often one stepped back."""

    unit: NDArray[np.intp]

    sent: NDArray[np.int64]
    arrived: NDArray[np.int64]
    different: NDArray[np.int64]
    stepped_back: NDArray[np.int64]

    @property
    def is_whole(self) -> bool:
        """Whether every frame arrived once and in order."""
        return bool(
            np.all(self.sent == self.different)
            and np.all(self.arrived == self.different)
            and not self.stepped_back.any()
        )


def unwrapped(counter: Floats, visit: NDArray[np.intp], bits: int) -> NDArray[np.int64]:
    """The counter (n) without its overflow, starting anew in each visit."""
    span = 1 << bits
    whole = counter.astype(np.int64)
    step = np.asarray((np.diff(whole, prepend=whole[:1]) + span // 2) % span - span // 2, np.int64)
    step[np.flatnonzero(np.diff(visit, prepend=-1))] = 0
    total = np.cumsum(step)
    first = np.flatnonzero(np.diff(visit, prepend=-1))
    return np.asarray(total - np.repeat(total[first], np.diff(np.append(first, len(visit)))))


def tally(table: SampleTable, visit: NDArray[np.intp], bits: int) -> FrameTally:
    """What arrived. visit (n): index of the visit, rising; rows of a visit in the order of arrival."""
    number = unwrapped(table.values["counter"], visit, bits)
    first = np.flatnonzero(np.diff(visit, prepend=-1))
    unit = table.unit.code[first]
    low, high = np.minimum.reduceat(number, first), np.maximum.reduceat(number, first)
    step, within = np.diff(number, prepend=number[:1]), np.diff(visit, prepend=-1) == 0
    back = np.add.reduceat((step < 0) & within, first)
    arrived = np.diff(np.append(first, len(visit)))
    different = arrived.copy()
    # Numbers that only rise are all different; the few other visits are sorted.
    risen = np.logical_and.reduceat((step > 0) | ~within, first)
    for s in np.flatnonzero(~risen):
        different[s] = len(np.unique(number[first[s] : first[s] + arrived[s]]))

    return FrameTally(unit.astype(np.intp), high - low + 1, arrived, different, back)


def repeats(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which frames (n) came before already, number and reading: what a bus repeats tells nothing more of the sensor."""
    number = unwrapped(table.values["counter"], visit, recipe.device.counter_bits)
    order = np.lexsort((number, visit))
    same = (np.diff(visit[order]) == 0) & (np.diff(number[order]) == 0)
    same &= (table.reading[order[1:]] == table.reading[order[:-1]]).all(axis=1)
    out = np.zeros(len(table), bool)
    out[order[1:]] = same
    return out


def faults(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp]) -> list[GrossFault]:
    """What the counter shows; nothing where there is none."""
    if "counter" not in table.values:
        return []
    t = tally(table, visit, recipe.device.counter_bits)
    found = [
        ("lost-frames", t.sent - t.different, t.sent, "are missing"),
        ("duplicated-frames", t.arrived - t.different, t.different, "arrived twice"),
        ("reordered-frames", t.stepped_back, t.arrived, "were overtaken"),
    ]
    return [
        _fault(name, t.unit, events, of, verb, table) for name, events, of, verb in found if events.sum() >= MIN_EVENTS
    ]


def _fault(
    name: str,
    unit: NDArray[np.intp],
    events: NDArray[np.int64],
    of: NDArray[np.int64],
    verb: str,
    table: SampleTable,
) -> GrossFault:
    """From the events of each visit (v) among so many frames (v)."""
    units = len(table.unit.names)
    hits, tries = (np.bincount(unit, x, units) for x in (events, of))
    share = hits / np.maximum(tries, 1)
    std = [_share_std(events[unit == u], of[unit == u]) for u in range(units)]
    numbers = tuple(
        FaultParameter("fraction", None, unit_label(table.unit, u), float(share[u]), float(std[u]), "1")
        for u in range(units)
    )
    total, all_of = int(events.sum()), int(of.sum())
    nats = total * np.log(total / all_of / HEALTHY_EVENT_RATE) - total + HEALTHY_EVENT_RATE * all_of
    # Units that lose nothing say nothing about the others.
    mine = hits[unit] > 0
    gain = block_gain(_held_out_scores(events[mine], of[mine]), of[mine].astype(float), "frame")
    return GrossFault(name, "unit", numbers, f"{total} of {all_of} frames {verb}", float(nats), gain=gain)


def _share_std(events: NDArray[np.int64], of: NDArray[np.int64]) -> float:
    """Standard deviation of the share of events in visits (v) of so many frames, of which 1.96 cover 95 %. Frames are
    lost in bursts: where visits differ by more than single losses would have it, the bursts count."""
    total, tries = int(events.sum()), max(int(of.sum()), 1)
    share, free = total / tries, len(events) - 1
    expected = of * share * (1 - share)
    burst = float(np.sum((events - of * share) ** 2 / np.maximum(expected, 1e-300))) / free if total and free else 1.0
    if burst < 1 + np.sqrt(2 / max(free, 1)):
        return float(np.sqrt((total + MORE_EVENTS) * (1 - share))) / tries
    widened = float(coverage.factor(np.array(float(free)))) / NORMAL_95
    return widened * float(np.sqrt(burst * (total + MORE_EVENTS * burst) * (1 - share))) / tries


def _held_out_scores(events: NDArray[np.int64], of: NDArray[np.int64]) -> Floats:
    """By how much likelier each visit's events are (v) with the rate of the other half of the visits than with that of
    a healthy bus: binomial, the rate by Jeffreys' rule."""
    half = halves_of(len(events))
    out = np.zeros(len(events))
    for part in (0, 1):
        rate = (events[half != part].sum() + 0.5) / (of[half != part].sum() + 1.0)
        k, n = events[half == part], of[half == part]
        out[half == part] = k * np.log(rate / HEALTHY_EVENT_RATE) + (n - k) * np.log(
            (1 - rate) / (1 - HEALTHY_EVENT_RATE)
        )
    return out
