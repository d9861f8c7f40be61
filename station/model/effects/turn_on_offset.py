"""Each power-on leaves another offset.

reading_i gains c_i of the power cycle. Each run is one, unless `since_power_s` goes on or starts anew within a run.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> TurnOnOffset.example().apply(Signal(None, np.zeros((2, 3)), None), np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]))
array([[0.1, 0. , 0. ],
       [0.2, 0. , 0. ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class TurnOnOffset(SensorEffect):
    """Offset of a power cycle, per run (or power-on) and axis."""

    physics = "Each power-on leaves another offset."
    remedy = "calibrate the offset after each power-on, or keep the units powered from calibration to use"
    shown_by = "measure each unit in two runs or more, with a power cycle between them"
    drawn_over = "run"
    level = "device"
    of = ("run", "power-on")
    parameter = Parameter("offset", "u", 5e-4, 1e-4, 5e-3, "turn-on repeatability of MEMS, .1–5 mg; unchecked")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c, from one power-on to the next."""
        return np.asarray(c + 0.0 * signal.true)
