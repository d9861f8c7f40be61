"""The offset follows the rate of temperature change: the package is warmer on one side.

reading_i gains c_i · dT/dt: a loop in the offset against temperature, open as long as it changes.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([0.0]), temperature_rate=np.array([0.01]))
>>> TemperatureRate.example().apply(Signal(scene, np.array([[1.0, 0.0, -1.0]]), None), np.array([[0.1, 0.2, 0.3]]))
array([[0.001, 0.002, 0.003]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class TemperatureRate(SensorEffect):
    """Offset for each degree a second, per unit and axis."""

    physics = "The offset follows the rate of temperature change: the package is warmer on one side."
    remedy = "let the units reach room temperature before the run, and keep draughts away"
    shown_by = "let the temperature rise and fall within a run (`temperature_swing_degC: 1`)"
    drawn_over = "temperature-rate"
    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "u·s/degC", 0.2, 0.02, 0.9, "up to 14.8 mg between ramps of 1 °C a minute, measured on MEMS"
    )
    needs = ("temperature_rate",)
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · dT/dt."""
        return np.asarray(c * signal.scene.require("temperature_rate")[:, None])
