"""The offset follows the temperature.

reading_i gains c_i · (T − T₀) + c2_i · (T − T₀)² + c3_i · (T − T₀)³, as far as its degree goes; T₀ is 25 °C. In a
single run temperature follows time, and so do drift and warm-up.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([0.0]), temperature_degC=np.array([35.0]))
>>> OffsetTemperature.example().apply(Signal(scene, np.array([[1.0, 0.0, -1.0]]), None), np.array([[0.1, 0.2, 0.3]]))
array([[1., 2., 3.]])
>>> square = OffsetTemperature(1e-4, degree=2)
>>> square.apply(Signal(scene, np.zeros((1, 3)), None), np.array([[0, 0, 0, 0.01, 0.02, 0.03]]))
array([[1., 2., 3.]])
"""

from dataclasses import dataclass

from station.domain.core.types import Floats
from station.model.effect import Parameter
from station.model.scene import Signal
from station.model.temperature_polynomial import TemperaturePolynomial


@dataclass(frozen=True)
class OffsetTemperature(TemperaturePolynomial):
    """Change of offset, per unit and axis."""

    physics = "The offset follows the temperature."
    remedy = "compensate the offset by the device's own thermometer, or calibrate at one steady temperature"
    shown_by = "add a run 10 °C warmer"
    drawn_over = "temperature"
    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "u/degC", 1.5e-4, 2e-5, 8e-4, "data sheets: ±.02 typ ADXL355, ±.1–.5 ST, ±.15 ICM, ±.8 mg/K MPU"
    )
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """Σ cₙ · (T − T₀)ⁿ."""
        return self.polynomial(signal.scene, c)
