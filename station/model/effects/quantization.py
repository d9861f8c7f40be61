"""The output comes in coarser steps than the data sheet says: low bits are lost.

A reading is rounded to the nearest multiple of the step.

>>> import numpy as np
>>> Quantization.example().apply(np.array([[0.0124, 0.0126, -0.0126]]), np.array([[0.005]]))
array([[ 0.01 ,  0.015, -0.015]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import SINGLE_COEFFICIENT, OutputEffect, Parameter


@dataclass(frozen=True)
class Quantization(OutputEffect):
    """Step of the output, per unit."""

    physics = "The output comes in coarser steps than the data sheet says: low bits are lost."
    remedy = "set the range and the output format that the data sheet promises"
    shown_by = "state `device.lsb` in the recipe"
    drawn_over = "samples"
    level = "device"
    of = ("unit", "common")
    axes = SINGLE_COEFFICIENT
    place = 2
    parameter = Parameter("lsb", "u", 1e-3, 3.9e-6, 1e-2, "8 to 20 bits over ±2 g, 3.9 µg–16 mg")
    size: float = parameter.typical

    def apply(self, reading: Floats, c: Floats) -> Floats:
        """The nearest multiple of c; as it is where c is 0."""
        step = np.where(c > 0, c, 1.0)
        return np.where(c > 0, np.round(reading / step) * step, reading)
