"""The gold reference has moved since it was calibrated.

Its reading gains c_i, in the nest's frame; a station that takes the gold as the truth passes that on to every unit.

>>> import numpy as np
>>> GoldDrift.example().apply(np.array([[0.001, 0.0, 0.0]]))
array([[0.001, 0.   , 0.   ]])
"""

from dataclasses import dataclass

from station.domain.core.types import Floats
from station.model.effect import GoldEffect, Parameter


@dataclass(frozen=True)
class GoldDrift(GoldEffect):
    """Offset of the gold on each axis, common to all it is used for."""

    physics = "The gold reference has moved since it was calibrated."
    remedy = "have the gold reference calibrated, and compare it with a second one"
    shown_by = "read a gold reference in the nest (`gold_x`, `gold_y`, `gold_z`)"
    drawn_over = "position"
    level = "rig"
    of = ("common", "station", "run")
    parameter = Parameter("offset", "u", 5e-4, 1e-4, 9e-3, "ageing: ±3.5 mg typical in 10 years (ADXL355 data sheet)")
    needs = ("gold",)
    size: float = parameter.typical

    def apply(self, c: Floats) -> Floats:
        """c."""
        return c
