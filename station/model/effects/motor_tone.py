"""A motor of the line shakes the fixture at one frequency; sampling may alias it.

a_i gains A_i · motor · sin(2πft + φ), t on the clock of the whole campaign, taken at the instants of the samples.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> at = dict(started_s=np.zeros(2), motor=np.array([1.0, 0.5]))
>>> scene = Scene(None, None, np.arange(2), np.array([0.0, 0.01]), **at)
>>> MotorTone(frequency_hz=25.0).apply(Signal(scene, np.zeros((2, 3)), None), np.full((2, 3), 2.0)).round(9)
array([[0., 0., 0.],
       [1., 1., 1.]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, StimulusEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class MotorTone(StimulusEffect):
    """Amplitude at full drive, per axis, common to the line."""

    physics = "A motor of the line shakes the fixture at one frequency; sampling may alias it."
    remedy = "switch the motor off while measuring, or change the sample rate so that the tone averages out"
    shown_by = "record `motor` and `started_s`, with the motors on in one run and off in another"
    drawn_over = "spectrum"
    level = "rig"
    of = ("common", "nest")
    parameter = Parameter("amplitude", "u", 5e-4, 1e-5, 1e-3, "conveyors and pumps through a bench, .01–1 mg")
    forms = (
        Parameter("frequency", "Hz", 23.7, 1.0, 400.0, "motor shafts at 1000–3000 a minute and their gears"),
        Parameter("phase", "rad", 0.0, 0.0, 6.2832, "any"),
    )
    needs = ("motor", "started_s")
    size: float = parameter.typical
    frequency_hz: float = forms[0].typical
    phase_rad: float = forms[1].typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """A · motor · sin(2πft + φ)."""
        t = signal.scene.time_s + signal.scene.require("started_s")
        tone = signal.scene.require("motor") * np.sin(2 * np.pi * self.frequency_hz * t + self.phase_rad)
        return np.asarray(c * tone[:, None])
