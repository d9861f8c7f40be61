"""A bit of the output that never changes although the bits above it do.

Codes are the readings in steps of the data sheet's grid, two's complement. Where the code takes n values above a
bit, the bit itself is the same in all of them by a chance of 2^(1−n). Values are counted on one axis, on the axes of a
unit together, or on all units together where the bit reads the same on all of them. Low bits that are all stuck make a
coarser grid, which `grid_step` finds.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import (
    FaultParameter,
    GrossFault,
    block_gain,
    halves,
    rows_of_units,
    unit_label,
)
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe

Codes = NDArray[np.int64]
#: The codes that occur on each axis, each once, rising.
AxisCodes = list[Codes]

#: Values of the higher bits that must be seen, and bits looked at.
MIN_LEVELS, MAX_BITS = 24, 24
#: Share of a step by which readings may lie beside the grid on the average; off any grid it is a quarter.
OFF_GRID_SHARE = 0.1
#: Codes that range over no more are marked, which is faster than to sort them.
MOST_PLACES = 1 << 17


def faults(recipe: Recipe, table: SampleTable, stop: NDArray[np.intp]) -> list[GrossFault]:
    """Units one of whose bits is stuck."""
    lsb = recipe.device.lsb
    if lsb <= 0:
        return []
    codes = codes_of_units(table, lsb)
    everywhere = stuck_in_all(together(list(codes.values())))
    numbers, scores = [], []
    for u, rows in enumerate(rows_of_units(table.unit)):
        if u not in codes:
            continue
        found = everywhere | stuck_in_unit(codes[u])
        scores += [_held_out_scores(table.reading[rows] / lsb, stop[rows], bit) for bit, _ in sorted(found)]
        numbers += [_number(unit_label(table.unit, u), bit, high, recipe) for bit, high in sorted(found)]
    if not numbers:
        return []
    weight = float(numbers[0].value)
    sentence = f"the bit of {abs(weight):.3g} {recipe.unit} always reads {int(weight < 0)}"
    gain = block_gain(np.concatenate([s for s, _ in scores]), np.concatenate([n for _, n in scores]), "sample")
    nats = len(numbers) * (MIN_LEVELS - 1) * float(np.log(2))
    return [GrossFault("stuck-bit", "unit", tuple(numbers), sentence, nats, gain=gain)]


def codes_of_units(table: SampleTable, lsb: float) -> dict[int, AxisCodes]:
    """The codes of each unit that has any samples."""
    units = enumerate(rows_of_units(table.unit))
    return {u: _codes(table.reading[rows], lsb) for u, rows in units if rows.stop > rows.start}


def together(units: Sequence[AxisCodes]) -> AxisCodes:
    """The codes of all units on each axis."""
    return [np.unique(np.concatenate(axis)) for axis in zip(*units, strict=True)]


def stuck_in_all(codes: AxisCodes) -> set[tuple[int, bool]]:
    """Bits (place, what it reads) that never change on any axis of all units."""
    return _stuck([_bit_statistics(axis) for axis in codes])


def stuck_in_unit(codes: AxisCodes) -> set[tuple[int, bool]]:
    """The same of one unit, or of one of its axes."""
    axes = [_bit_statistics(axis) for axis in codes]
    return _stuck(axes) | set().union(*(_stuck([axis]) for axis in axes))


def _held_out_scores(steps: Floats, stop: NDArray[np.intp], bit: int) -> tuple[Floats, Floats]:
    """Of each stop of a unit (s): by how much likelier a bit is with the share of ones that it has in the other half of
    the stops than with one half, once for each value that the bits above it take in the stop; and its samples.

    A value that stands still is one piece of evidence, however often it is sampled.
    """
    code = np.round(steps).astype(np.int64)
    half, where = halves(stop), stop - stop[0]
    one = code >> bit & 1
    score = np.zeros(int(where[-1]) + 1)
    for axis in range(3):
        for part in (0, 1):
            observed = one[half != part, axis]
            share = (observed.sum() + 0.5) / (len(observed) + 1.0)
            rows = np.flatnonzero(half == part)
            values = np.unique(np.stack([where[rows], code[rows, axis] >> bit], axis=1), axis=0)
            chance = np.where(values[:, 1] & 1, share, 1 - share)
            score += np.bincount(values[:, 0], np.log(2 * chance), len(score))
    return score, np.bincount(where, minlength=len(score)).astype(float)


def _codes(readings: Floats, lsb: float) -> AxisCodes:
    """The codes that occur on each axis; none where the readings (n, 3) do not lie on the grid."""
    steps = readings / lsb
    code = np.round(steps)
    on_grid = np.mean(np.abs(steps - code)) < OFF_GRID_SHARE
    return [_each_once(axis) if on_grid else np.zeros(0, np.int64) for axis in code.T]


def _each_once(code: Floats) -> Codes:
    """The codes (n) that occur, rising."""
    low = code.min()
    if not code.max() - low < MOST_PLACES:
        return np.unique(code).astype(np.int64)
    there = np.zeros(int(code.max() - low) + 1, bool)
    there[(code - low).astype(np.intp)] = True
    return np.flatnonzero(there) + int(low)


class BitStatistics(NamedTuple):
    """levels (BITS): values that the bits above each bit take; one, any: the bits that are 1 in all and in any code."""

    levels: Codes
    always_one: int
    any: int


def _bit_statistics(codes: Codes) -> BitStatistics:
    """Of codes (n) in rising order, each once. Between neighbours the highest bit that differs tells which of the
    numbers made of the higher bits are new."""
    if not len(codes):
        return BitStatistics(np.zeros(MAX_BITS, np.int64), -1, 0)
    differ = (codes[1:] ^ codes[:-1]).astype(float)
    # A change of sign is a change of the highest bit of all.
    highest = np.where(differ < 0, 63, np.frexp(np.maximum(differ, 0))[1] - 1)
    above = np.bincount(np.minimum(highest, MAX_BITS), minlength=MAX_BITS + 1)[::-1].cumsum()[::-1][1:]
    return BitStatistics(1 + above, int(np.bitwise_and.reduce(codes)), int(np.bitwise_or.reduce(codes)))


def _stuck(axes: Sequence[BitStatistics]) -> set[tuple[int, bool]]:
    """Bits (place, what it reads) that never change on any of the axes, which together take values enough above."""
    levels = np.sum([axis.levels for axis in axes], axis=0)
    one, some = int(np.bitwise_and.reduce([axis.always_one for axis in axes])), 0
    for axis in axes:
        some |= axis.any
    found, low = set(), True
    for bit in range(MAX_BITS):
        if levels[bit] < MIN_LEVELS:
            break
        high = bool(one >> bit & 1)
        still = high or not some >> bit & 1
        low = low and still
        if still and not low:
            found.add((bit, high))
    return found


def _number(of: str, bit: int, high: bool, recipe: Recipe) -> FaultParameter:
    """The bit's weight, negative where it always reads 1."""
    weight = recipe.device.lsb * 2.0**bit
    return FaultParameter("weight", None, of, -weight if high else weight, recipe.device.lsb / 12**0.5, recipe.unit)
