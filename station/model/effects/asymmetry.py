"""The gain differs between the positive and the negative half of an axis.

reading_i gains c_i · |a_i|: a kink at zero, where `quadratic` is smooth; at six faces both are the same.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> Asymmetry.example().apply(Signal(None, np.array([[0.5, -1.0, 0.0]]), None), np.array([[0.1, 0.1, 0.1]]))
array([[0.05, 0.1 , 0.  ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Asymmetry(SensorEffect):
    """Half the difference of the two gains, per unit and axis."""

    physics = "The gain differs between the positive and the negative half of an axis."
    remedy = "compensate with one gain for each sign, or ask the supplier about the lot"
    shown_by = "add positions at 45°, or spins at other speeds, so that each axis feels three magnitudes"
    drawn_over = "input"
    separated_by = (
        ("quadratic", "tilts between the faces, or other strengths: a centrifuge, coils, spins at other speeds"),
    )
    level = "device"
    of = ("unit", "common")
    parameter = Parameter("coefficient", "1", 4e-4, 1e-4, 1e-3, "force-balance asymmetry, 100–1000 ppm; unchecked")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · |a|."""
        return np.asarray(c * np.abs(signal.true))
