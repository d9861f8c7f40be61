"""Gravity here is not what the recipe says: latitude, height or an anomaly left out.

a gains c · a, the same for every unit and axis. Without a gold reference it is the same as a gain common to all.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> LocalGravity.example().apply(Signal(None, np.array([[0.0, 0.5, -1.0]]), None), np.array([[0.001]]))
array([[ 0.    ,  0.0005, -0.001 ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import SINGLE_COEFFICIENT, Parameter, StimulusEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class LocalGravity(StimulusEffect):
    """g/g_nominal − 1, common to all."""

    physics = "Gravity here is not what the recipe says: latitude, height or an anomaly left out."
    remedy = "enter latitude and altitude of the site in the recipe"
    shown_by = "measure a gold reference"
    drawn_over = "input"
    level = "rig"
    of = ("common",)
    axes = SINGLE_COEFFICIENT
    parameter = Parameter(
        "coefficient", "1", 7e-4, -2.8e-3, 2.6e-3, "normal gravity from the equator to the pole (WGS 84)"
    )
    quantities = ("acceleration",)
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · a."""
        return np.asarray(c * signal.true)
