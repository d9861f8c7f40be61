"""Frames get lost: the bus is too full, or the adapter's buffer runs over.

Each frame is lost with the given chance; the counter then jumps.

>>> import numpy as np
>>> rng, block = np.random.default_rng(4), np.zeros(8, int)
>>> LostFrames.example().apply(block, np.full(8, 0.3), rng)
array([0, 1, 2, 4, 5, 6])
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.model.effect import BusEffect, Parameter


@dataclass(frozen=True)
class LostFrames(BusEffect):
    """Fraction of frames that do not arrive."""

    physics = "Frames get lost: the bus is too full, or the adapter's buffer runs over."
    remedy = "lower the load of the bus, or check the adapter and its buffer"
    shown_by = "record the frame `counter`"
    drawn_over = "unit"
    parameter = Parameter(
        "fraction", "1", 0.01, 1e-4, 0.1, "a healthy bus loses none; an adapter under load a per cent"
    )
    size: float = parameter.typical

    def apply(self, block: NDArray[np.int_], fraction: Floats, rng: np.random.Generator) -> NDArray[np.int_]:
        """The frames that arrive."""
        return np.flatnonzero(rng.random(len(block)) >= fraction)
