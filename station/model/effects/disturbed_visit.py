"""One visit is wrong: somebody bumped the rig, or the part is not fully seated.

Rotation vector in the nest's frame, right-handed, at one visit in fifty, and at least at one.

>>> import numpy as np
>>> DisturbedVisit.example().apply(np.array([[0.0, 0.0, 0.001]]))
array([[0.   , 0.   , 0.001]])
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, PoseEffect


@dataclass(frozen=True)
class DisturbedVisit(PoseEffect):
    """Angle about each axis of the nest, per visit."""

    physics = "One visit is wrong: somebody bumped the rig, or the part is not fully seated."
    remedy = "run these units again, and find who or what touches the rig"
    shown_by = "make more than one visit a unit"
    drawn_over = "visits"
    level = "rig"
    of = ("visit",)
    frame = "nest"
    parameter = Parameter("angle", "rad", 5e-3, 1e-3, 5e-2, "a part that is not quite seated, .05–3°; unchecked")
    size: float = parameter.typical

    def coefficients(self, names: Sequence[str], seed: int) -> Floats:
        """Angles (visits, 3), zero at the visits that are spared."""
        drawn = super().coefficients(names, seed)
        return np.where(self.draw_hits(names, seed, 0.02)[:, None], drawn, 0.0)
