"""The offset drifts linearly with time, whatever the temperature does.

reading_i gains c_i · t, t from the start of the run.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([100.0]))
>>> BiasDrift.example().apply(Signal(scene, np.zeros((1, 3)), None), np.array([[1e-3, 2e-3, 0.0]]))
array([[0.1, 0.2, 0. ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class BiasDrift(SensorEffect):
    """Rate of the offset, per unit and axis."""

    physics = "The offset drifts linearly with time, whatever the temperature does."
    remedy = "calibrate offsets at the middle of the run, or return to one position and subtract the drift"
    shown_by = "add visits to a run, and return to one position"
    drawn_over = "time"
    level = "device"
    of = ("unit", "run", "common")
    parameter = Parameter(
        "rate", "u/s", 2e-6, 3e-7, 1e-5, "≤ 1 mg/h steady (LIS3DH, 3e-7 g/s); several times that in the first minutes"
    )
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · t."""
        return np.asarray(c * signal.scene.time_s[:, None])
