"""Magnetometer: hard iron is its offset, soft iron its matrix; nothing can tell them from the sensor's own."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe import assumptions
from station.domain.recipe.recipe import Recipe


class Magnetometer:
    """Flux density in µT. Truth: a known field, of Helmholtz coils or of the Earth, or a gold sensor."""

    unit: ClassVar[str] = "uT"
    quantity: ClassVar[str] = "magnetic field"
    sources: ClassVar[tuple[str, ...]] = ("field", "gold")
    #: LSM303AGR, LIS2MDL: 0.3 mG/degC, 0.03 %/degC.
    usual_tempcos: ClassVar[tuple[float, float]] = (0.03, 3e-4)
    #: HMC1001: 0.4 mG after a set pulse, 1 mG after fields of 2 G.
    usual_turn_on: ClassVar[float] = 0.05
    feels_earth_rate: ClassVar[bool] = False
    large_offset: ClassVar[bool] = True

    def truth_errors(
        self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats
    ) -> Mapping[str, Floats]:
        """The field's magnitude is known to reference.magnitude_std; its direction: references.direction_errors."""
        return {"field": (assumptions.magnitude_relative_std(recipe) * true)[None]}

    def nuisance(self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """Iron of the unit turns with it and is what we calibrate; iron of the rig belongs into reference.vector."""
        return np.zeros((len(position), 0))
