"""The device's low-pass filter still holds part of the last orientation.

What it passes on gains c_i · (previous − present) · e^(−t/τ), t since arrival. A linear filter and a gain can change
places, so it acts where `settling` does: without ringing the two differ only in whose coefficient it is, and in that a
run with the filter off (`filter: "off"`) has none of it. Devices switch it in their object dictionary (CiA 404: 61A0h);
what they send how often does not change it.

>>> import numpy as np
>>> from types import SimpleNamespace
>>> from station.model.scene import Scene
>>> recipe = SimpleNamespace(filters_off=False)
>>> scene = Scene(recipe, None, np.arange(1), np.zeros(1), since_arrival_s=np.array([0.08]))
>>> FilterLag.example().apply(SimpleNamespace(scene=scene, step=np.array([[-1.0, 0.0, 1.0]])), np.ones((1, 3)))
array([[-0.36787944,  0.        ,  0.36787944]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, StimulusEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class FilterLag(StimulusEffect):
    """Fraction of the step that is left on arrival, per unit and axis."""

    physics = "The device's low-pass filter still holds part of the last orientation."
    remedy = "lengthen `settle.time_s` in the recipe, or set a faster filter while calibrating"
    shown_by = "set `settle.time_s` to 0, so that the dwell begins during the move's last swing"
    drawn_over = "dwell"
    separated_by = (("settling", "a run with the device's own filter off: what swings in the rig stays"),)
    level = "device"
    of = ("unit", "common")
    parameter = Parameter(
        "coefficient", "1", 3e-3, 1e-4, 1e-2, "first-order filter of 2–20 Hz after a move of 1.5 s; calculated"
    )
    forms = (
        Parameter("time_constant", "s", 0.08, 0.01, 0.5, "1/(2πf) of the filter", grid=(0.03, 0.06, 0.12, 0.25, 0.5)),
    )
    needs = ("since_arrival_s",)
    size: float = parameter.typical
    time_constant_s: float = forms[0].typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · (previous − present) · e^(−t/τ); 0 where the filter is off."""
        scene = signal.scene
        remaining = np.exp(-scene.require("since_arrival_s") / self.time_constant_s)
        if scene.recipe.filters_off:
            works = np.array([run.filter == "on" for run in scene.recipe.runs])
            remaining = remaining * works[scene.visits.run % len(works)][scene.visit]
        return np.asarray(c * signal.step * remaining[:, None])
