"""The offset jumps in the middle of a run and stays: a part slips, a solder joint gives, a supply sags.

reading_i gains c_i from `at_s` on, in the runs that are hit: one in four, and at least one.

>>> import numpy as np
>>> from station.model.scene import Scene, Signal
>>> scene = Scene(None, None, np.arange(2), np.array([10.0, 20.0]))
>>> Step(at_s=20.0).apply(Signal(scene, np.zeros((2, 3)), None), np.full((2, 3), 0.1))
array([[0. , 0. , 0. ],
       [0.1, 0.1, 0.1]])
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.model.effect import Parameter, SensorEffect, random_stream
from station.model.scene import Signal
from station.model.timeline import run_timeline


@dataclass(frozen=True)
class Step(SensorEffect):
    """Height of the jump, per run and axis, and its time from the start of the run."""

    physics = "The offset jumps in the middle of a run and stays: a part slips, a solder joint gives, a supply sags."
    remedy = "check the seating and the solder joints of these units, and run them again"
    shown_by = "add visits to a run"
    drawn_over = "time"
    level = "rig"
    of = ("run", "unit", "common")
    parameter = Parameter("offset", "u", 1e-3, 1e-4, 1e-2, "slip of a clamped part, .1–10 mg; unchecked")
    forms = (Parameter("at", "s", 20.0, 0.0, 600.0, "anywhere in the run"),)
    size: float = parameter.typical
    at_s: float = forms[0].typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c from `at_s` on."""
        return np.where(signal.scene.time_s[:, None] >= self.at_s, c, 0.0)

    def coefficients(self, names: Sequence[str], seed: int) -> Floats:
        """Coefficients (runs, 3), zero in the runs that are spared."""
        drawn = super().coefficients(names, seed)
        return np.where(self.draw_hits(names, seed, 0.25)[:, None], drawn, 0.0)

    def with_drawn_form(self, recipe: Recipe, seed: int) -> Self:
        """With a time drawn from the middle half of the recipe's shortest run."""
        shortest = min(run_timeline(recipe, run).duration_s for run in range(len(recipe.runs)))
        return replace(self, at_s=float(np.round(shortest * random_stream(seed, self.id, "at").uniform(0.25, 0.75), 3)))
