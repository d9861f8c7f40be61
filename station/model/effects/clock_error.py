"""The device's oscillator is off, and with it its sample rate.

rate = rate of the data sheet · (1 + c). A dwell's values cannot show it; the frames counted by the host's clock can.

>>> import numpy as np
>>> ClockError.example().apply(np.array([100.0]), np.array([[0.01]]))
array([101.])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import SINGLE_COEFFICIENT, ClockEffect, Parameter


@dataclass(frozen=True)
class ClockError(ClockEffect):
    """Relative error of the rate, per unit."""

    physics = "The device's oscillator is off, and with it its sample rate."
    remedy = "take time from the host's clock, and ask the supplier about the oscillator"
    shown_by = "state `device.rate_hz` in the recipe, and dwell longer"
    drawn_over = "clock"
    level = "bus"
    of = ("unit", "common")
    axes = SINGLE_COEFFICIENT
    parameter = Parameter("rate_error", "1", 0.01, 1e-3, 0.05, "RC oscillators of MEMS, ±1–5 %; unchecked")
    size: float = parameter.typical

    def apply(self, rate_hz: Floats, c: Floats) -> Floats:
        """rate · (1 + c)."""
        return np.asarray(rate_hz * (1 + c[:, 0]))
