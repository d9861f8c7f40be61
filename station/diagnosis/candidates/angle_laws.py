"""Laws of the angle at which the stimulus lies in the plane of two axes, as heads, rings and gears err."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from station.domain.core.types import Floats

#: Waves in a turn; two of them are squares and products of the axes.
HARMONICS = (3, 4)
#: A plane in which so little of the stimulus lies has no angle; digits that a wave is known to.
LEAST, DIGITS = 1e-6, 9


def angle_laws(a: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Cosine and sine (v, 3) of each harmonic, alone and in proportion to what lies in the plane. a: what each axis
    feels (v, 3); each axis in a plane of its own place, and all in one plane."""
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    own = ((a, one), (one, two), (two, a))
    shared = [tuple(np.repeat(a[:, [i]], 3, axis=1) for i in plane) for plane in ((0, 1), (1, 2), (2, 0))]
    for (x, y), waves in product((*own, *shared), HARMONICS):
        size, angle = np.hypot(x, y), waves * np.arctan2(y, x)
        for much in (1.0 * (size > LEAST), size):
            # Where a wave is zero at every position its last digits are none.
            yield np.round(much * np.cos(angle), DIGITS), np.round(much * np.sin(angle), DIGITS)
