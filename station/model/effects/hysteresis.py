"""The reading depends on the previous position: the suspension does not fully return.

reading_i gains c_i · (previous − present), of the resting vectors; nothing at the first visit of a run.

>>> import numpy as np
>>> from types import SimpleNamespace
>>> signal = SimpleNamespace(step=np.array([[-1.0, 0.0, 1.0]]))
>>> Hysteresis.example().apply(signal, np.array([[0.1, 0.1, 0.1]]))
array([[-0.1,  0. ,  0.1]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Hysteresis(SensorEffect):
    """Fraction of the step that stays, per unit and axis."""

    physics = "The reading depends on the previous position: the suspension does not fully return."
    remedy = "go round in both directions and average, or ask the supplier about the lot"
    shown_by = "add a run in reversed order"
    drawn_over = "step"
    level = "device"
    of = ("unit", "common")
    parameter = Parameter("coefficient", "1", 1e-4, 2e-5, 2e-4, ".01–.1 % of full scale; unchecked")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · (previous − present)."""
        return np.asarray(c * signal.step)
