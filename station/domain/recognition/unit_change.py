"""A recording whose unit changes on the way: two loggers' files in one, or a setting altered between them."""

from itertools import pairwise, product

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition.quantities import USUAL_UNITS, Quantity
from station.errors import SamplesError

#: Parts that a recording is looked at in, and the fewest on either side of a change.
PARTS, LEAST_PARTS = 40, 4
#: Within one unit the magnitudes of so much of the parts lie within this ratio of their median; a ratio of two units is
#: met as nearly.
MOST_PARTS, SPREAD = 0.8, 0.25


def check(source: str, raw: Floats, quantity: Quantity) -> None:
    """Readings (n, 3) as they came, of a stimulus whose magnitude is the same in every pose. Errors: SamplesError where
    from some row on they are as much larger as one unit is than another."""
    if quantity.sizes is None or len(raw) < 2 * PARTS:
        return
    first = np.linspace(0, len(raw), PARTS + 1).astype(int)
    sizes = [np.linalg.norm(raw[a:b], axis=1) for a, b in pairwise(first)]
    level = np.array([np.median(size) for size in sizes])
    if not np.all(level > 0):
        return
    # What is shaken has no size of its own.
    quiet = [np.median(np.abs(size - middle)) < SPREAD * middle for size, middle in zip(sizes, level, strict=True)]
    log = np.log(level)
    cuts = range(LEAST_PARTS, PARTS - LEAST_PARTS + 1)
    cut = min(cuts, key=lambda c: float(_apart(log, c).sum()))
    if np.mean((_apart(log, cut) < SPREAD) & quiet) < MOST_PARTS:
        return
    before, after = float(np.median(log[:cut])), float(np.median(log[cut:]))
    if abs(after - before) > 2 * SPREAD and _are_two_units(before, after, quantity):
        raise SamplesError("unit-changes", file=source, row=int(first[cut]) + 1, ratio=float(np.exp(after - before)))


def _are_two_units(before: float, after: float, quantity: Quantity) -> bool:
    """Whether two sizes (their logarithms) are those of one stimulus in two units that sensors are read in."""
    assert quantity.sizes is not None
    factors = [factor for unit, factor in quantity.factors.items() if unit in USUAL_UNITS]
    low, high = (np.log(size) for size in quantity.sizes)
    pairs = product(
        *([f for f in factors if low - SPREAD < size + np.log(f) < high + SPREAD] for size in (before, after))
    )
    return any(abs(np.log(f / g) - (after - before)) < SPREAD for f, g in pairs)


def _apart(log: Floats, cut: int) -> Floats:
    """How far each part (n) is from the median of those on its side of the cut."""
    sides = log[:cut], log[cut:]
    return np.concatenate([np.abs(side - np.median(side)) for side in sides])
