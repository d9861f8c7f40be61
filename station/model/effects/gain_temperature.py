"""The gain follows the temperature.

reading_i gains (c_i · (T − T₀) + c2_i · (T − T₀)² + c3_i · (T − T₀)³) · a_i, as far as its degree goes; T₀ is 25 °C.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([0.0]), temperature_degC=np.array([35.0]))
>>> GainTemperature.example().apply(Signal(scene, np.array([[1.0, 0.0, -1.0]]), None), np.array([[0.1, 0.2, 0.3]]))
array([[ 1.,  0., -3.]])
>>> square = GainTemperature(1e-4, degree=2)
>>> square.apply(Signal(scene, np.array([[1.0, 0.5, -1.0]]), None), np.array([[0, 0, 0, 0.01, 0.01, 0.02]]))
array([[ 1. ,  0.5, -2. ]])
"""

from dataclasses import dataclass

from station.domain.core.types import Floats
from station.model.effect import Parameter
from station.model.scene import Signal
from station.model.temperature_polynomial import TemperaturePolynomial


@dataclass(frozen=True)
class GainTemperature(TemperaturePolynomial):
    """Change of gain, per unit and axis."""

    physics = "The gain follows the temperature."
    remedy = "compensate the gain by the device's own thermometer, or calibrate at one steady temperature"
    shown_by = "add a run 10 °C warmer"
    drawn_over = "temperature-input"
    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "1/degC", 1e-4, 2e-5, 4e-4, "data sheets: ±100 ADXL355, ±50 ICM and ST, to 400 ppm/K LIS3DSH"
    )
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """Σ cₙ · (T − T₀)ⁿ · a."""
        return self.polynomial(signal.scene, c) * signal.true
