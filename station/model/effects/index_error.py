"""A position of the rig is off by the same angle every time and for every unit.

Rotation vector in the nest's frame, right-handed. One unit cannot tell it from `repeatability`.

>>> import numpy as np
>>> IndexingError.example().apply(np.array([[0.0, 0.0, 0.001]]))
array([[0.   , 0.   , 0.001]])
"""

from dataclasses import dataclass

from station.model.effect import Parameter, PoseEffect


@dataclass(frozen=True)
class IndexingError(PoseEffect):
    """Angle about each axis of the nest, per position."""

    physics = "A position of the rig is off by the same angle every time and for every unit."
    remedy = "measure the positioner's angles and enter them in the recipe, or have the index serviced"
    shown_by = "measure two units or more, and one run in reversed order"
    drawn_over = "position"
    separated_by = (
        ("base-tilt", "a level on the rig: an error of every position can look like its tilt"),
        ("nest-tilt", "the same positions in another nest"),
    )
    level = "rig"
    of = ("position",)
    frame = "nest"
    parameter = Parameter(
        "angle", "rad", 5e-4, 5e-5, 1.7e-3, "worm or stepper .2–1.7 mrad; a dividing head 1–10″, .005–.05 mrad"
    )
    size: float = parameter.typical
