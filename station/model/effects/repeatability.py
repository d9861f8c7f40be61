"""The positioner comes to rest at a slightly different angle each time.

Rotation vector in the nest's frame, right-handed, another at each visit. It belongs to the noise floor.

>>> import numpy as np
>>> Repeatability.example().apply(np.array([[0.0, 0.0, 0.001]]))
array([[0.   , 0.   , 0.001]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, PoseEffect


@dataclass(frozen=True)
class Repeatability(PoseEffect):
    """Standard deviation of the angle about each axis of the nest; coefficients are the angles themselves."""

    physics = "The positioner comes to rest at a slightly different angle each time."
    remedy = "check the positioner for play: clamp, bearing, brake; visit positions more than once meanwhile"
    shown_by = "return to one position within a run"
    drawn_over = "position"
    level = "rig"
    of = ("visit",)
    frame = "nest"
    parameter = Parameter("angle", "rad", 1e-4, 2e-5, 2.4e-4, "indexers return to 5–50″; unchecked")
    size: float = parameter.typical

    def draw(self, groups: int, rng: np.random.Generator) -> Floats:
        """Normal angles (groups, 3)."""
        return np.asarray(self.size * rng.standard_normal((groups, 3)))
