"""The device warms itself after power-on, and its offset settles.

reading_i gains A_i · e^(−t/τ), t since power-on.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(1), np.array([0.0]), since_power_s=np.array([40.0]))
>>> WarmUp.example().apply(Signal(scene, np.array([[1.0, 0.0, -1.0]]), None), np.array([[1.0, 2.0, 0.0]]))
array([[0.36787944, 0.73575888, 0.        ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class WarmUp(SensorEffect):
    """Offset at power-on, per unit and axis."""

    physics = "The device warms itself after power-on, and its offset settles."
    remedy = "power the units several time constants before the first visit"
    shown_by = "add a run with the units powered long before"
    drawn_over = "since-power"
    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "amplitude", "u", 5e-4, 1e-4, 2e-3, "2–3 °C of self-heating, ≤ 1 mg/h for 3 h (LIS3DH); unchecked for seconds"
    )
    forms = (
        Parameter(
            "time_constant",
            "s",
            40.0,
            10.0,
            600.0,
            "mass of a small module",
            grid=(10.0, 20.0, 40.0, 80.0, 160.0, 320.0),
        ),
    )
    needs = ("since_power_s",)
    size: float = parameter.typical
    time_constant_s: float = forms[0].typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """A · e^(−t/τ)."""
        return np.asarray(c * np.exp(-signal.scene.require("since_power_s") / self.time_constant_s)[:, None])
