"""Frames arrive twice: an acknowledge is missed and the controller repeats the frame.

Each frame is repeated with the given chance; the counter then stands still.

>>> import numpy as np
>>> rng, block = np.random.default_rng(4), np.zeros(8, int)
>>> DuplicatedFrames.example().apply(block, np.full(8, 0.3), rng)
array([0, 1, 2, 3, 3, 4, 5, 6, 7, 7])
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.model.effect import BusEffect, Parameter


@dataclass(frozen=True)
class DuplicatedFrames(BusEffect):
    """Fraction of frames that arrive twice."""

    physics = "Frames arrive twice: an acknowledge is missed and the controller repeats the frame."
    remedy = "check what makes the controller repeat: termination, a second controller, the adapter"
    shown_by = "record the frame `counter`"
    drawn_over = "unit"
    parameter = Parameter("fraction", "1", 0.01, 1e-4, 0.1, "repeats after an error in the last bit of a frame")
    size: float = parameter.typical

    def apply(self, block: NDArray[np.int_], fraction: Floats, rng: np.random.Generator) -> NDArray[np.int_]:
        """Every frame, and the repeated ones once more."""
        return np.repeat(np.arange(len(block)), 1 + (rng.random(len(block)) < fraction))
