"""The output saturates below its full scale.

A reading beyond ±limit stays at the limit.

>>> import numpy as np
>>> Clipping.example().apply(np.array([[0.5, 1.0, -2.0]]), np.array([[0.95]]))
array([[ 0.5 ,  0.95, -0.95]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import SINGLE_COEFFICIENT, OutputEffect, Parameter


@dataclass(frozen=True)
class Clipping(OutputEffect):
    """Limit of the reading, per unit."""

    physics = "The output saturates below its full scale."
    remedy = "set a wider range; no calibration restores what was cut off"
    shown_by = "state `device.full_scale` in the recipe"
    drawn_over = "expected"
    level = "device"
    of = ("unit", "common")
    axes = SINGLE_COEFFICIENT
    place = 1
    parameter = Parameter("limit", "u", 0.95, 0.5, 2.0, "an amplifier that meets its rail", neutral=float("inf"))
    size: float = parameter.typical

    def apply(self, reading: Floats, c: Floats) -> Floats:
        """The reading within ±c."""
        return np.clip(reading, -c, c)
