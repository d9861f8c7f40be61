"""Accelerometer: at rest it reads +1 g on the axis that points up."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe import assumptions
from station.domain.recipe.recipe import Recipe


class Accelerometer:
    """Specific force in g. Truth: gravity, nominal or at the site, or a gold sensor."""

    unit: ClassVar[str] = "g"
    quantity: ClassVar[str] = "acceleration"
    sources: ClassVar[tuple[str, ...]] = ("gravity", "gold")
    #: LIS3DH, ADXL345: 0.4 to 1.2 mg/degC, 0.01 %/degC.
    usual_tempcos: ClassVar[tuple[float, float]] = (5e-4, 1e-4)
    #: MS1002, MS1010: 0.24 and 1.2 mg within a year; MTi-100: 3 mg.
    usual_turn_on: ClassVar[float] = 5e-4
    feels_earth_rate: ClassVar[bool] = False
    large_offset: ClassVar[bool] = False

    def truth_errors(
        self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats
    ) -> Mapping[str, Floats]:
        """Gravity: local anomalies the site formula leaves out, or the stated uncertainty of the magnitude."""
        return {"gravity": (assumptions.magnitude_relative_std(recipe) * true)[None]}

    def nuisance(self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """Nothing but gravity acts on an accelerometer at rest."""
        return np.zeros((len(position), 0))
