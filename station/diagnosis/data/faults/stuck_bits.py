"""A bit of the output that never changes although the bits above it do.

Codes are the readings in steps of the data sheet's grid, two's complement. Where the code takes n values above a
bit, the bit itself is the same in all of them by a chance of 2^(1−n). Values are counted on one axis, on the axes of a
unit together, or on all units together where the bit reads the same on all of them. Low bits that are all stuck make a
coarser grid, which `grid_step` finds. Of a bit far above the noise a few dwells show few values; there it is evidence
besides that dwells lie off by just its weight (`bit_shifts.py`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.bit_shifts import Bits, Dwells
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
#: What a bit that is the same in so many values is worth, nats.
PLAIN_NATS = (MIN_LEVELS - 1) * float(np.log(2))
#: What dwells that lie off by a bit's weight must say of it, and each unit by itself beside the others, nats.
SHIFTED_NATS, UNIT_NATS = 8.0, 5.0
#: Share of a step by which readings may lie beside the grid on the average; off any grid it is a quarter.
OFF_GRID_SHARE = 0.1
#: Codes that range over no more are marked, which is faster than to sort them.
MOST_PLACES = 1 << 17


def stuck_bits(table: SampleTable, lsb: float, dwells_of: Callable[[int], Dwells] | None) -> dict[int, Bits]:
    """The bits of each unit that are stuck; dwells_of: gives those of a unit, None where nobody knows the poses."""
    codes = codes_of_units(table, lsb)
    everywhere = stuck_in_all(together(list(codes.values())))
    found = {u: sorted(everywhere | stuck_in_unit(c)) for u, c in codes.items()}
    if dwells_of is not None:
        found |= _shifting({u: c for u, c in codes.items() if not found[u]}, lsb, dwells_of)
    return {u: bits for u, bits in found.items() if bits}


def faults(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp], stuck: Mapping[int, Bits]) -> list[GrossFault]:
    """The fault of the units whose bits are stuck."""
    lsb, units = recipe.device.lsb, rows_of_units(table.unit)
    pairs = [(u, bit, high) for u, bits in stuck.items() for bit, high in bits]
    if not pairs:
        return []
    scores = [_held_out_scores(table.reading[units[u]] / lsb, visit[units[u]], bit) for u, bit, _ in pairs]
    numbers = [_number(unit_label(table.unit, u), bit, high, recipe) for u, bit, high in pairs]
    weight = float(numbers[0].value)
    sentence = f"the bit of {abs(weight):.3g} {recipe.unit} always reads {int(weight < 0)}"
    gain = block_gain(np.concatenate([s for s, _ in scores]), np.concatenate([n for _, n in scores]), "sample")
    nats = len(numbers) * PLAIN_NATS
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


def _shifting(
    codes: Mapping[int, AxisCodes], lsb: float, dwells_of: Callable[[int], Dwells]
) -> dict[int, list[tuple[int, bool]]]:
    """The bit of some units that is the same in few values, but the dwells that should have it lie off by its weight:
    the one of which all units together are the surest, if they are as sure as of many values."""
    nats: dict[tuple[int, bool], dict[int, float]] = {}
    for u, axes in ((u, [_bit_statistics(axis) for axis in c]) for u, c in codes.items()):
        for bit, high in _stuck(axes, 2 * len(axes)):
            dwells, shift = dwells_of(u), lsb * 2.0**bit * (-1 if high else 1)
            levels = sum(int(axis.levels[bit]) - 1 for axis in axes)
            shifted = sum(max(dwells.shifted(axis, shift)[1], 0.0) for axis in range(len(axes)))
            if shifted > 0:
                nats.setdefault((bit, high), {})[u] = (levels - 1) * float(np.log(2)) + shifted
    best = max(nats, key=lambda bit: sum(nats[bit].values()), default=None)
    if best is None or sum(nats[best].values()) < SHIFTED_NATS + np.log(2 * MAX_BITS):
        return {}
    return {u: [best] for u, own in nats[best].items() if own > UNIT_NATS}


def _held_out_scores(steps: Floats, visit: NDArray[np.intp], bit: int) -> tuple[Floats, Floats]:
    """Of each visit of a unit (s): by how much likelier a bit is with the share of ones that it has in the other half
    of the visits than with one half, once for each value that the bits above it take in the visit; and its samples.

    A value that stands still is one piece of evidence, however often it is sampled.
    """
    code = np.round(steps).astype(np.int64)
    half, where = halves(visit), visit - visit[0]
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


def _stuck(axes: Sequence[BitStatistics], least: int = MIN_LEVELS) -> set[tuple[int, bool]]:
    """Bits (place, what it reads) that never change on any of the axes, which together take values enough above."""
    levels = np.sum([axis.levels for axis in axes], axis=0)
    one, some = int(np.bitwise_and.reduce([axis.always_one for axis in axes])), 0
    for axis in axes:
        some |= axis.any
    found, low = set(), True
    for bit in range(MAX_BITS):
        if levels[bit] < least:
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
