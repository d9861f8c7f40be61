"""The nest holds every part turned by the same small angle: a worn or badly shimmed seat.

Rotation vector in the nest's frame, between the positioner's plate and the part; the same for all units of a nest.

>>> from station.model.effects.nest_tilt import NestTilt
>>> NestTilt().frame
'nest'
"""

from dataclasses import dataclass

from station.model.effect import Parameter, PoseEffect


@dataclass(frozen=True)
class NestTilt(PoseEffect):
    """Angle, rad, about each axis of the nest."""

    level = "rig"
    of = ("nest", "common")
    frame = "nest"
    parameter = Parameter(
        "angle", "rad", 2e-3, 5e-4, 5e-3, "workshop experience with milled nests, .5–5 mrad; unchecked"
    )
    size: float = parameter.typical
