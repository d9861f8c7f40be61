"""Frames overtake each other between adapter and host.

A frame changes places with the next one with the given chance; the counter then steps back. Not across a pause.

>>> import numpy as np
>>> rng, block = np.random.default_rng(4), np.zeros(8, int)
>>> ReorderedFrames.example().apply(block, np.full(8, 0.3), rng)
array([0, 1, 2, 4, 3, 5, 6, 7])
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.model.effect import BusEffect, Parameter


@dataclass(frozen=True)
class ReorderedFrames(BusEffect):
    """Fraction of frames that change places with their successor."""

    physics = "Frames overtake each other between adapter and host."
    remedy = "replace the adapter or its driver; sort by the frame counter meanwhile"
    shown_by = "record the frame `counter`"
    drawn_over = "unit"
    parameter = Parameter("fraction", "1", 0.01, 1e-4, 0.1, "USB adapters that hand over several buffers at once")
    size: float = parameter.typical

    def apply(self, block: NDArray[np.int_], fraction: Floats, rng: np.random.Generator) -> NDArray[np.int_]:
        """Every frame, some in the place of the next."""
        order = np.arange(len(block))
        first = np.flatnonzero((rng.random(len(block)) < fraction)[:-1] & (block[1:] == block[:-1]))
        # A frame that has just been overtaken stays where it is.
        first = first[np.diff(first, prepend=-2) > 1]
        order[first], order[first + 1] = first + 1, first
        return order
