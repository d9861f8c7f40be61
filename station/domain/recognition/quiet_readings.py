"""Which readings of a turn that was read on its way stand for it: the quietest of each portion.

Where a hand dwells for a moment it adds hardly anything to gravity; between two stops, tenths of a g. Quiet is
judged by how far neighbours lie apart, never by magnitudes, so that the choice does not bias what is fitted to them.
"""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: Readings that are a pose each: more than so many tell no more.
MOST_POSES = 500
#: Of a hand that moves one reading a second stands for the rest, as long as so many remain.
SECOND_S, ENOUGH_POSES = 1.0, 50
#: Steps to each side that tell how still a reading is.
NEIGHBOURS = 2


def portion(readings: int, duration_s: float, moving: bool) -> int:
    """How many readings one of them stands for."""
    least = -(-readings // MOST_POSES)
    if not moving:
        return least
    a_second = int(SECOND_S * readings / max(duration_s, 1e-9))
    return max(least, min(a_second, readings // ENOUGH_POSES))


def quietest(reading: Floats, each: int) -> NDArray[np.intp]:
    """The quietest of every `each` of some readings (n, 3), in their order."""
    n = len(reading)
    if each <= 1 or n < 2 * NEIGHBOURS:
        return np.arange(0, n, max(each, 1))
    step = np.linalg.norm(np.diff(reading, axis=0), axis=1)
    # At the ends the steps that are missing are as large as any, so that they win only where nothing is quieter.
    padded = np.pad(step, NEIGHBOURS, constant_values=float(step.max()))
    motion = np.convolve(padded, np.ones(2 * NEIGHBOURS), "valid")
    begins = np.arange(0, n, each)
    return np.array([a + int(np.argmin(motion[a : a + each])) for a in begins])
