"""The clamp's stress on the part relaxes, and the offset with it.

reading_i gains A_i · ln(1 + t/t₀), t since clamping.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([0.0]), since_clamp_s=np.array([10.0]))
>>> ClampCreep.example().apply(Signal(scene, np.array([[1.0, 0.0, -1.0]]), None), np.array([[1.0, 2.0, 0.0]]))
array([[0.69314718, 1.38629436, 0.        ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class ClampCreep(SensorEffect):
    """Offset for each factor e of time, per unit and axis."""

    physics = "The clamp's stress on the part relaxes, and the offset with it."
    remedy = "wait after clamping, or clamp with less force"
    shown_by = "add a run without opening the clamp"
    drawn_over = "since-clamp"
    level = "rig"
    of = ("unit", "nest", "common")
    parameter = Parameter("amplitude", "u", 3e-4, 5e-5, 2e-3, "stress of .1–several mg relaxing in minutes; unchecked")
    forms = (
        Parameter(
            "time_constant", "s", 10.0, 1.0, 100.0, "logarithmic creep of plastics", grid=(1.0, 3.0, 10.0, 30.0, 100.0)
        ),
    )
    needs = ("since_clamp_s",)
    size: float = parameter.typical
    time_constant_s: float = forms[0].typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """A · ln(1 + t/t₀)."""
        return np.asarray(c * np.log1p(signal.scene.require("since_clamp_s") / self.time_constant_s)[:, None])
