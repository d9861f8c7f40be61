"""The fixture still swings to its place when the dwell begins: the rest of the last move dies away.

a gains c · (previous − present) · e^(−t/τ) · cos(2πft), t since arrival; f = 0 is an overdamped fixture.

>>> from station.model.effects.settling import Settling
>>> Settling().time_constant_s
0.1
"""

from dataclasses import dataclass

import numpy as np

from station.domain.types import Floats
from station.model.effect import Parameter, StimulusEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Settling(StimulusEffect):
    """Fraction of the move that is left on arrival, 1."""

    level = "rig"
    of = ("common", "nest")
    parameter = Parameter(
        "coefficient", "1", 3e-3, 1e-4, 1e-2, "model-discrepancy catalogue, .1–10 mg at the start; unchecked"
    )
    forms = (
        Parameter(
            "time_constant",
            "s",
            0.1,
            0.02,
            0.5,
            "benches ring at 2–20 Hz with Q 1–10",
            grid=(0.03, 0.06, 0.1, 0.2, 0.4),
        ),
        Parameter("frequency", "Hz", 0.0, 0.0, 30.0, "0: no ringing"),
    )
    needs = ("since_arrival_s",)
    size: float = parameter.typical
    time_constant_s: float = 0.1
    frequency_hz: float = 0.0

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · step · e^(−t/τ) · cos(2πft)."""
        t = signal.scene.need("since_arrival_s")
        left = np.exp(-t / self.time_constant_s) * np.cos(2 * np.pi * self.frequency_hz * t)
        return np.asarray(c * signal.step * left[:, None])
