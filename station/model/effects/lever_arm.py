"""The fixture still turns on arrival, and the sensor, away from the axis, feels it.

a_i gains A_i · e^(−t/τ), t since arrival: ω²r while ω dies away. At constant ω it could not be told from an offset.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.zeros(1), since_arrival_s=np.array([0.15]))
>>> LeverArm.example().apply(Signal(scene, np.zeros((1, 3)), None), np.array([[1.0, 0.0, 0.0]]))
array([[0.36787944, 0.        , 0.        ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, StimulusEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class LeverArm(StimulusEffect):
    """Acceleration at arrival, per nest (each sits elsewhere) and axis."""

    physics = "The fixture still turns on arrival, and the sensor, away from the axis, feels it."
    remedy = "wait for the full stop: lengthen `settle.time_s` in the recipe"
    shown_by = "set `settle.time_s` to 0, so that the dwell begins during the move's last swing"
    drawn_over = "dwell"
    level = "rig"
    of = ("nest", "common")
    parameter = Parameter("amplitude", "u", 1e-3, 3e-4, 2.5e-2, "ω²r at r = .1 m: .31 mg at 10 °/s, 25 mg at 90 °/s")
    forms = (
        Parameter("time_constant", "s", 0.15, 0.03, 0.5, "run-out of a drive", grid=(0.03, 0.06, 0.12, 0.25, 0.5)),
    )
    needs = ("since_arrival_s",)
    quantities = ("acceleration",)
    size: float = parameter.typical
    time_constant_s: float = forms[0].typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """A · e^(−t/τ)."""
        return np.asarray(c * np.exp(-signal.scene.require("since_arrival_s") / self.time_constant_s)[:, None])
