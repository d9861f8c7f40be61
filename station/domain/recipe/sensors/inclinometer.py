"""Inclinometer (CiA 410): one or two angles against gravity, longitudinal (x) and lateral (y)."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe.blocks import DeviceSheet
from station.domain.recipe.recipe import Recipe


class Inclinometer:
    """Angles in degrees against the fixture's; its offset is the zero, its matrix scale and cross-coupling.

    With u the direction of up in the device's frame, `device.convention` says what an angle is:

    horizon: arcsin u_x, arcsin u_y: between the axis and the horizontal plane;
    projected: atan2(u_x, u_z), atan2(u_y, u_z): turn about the other axis, each in its own plane;
    about-z, about-z-360: atan2(u_x, u_y): the one axis of a device mounted upright, −180 to 180 or 0 to 360.

    Where a full circle ends its readings jump: no position may stand there. Only n-point (and one-point for a zero
    alone) can calibrate angles; gravity's size does not matter to them, tilts of nest and base do.
    """

    unit: ClassVar[str] = "deg"
    quantity: ClassVar[str] = "inclination"
    sources: ClassVar[tuple[str, ...]] = ("gravity",)
    axes: ClassVar[tuple[int, ...]] = (2, 1)
    conventions: ClassVar[tuple[str, ...]] = ("horizon", "projected", "about-z", "about-z-360")
    methods: ClassVar[tuple[str, ...]] = ("n-point", "one-point")
    unit_per_rad: ClassVar[float] = float(np.rad2deg(1.0))
    #: usual CiA 410 devices: 0.01 deg/degC, 0.01 %/degC.
    usual_tempcos: ClassVar[tuple[float, float]] = (0.01, 1e-4)
    #: MS1002, of whose kind they are made: 0.24 mg.
    usual_turn_on: ClassVar[float] = 0.014
    feels_earth_rate: ClassVar[bool] = False
    #: An angle may be nothing but its offset: size and direction of (x, y) say nothing about a face.
    large_offset: ClassVar[bool] = True

    def truth(self, sheet: DeviceSheet, felt: Floats) -> Floats:
        """Angles (…, 3), deg, of up (…, 3) of any length in the device's frame; the third is 0."""
        x, y, z = np.moveaxis(np.asarray(felt, float), -1, 0)
        size = np.sqrt(x**2 + y**2 + z**2)
        convention = sheet.convention or self.conventions[0]
        if convention.startswith("about-z"):
            turned = np.rad2deg(np.arctan2(x, y))
            angles = [np.mod(turned, 360.0) if convention == "about-z-360" else turned]
        elif convention == "projected":
            angles = [np.rad2deg(np.arctan2(x, z)), np.rad2deg(np.arctan2(y, z))]
        else:
            angles = [np.rad2deg(np.arcsin(np.clip(part / size, -1.0, 1.0))) for part in (x, y)]
        there = angles[: sheet.axes or self.axes[0]]
        return np.stack([*there, *[np.zeros_like(size)] * (3 - len(there))], axis=-1)

    def truth_errors(
        self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats
    ) -> Mapping[str, Floats]:
        """Nothing but its direction can be wrong with gravity, and tilts are the references' matter."""
        return {"gravity": np.zeros((0, *true.shape))}

    def nuisance(self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """Nothing but gravity acts on an inclinometer at rest."""
        return np.zeros((len(position), 0))
