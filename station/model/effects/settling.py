"""The fixture still swings when the dwell begins: the last move has not died away.

a_i gains c_i · (previous − present) · e^(−t/τ) · cos(2πft), t since arrival; f = 0 is a fixture that does not ring.

>>> import numpy as np
>>> from types import SimpleNamespace
>>> from station.model.scene import Scene
>>> scene = Scene(None, None, np.arange(1), np.zeros(1), since_arrival_s=np.array([0.1]))
>>> Settling.example().apply(SimpleNamespace(scene=scene, step=np.array([[-1.0, 0.0, 1.0]])), np.ones((1, 3)))
array([[-0.36787944,  0.        ,  0.36787944]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, StimulusEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Settling(StimulusEffect):
    """Fraction of the move that is left on arrival, per axis, common to the rig."""

    physics = "The fixture still swings when the dwell begins: the last move has not died away."
    remedy = "lengthen `settle.time_s` in the recipe, or stiffen the fixture"
    shown_by = "set `settle.time_s` to 0, so that the dwell begins during the move's last swing"
    drawn_over = "dwell"
    separated_by = (("filter-lag", "a run with the device's own filter off: what swings in the rig stays"),)
    level = "rig"
    of = ("common", "nest")
    parameter = Parameter(
        "coefficient", "1", 3e-3, 1e-4, 1e-2, "benches after a move, .1–10 mg at the start; unchecked"
    )
    forms = (
        Parameter("time_constant", "s", 0.1, 0.02, 0.5, "2–20 Hz at Q 1–10", grid=(0.03, 0.06, 0.12, 0.25, 0.5)),
        Parameter("frequency", "Hz", 0.0, 0.0, 30.0, "0: it does not ring"),
    )
    needs = ("since_arrival_s",)
    size: float = parameter.typical
    time_constant_s: float = forms[0].typical
    frequency_hz: float = forms[1].typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · (previous − present) · e^(−t/τ) · cos(2πft)."""
        t = signal.scene.require("since_arrival_s")
        remaining = np.exp(-t / self.time_constant_s)
        if self.frequency_hz:
            remaining = remaining * np.cos(2 * np.pi * self.frequency_hz * t)
        return np.asarray(c * signal.step * remaining[:, None])
