"""A recording whose unit changes on the way: two loggers' files in one, or a setting altered between them."""

from itertools import pairwise

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition.quantities import Quantity
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
    level = np.array([np.median(np.linalg.norm(raw[a:b], axis=1)) for a, b in pairwise(first)])
    if not np.all(level > 0):
        return
    log = np.log(level)
    cuts = range(LEAST_PARTS, PARTS - LEAST_PARTS + 1)
    cut = min(cuts, key=lambda c: float(_apart(log, c).sum()))
    if np.mean(_apart(log, cut) < SPREAD) < MOST_PARTS:
        return
    sizes = np.log(list(quantity.factors.values()))
    ratios = np.unique(np.abs(sizes[:, None] - sizes))
    change = float(np.median(log[cut:]) - np.median(log[:cut]))
    if abs(change) > 2 * SPREAD and np.min(np.abs(ratios[ratios > 0] - abs(change))) < SPREAD:
        raise SamplesError("unit-changes", file=source, row=int(first[cut]) + 1, ratio=float(np.exp(change)))


def _apart(log: Floats, cut: int) -> Floats:
    """How far each part (n) is from the median of those on its side of the cut."""
    sides = log[:cut], log[cut:]
    return np.concatenate([np.abs(side - np.median(side)) for side in sides])
