"""The nest holds every part at the same wrong angle: a worn or badly shimmed seat.

Rotation vector in the nest's frame, right-handed, between the plate and the part. The gold sits in the nest too.

>>> import numpy as np
>>> NestTilt.example().apply(np.array([[0.0, 0.0, 0.001]]))
array([[0.   , 0.   , 0.001]])
"""

from dataclasses import dataclass

from station.model.effect import Parameter, PoseEffect


@dataclass(frozen=True)
class NestTilt(PoseEffect):
    """Angle about each axis of the nest, per nest."""

    physics = "The nest holds every part at the same wrong angle: a worn or badly shimmed seat."
    remedy = "shim or replace the seat of the nest, then measure its orientation again"
    shown_by = "add a run with the units turned in the nest (`seating`), or use several nests"
    drawn_over = "position"
    level = "rig"
    of = ("nest", "common")
    frame = "nest"
    parameter = Parameter("angle", "rad", 2e-3, 5e-4, 5e-3, "milled nests, .5–5 mrad; unchecked")
    size: float = parameter.typical
