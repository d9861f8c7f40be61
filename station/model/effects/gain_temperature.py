"""The gain follows the temperature.

reading_i gains c_i · (T − 25 °C) · a_i.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([0.0]), temperature_degC=np.array([35.0]))
>>> GainTemperature.example().apply(Signal(scene, np.array([[1.0, 0.0, -1.0]]), None), np.array([[0.1, 0.2, 0.3]]))
array([[ 1.,  0., -3.]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal

#: Temperature at which data sheets give offset and gain.
REFERENCE_DEGC = 25.0


@dataclass(frozen=True)
class GainTemperature(SensorEffect):
    """Change of gain, per unit and axis."""

    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "1/degC", 1e-4, 2e-5, 4e-4, "data sheets: ±100 ADXL355, ±50 ICM and ST, to 400 ppm/K LIS3DSH"
    )
    needs = ("temperature_degC",)
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · (T − 25 °C) · a."""
        return np.asarray(c * (signal.scene.require("temperature_degC") - REFERENCE_DEGC)[:, None] * signal.true)
