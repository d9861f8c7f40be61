"""All readings are off by one factor: the wrong range or unit is set.

reading is multiplied by the factor: ½, 2, 4, 8 for a range, 1000 for mg, 9.80665 for m/s².

>>> import numpy as np
>>> WrongScale.example().apply(np.array([[0.5, 1.0, -1.0]]), np.array([[2.0]]))
array([[ 1.,  2., -2.]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import SINGLE_COEFFICIENT, OutputEffect, Parameter


@dataclass(frozen=True)
class WrongScale(OutputEffect):
    """Factor of the reading, per unit."""

    physics = "All readings are off by one factor: the wrong range or unit is set."
    remedy = "check range and unit of the device and in the decoding, before anything else"
    shown_by = "state `reference.magnitude` in the recipe"
    drawn_over = "expected"
    level = "device"
    of = ("unit", "common")
    axes = SINGLE_COEFFICIENT
    place = 3
    parameter = Parameter("factor", "1", 2.0, 0.5, 1000.0, "range registers go in powers of two", neutral=1.0)
    size: float = parameter.typical

    def apply(self, reading: Floats, c: Floats) -> Floats:
        """c · reading."""
        return np.asarray(reading * c)
