"""The reading has a cubic term in what the axis feels: the spring stiffens.

reading_i gains c_i · a_i³. At six faces it is the same as a gain; it takes tilts between them to tell.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> Cubic.example().apply(Signal(None, np.array([[0.5, -1.0, 0.0]]), None), np.array([[0.1, 0.1, 0.1]]))
array([[ 0.0125, -0.1   ,  0.    ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Cubic(SensorEffect):
    """Coefficient of a³, per unit and axis."""

    physics = "The reading has a cubic term in what the axis feels: the spring stiffens."
    remedy = "add the cube to the compensation, or ask the supplier about the lot"
    shown_by = "add positions at 45°, or spins at other speeds: at six faces a cube is a gain"
    drawn_over = "input"
    level = "device"
    of = ("unit", "common")
    parameter = Parameter("coefficient", "1/u²", 2e-4, 5e-5, 5e-4, "usual for MEMS in ±2 g, 50–500 µg/g³; unchecked")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · a³."""
        return np.asarray(c * signal.true * signal.true * signal.true)
