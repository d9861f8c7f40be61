"""The rig does not stand level.

Rotation vector in the station's frame, right-handed, before the positioner. About the vertical it could not be seen.

>>> import numpy as np
>>> BaseTilt.example().apply(np.array([[0.001, 0.002]]))
array([[0.001, 0.002, 0.   ]])
"""

from dataclasses import dataclass

from station.model.effect import Parameter, PoseEffect


@dataclass(frozen=True)
class BaseTilt(PoseEffect):
    """Angle about the two level axes of the station, common to all."""

    physics = "The rig does not stand level."
    remedy = "level the rig"
    shown_by = "measure one run with the rig turned on its floor (`base_turn_deg: 180`), or put a level on it"
    drawn_over = "position"
    level = "rig"
    of = ("common", "station")
    frame = "station"
    axes = ("x", "y")
    parameter = Parameter(
        "angle", "rad", 5e-4, 1e-4, 2e-3, "a bench levelled with a bubble, .1–2 mrad (1″ is 4.85 µg); unchecked"
    )
    quantities = ("acceleration", "magnetic field", "inclination")
    size: float = parameter.typical
