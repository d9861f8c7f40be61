"""A bit of the output that never changes although the bits above it do.

Codes are the readings in steps of the data sheet's grid, two's complement. Where the code takes n values above a
bit, the bit itself is the same in all of them by a chance of 2^(1−n). Values are counted on one axis, on the axes of a
unit together, or on all units together where the bit reads the same on all of them. Low bits that are all stuck make a
coarser grid, which `grid_step` finds.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.faults.fault import Fault, Number, of_unit
from station.domain.recipe import Recipe
from station.domain.types import Floats, SampleTable

Codes = NDArray[np.int64]

#: Values of the higher bits that must be seen, and bits looked at.
LEVELS, BITS = 24, 24
#: Share of a step by which readings may lie beside the grid on the average; off any grid it is a quarter.
BESIDE = 0.1


def faults(recipe: Recipe, table: SampleTable, stop: NDArray[np.intp]) -> list[Fault]:
    """Units one of whose bits is stuck."""
    del stop
    lsb = recipe.device.lsb
    if lsb <= 0:
        return []
    units = [u for u in range(len(table.unit.names)) if np.any(table.unit.code == u)]
    codes = [_codes(table.reading[table.unit.code == u], lsb) for u in units]
    everywhere = _stuck([np.unique(np.concatenate(axis)) for axis in zip(*codes, strict=True)])
    numbers = []
    for u, axes in zip(units, codes, strict=True):
        found = everywhere | _stuck(axes) | set().union(*(_stuck([axis]) for axis in axes))
        numbers += [_number(of_unit(table.unit, u), bit, high, recipe) for bit, high in sorted(found)]
    if not numbers:
        return []
    weight = float(numbers[0].value)
    told = f"the bit of {abs(weight):.3g} {recipe.unit} always reads {int(weight < 0)}"
    return [Fault("stuck-bit", "unit", tuple(numbers), told, len(numbers) * (LEVELS - 1) * float(np.log(2)))]


def _codes(readings: Floats, lsb: float) -> list[Codes]:
    """The codes that occur on each axis; none where the readings (n, 3) do not lie on the grid."""
    steps = readings / lsb
    code = np.round(steps)
    on_grid = np.mean(np.abs(steps - code)) < BESIDE
    return [np.unique(axis).astype(np.int64) if on_grid else np.zeros(0, np.int64) for axis in code.T]


def _stuck(axes: Sequence[Codes]) -> set[tuple[int, bool]]:
    """Bits (place, what it reads) that never change on any of the axes, which together take values enough above."""
    found = set()
    low = True
    for bit in range(BITS):
        seen = sum(len(np.unique(axis >> (bit + 1))) for axis in axes)
        if seen < LEVELS:
            break
        read = {int(x) for axis in axes for x in np.unique((axis >> bit) & 1)}
        low = low and len(read) == 1
        if len(read) == 1 and not low:
            found.add((bit, bool(read.pop())))
    return found


def _number(of: str, bit: int, high: bool, recipe: Recipe) -> Number:
    """The bit's weight, negative where it always reads 1."""
    weight = recipe.device.lsb * 2.0**bit
    return Number("weight", None, of, -weight if high else weight, recipe.device.lsb / 12**0.5, recipe.unit)
