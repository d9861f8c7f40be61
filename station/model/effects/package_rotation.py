"""The sensor sits rotated in its housing: soldered askew.

Rotation vector in the device's frame, right-handed: R becomes R · exp(ε). Its mean is the same as `nest-tilt`.

>>> import numpy as np
>>> PackageRotation.example().apply(np.array([[0.0, 0.0, 0.001]]))
array([[0.   , 0.   , 0.001]])
"""

from dataclasses import dataclass

from station.model.effect import Parameter, PoseEffect


@dataclass(frozen=True)
class PackageRotation(PoseEffect):
    """Angle about each axis of the device, per unit."""

    physics = "The sensor sits rotated in its housing: soldered askew."
    remedy = "calibrate with method n-point, which takes the rotation out, or ask the supplier how the sensor is placed"
    shown_by = "add a run with the units turned in the nest (`seating`)"
    drawn_over = "position"
    level = "device"
    of = ("unit", "common")
    frame = "device"
    parameter = Parameter(
        "angle", "rad", 5e-3, 5e-4, 1e-2, "reflow of small packages, 1–10 mrad, .5 when aligned; unchecked"
    )
    size: float = parameter.typical
