"""Axes of one sensor that were written in different units: stated so, or shown by what they reach in the same poses."""

from itertools import product

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition.columns import Axes
from station.domain.recognition.ellipsoid import axis_parallel
from station.domain.recognition.quantities import SPREAD, USUAL_UNITS, Quantity, canonical
from station.domain.recognition.raw_table import RawTable
from station.errors import SamplesError, UsageError
from station.messages import Message

#: Means of poses scatter on some axis by more than this share of their size.
TURNS = 0.05
#: Gains of one sensor's axes are within this ratio, soft iron's, too; units are farther apart.
APART, ALIKE = 5.0, 1.4

Units = tuple[str, str, str]


def stated(table: RawTable, axes: Axes, unit: str | None, quantity: Quantity) -> Units | None:
    """The units of the axes where a person (unit: `g,g,mg`) or the header states different ones; else None.
    Errors: UsageError, SamplesError where one of several is of no known size."""
    if unit is not None:
        given = unit.split(",")
        if len(given) == 1:
            return None
        known = [canonical(one, quantity) for one in given]
        if len(given) != 3 or not all(one in quantity.factors for one in known):
            raise UsageError("units-of-axes-unknown", unit=unit, known=", ".join(quantity.factors))
        return _three(known)
    columns = [table.columns[i] for i in axes]
    known = [canonical(c.unit, quantity) if c.unit else None for c in columns]
    if not table.named or len({c.unit for c in columns if c.unit}) < 2 or len(set(known)) < 2:
        return None
    if not all(one in quantity.factors for one in known):
        names = ", ".join(sorted({c.unit or "-" for c in columns}))
        raise SamplesError("axes-differ-in-unit", file=table.source, units=names)
    return _three(known)


def _three(units: list[str | None]) -> Units:
    x, y, z = (str(unit) for unit in units)
    return x, y, z


def factors(units: Units, quantity: Quantity) -> Floats:
    """What the axes (3) are multiplied by to be in the quantity's unit."""
    return np.array([quantity.factors[unit] for unit in units])


def check(table: RawTable, axes: Axes, means: Floats, quantity: Quantity) -> None:
    """Raw means (k, 3) of poses. Errors: SamplesError where one axis reaches as much more or less in them than the
    others do as one unit is larger than another."""
    scatter = means.std(axis=0)
    if scatter.max() < TURNS * float(np.median(np.linalg.norm(means, axis=1))):
        return  # One pose, however it drifts.
    if quantity.sizes is None or scatter.max() < APART / 2 * scatter.min() or not scatter.min() > 0:
        return
    found = axis_parallel((means - means.mean(axis=0)) / scatter)
    if found is None:
        return
    half = found[1] * scatter
    for odd in range(3):
        rest = np.delete(half, odd)
        ratio = float(half[odd] / np.sqrt(rest.prod()))
        if rest.max() < ALIKE * rest.min() and max(ratio, 1 / ratio) > APART:
            names = tuple(table.columns[i].name for i in axes)
            units = _units(half, odd, quantity)
            others = ", ".join(name for i, name in enumerate(names) if i != odd)
            said = Message("axis-of-another-scale", file=table.source, column=names[odd], ratio=ratio, others=others)
            if units is None:
                raise SamplesError(said)
            raise SamplesError(
                "axis-in-another-unit", **said.parameters, own=units[odd], units=",".join(units),
            )  # fmt: skip


def _units(half: Floats, odd: int, quantity: Quantity) -> Units | None:
    """The units in which half axes (3), that of axis `odd` apart from the others, are of one usual size."""
    assert quantity.sizes is not None
    low, high = quantity.sizes[0] * (1 - SPREAD), quantity.sizes[1] * (1 + SPREAD)
    usual = [unit for unit in quantity.factors if unit in USUAL_UNITS]
    rest = float(np.sqrt(np.delete(half, odd).prod()))
    for most, own in product(usual, usual):
        size, other = rest * quantity.factors[most], float(half[odd]) * quantity.factors[own]
        if most != own and low <= size <= high and low <= other <= high and 1 / ALIKE < size / other < ALIKE:
            units = [most] * 3
            units[odd] = own
            return units[0], units[1], units[2]
    return None
