"""The axes are not orthogonal: each reads a little of the other two, symmetrically.

reading_i gains s_ij · a_j and reading_j gains s_ij · a_i. The other half, unlike both ways, is `package-rotation`.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> CrossAxis.example().apply(Signal(None, np.array([[1.0, 0.0, 0.0]]), None), np.array([[0.01, 0.02, 0.03]]))
array([[0.  , 0.01, 0.02]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class CrossAxis(SensorEffect):
    """Coefficient of the other axis, per unit and pair of axes."""

    physics = "The axes are not orthogonal: each reads a little of the other two, symmetrically."
    remedy = "calibrate with method n-point, which takes the angles between the axes out"
    shown_by = "add positions that load two axes at once"
    drawn_over = "other-axis"
    level = "device"
    of = ("unit", "common")
    axes = ("xy", "xz", "yz")
    parameter = Parameter(
        "coefficient", "1", 5e-3, 1e-3, 3e-2, "data sheets: 1 % typical, ±.5 % ST, ±1–3 % ADXL313/350"
    )
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """s · a of the other axes."""
        x, y, z = signal.true.T
        xy, xz, yz = c.T
        return np.stack([xy * y + xz * z, xy * x + yz * z, xz * x + yz * y], axis=1)
