"""Vibration beyond the sensor's band shifts its mean: its nonlinearity rectifies it.

reading_i gains c_i · motor²: vibration grows with the drive level of the line's motors.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([0.0]), motor=np.array([0.5]))
>>> VibrationRectification.example().apply(Signal(scene, np.zeros((1, 3)), None), np.array([[0.1, 0.2, 0.0]]))
array([[0.025, 0.05 , 0.   ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class VibrationRectification(SensorEffect):
    """Shift at full drive, per unit and axis."""

    physics = "Vibration beyond the sensor's band shifts its mean: its nonlinearity rectifies it."
    remedy = "switch the motors off while measuring, or decouple the fixture from them"
    shown_by = "add a run with the motors off (`motors: off`)"
    drawn_over = "motor"
    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "u", 3e-4, 1e-5, 1e-3, "data sheets: 1 mg IIS2ICLX; ADXL355 < .4 g at 2.5 g rms"
    )
    needs = ("motor",)
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · motor²."""
        return np.asarray(c * signal.scene.require("motor")[:, None] ** 2)
