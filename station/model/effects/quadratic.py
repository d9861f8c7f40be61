"""The reading has a quadratic term in what the axis feels: second-order nonlinearity of the suspension.

reading_i gains c_i · a_i². Unlike gain it is even: up and down err the same way.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> Quadratic.example().apply(Signal(None, np.array([[0.5, -1.0, 0.0]]), None), np.array([[0.1, 0.1, 0.1]]))
array([[0.025, 0.1  , 0.   ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Quadratic(SensorEffect):
    """Coefficient of a², per unit and axis."""

    physics = "The reading has a quadratic term in what the axis feels: second-order nonlinearity of the suspension."
    remedy = "add the square to the compensation, or ask the supplier about the lot"
    shown_by = "add positions at 45°, or spins at other speeds, so that each axis feels three magnitudes"
    drawn_over = "input"
    separated_by = (
        ("asymmetry", "tilts between the faces, or other strengths: a centrifuge, coils, spins at other speeds"),
    )
    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "1/u", 3e-4, 1e-4, 2.5e-3, "data sheets: ADXL355, ICM-42688 ≤ 500 µg/g², ADXL313 ≤ 2500"
    )
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · a²."""
        return np.asarray(c * signal.true**2)
