"""A reading grows with the square of what the axis feels: the suspension's second-order nonlinearity.

reading_i gains c_i · a_i². Unlike gain it is even: up and down err the same way.

>>> import numpy as np
>>> from station.model.effects.quadratic import Quadratic
>>> Quadratic().size
0.0003
"""

from dataclasses import dataclass

from station.domain.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Quadratic(SensorEffect):
    """Coefficient of a², 1/u, per unit and axis."""

    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "1/u", 3e-4, 1e-4, 2.5e-3, "data sheets ADXL355 and ICM-42688 ≤ 500 µg/g², ADXL313 ≤ 2500"
    )
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · a²."""
        return c * signal.true**2
