"""Optional columns that do not say what their names say: they are left out, and it is said."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.row_place import where_is
from station.domain.core.types import SampleTable
from station.domain.evaluation.unit_dwells import visit_boundaries
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: Columns of which a visit has one value.
OF_VISITS = ("station", "nest", "lot", "operator")
#: Of more names than runs, and than this share of the visits, none has a group of visits.
MOST_NAMES = 1 / 3
#: A counter goes on by one in so many of a unit's steps; or, where frames are lost, at the rate of the stamps to within
#: this share.
MOST_BY_ONE, SAME_RATE = 0.6, 0.2
#: So often a counter starts again below its stated span where its bits are stated wrong.
LEAST_WRAPS = 3

Inside = NDArray[np.bool_]


def without_misnamed(recipe: Recipe, table: SampleTable) -> tuple[SampleTable, tuple[Message, ...]]:
    """A sorted table without labels that change within a visit and without a counter that counts no frames, and what is
    said of them."""
    begin, _ = visit_boundaries(table)
    inside = np.ones(max(len(table) - 1, 0), bool)
    inside[begin[1:] - 1] = False
    said = {name: one for name in OF_VISITS for one in _changing(table, name, begin, inside)}
    counts = _counter(recipe, table, inside)
    if not said and counts is None:
        return table, ()
    labels = {name: label for name, label in table.labels.items() if name not in said}
    values = {name: v for name, v in table.values.items() if name != "counter" or counts is None}
    return replace(table, labels=labels, values=values), (*said.values(), *(() if counts is None else (counts,)))


def _changing(table: SampleTable, name: str, begin: NDArray[np.int64], inside: Inside) -> Iterator[Message]:
    """What is said of a label of which a visit has several, or of which nearly each has its own."""
    if name not in table.labels:
        return
    rows = np.flatnonzero(inside & (np.diff(table.labels[name].code) != 0))
    if len(rows):
        visits = len(np.unique(np.searchsorted(begin, rows, side="right")))
        yield Message("label-changes", column=name, visits=visits, total=len(begin), **where_is(table, int(rows[0])))
        return
    names, passes = len(np.unique(table.labels[name].code[begin])), len(np.unique(_passes(table, begin)))
    if names > max(passes, MOST_NAMES * len(begin)):
        yield Message("label-of-no-group", column=name, names=names, visits=len(begin))


def _passes(table: SampleTable, begin: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number (v) of the unit and run of each visit."""
    return np.asarray((table.unit.code[begin].astype(np.int64) << 32) + table.run[begin])


def _counter(recipe: Recipe, table: SampleTable, inside: Inside) -> Message | None:
    """What is said of a counter that counts no frames, or not as the recipe states; None where it does."""
    counter = table.values.get("counter")
    if counter is None or not np.all(np.isfinite(counter)):
        return None
    span = 2**recipe.device.counter_bits
    step, rows = np.diff(counter)[inside], np.flatnonzero(inside)
    by_one = (step == 1) | (step == 1 - span)
    if by_one.all():
        return None
    units, unit = len(table.unit.names), table.unit.code[rows]
    modulus = int(counter.max()) + 1
    wraps = step == 1 - modulus
    if 2 < modulus < span and np.count_nonzero(wraps) >= LEAST_WRAPS and np.mean(by_one | wraps) >= MOST_BY_ONE:
        return Message("counter-wraps-early", modulus=modulus, bits=recipe.device.counter_bits, span=span)
    # A frame that came twice is no step.
    twice = (step % span == 0) & (table.reading[rows] == table.reading[rows + 1]).all(axis=1)
    steps = np.bincount(unit[~twice], minlength=units)
    ones = np.bincount(unit[~twice], step[~twice] % span == 1, units)
    ahead = np.bincount(unit, (step + span // 2) % span - span // 2, units)
    lasted_s = np.bincount(unit, np.diff(table.time_s)[rows], units)
    in_time = np.abs(ahead - lasted_s * recipe.device.rate_hz) <= SAME_RATE * np.abs(ahead)
    idle = (ones < MOST_BY_ONE * steps) & ~(in_time & (ahead > 0))
    if not idle.any():
        return None
    u = int(np.argmax(idle))
    share = float(ones[u] / steps[u])
    return Message("counter-counts-nothing", serial=table.unit.names[u], percent=100 * share)
