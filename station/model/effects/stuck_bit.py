"""One output bit never changes: a broken line of the converter or a packing fault.

The bit of weight |c| reads 0 where c > 0 and 1 where c < 0; codes are two's complement.

>>> import numpy as np
>>> StuckBit.example().apply(np.array([[0.25, 0.375, -0.125]]), np.array([[0.125]]))
array([[ 0.25,  0.25, -0.25]])
>>> StuckBit.example().apply(np.array([[0.25, 0.375, -0.25]]), np.array([[-0.125]]))
array([[ 0.375,  0.375, -0.125]])
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.model.effect import SINGLE_COEFFICIENT, OutputEffect, Parameter


@dataclass(frozen=True)
class StuckBit(OutputEffect):
    """Weight of the bit, per unit; negative where it is stuck at 1."""

    physics = "One output bit never changes: a broken line of the converter or a packing fault."
    remedy = "check the packing of the frame, then replace the converter or the device"
    shown_by = "state `device.lsb` in the recipe"
    drawn_over = "samples"
    level = "device"
    of = ("unit", "common")
    axes = SINGLE_COEFFICIENT
    place = 2
    parameter = Parameter("weight", "u", 1e-3, 3.9e-6, 1.0, "any bit of a converter of 12 to 20 bits over ±2 g")
    size: float = parameter.typical

    def apply(self, reading: Floats, c: Floats) -> Floats:
        """The reading with its bit of weight |c| held; as it is where c is 0."""
        weight = np.where(c == 0, 1.0, np.abs(c))
        # A millionth of a step keeps rounding from turning a code into the one below.
        high = np.floor(reading / weight + 1e-6) % 2 >= 1
        held = np.where(c > 0, -weight * high, weight * ~high)
        return reading + np.where(c == 0, 0.0, held)

    def with_drawn_form(self, recipe: Recipe, seed: int) -> Self:
        """With the weight of a real bit: the data sheet's step times a power of two."""
        del seed
        lsb = recipe.device.lsb
        if lsb <= 0 or self.size == 0:
            return self
        weight = lsb * 2.0 ** np.round(np.log2(abs(self.size) / lsb))
        return replace(self, size=float(np.copysign(weight, self.size)))
