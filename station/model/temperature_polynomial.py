"""A coefficient that follows the temperature: a polynomial of degree 1 to 3 about one temperature."""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.errors import InputError
from station.model.effect import Coefficient, Parameter, SensorEffect
from station.model.scene import Scene

#: Distance from the middle at which a drawn square or cube is as large as the straight part.
CURVATURE_SPAN_DEGC = 30.0
_EXPONENTS = ("", "²", "³")


@dataclass(frozen=True)
class TemperaturePolynomial(SensorEffect):
    """Coefficients (groups, 3 · degree): x, y, z of (T − about), then of its square, then of its cube.

    about_degC: 25 °C, where data sheets give offset and gain; a diagnosis takes the mean of its data. A straight
    line's coefficient does not depend on it.
    """

    forms = (
        Parameter("degree", "", 1.0, 1.0, 3.0, "a straight line over ±20 °C; −20 … 75 °C takes a cube"),
        Parameter("about", "degC", 25.0, -40.0, 125.0, "temperature at which data sheets give offset and gain"),
    )
    needs = ("temperature_degC",)
    degree: int = 1
    about_degC: float = 25.0

    def __post_init__(self) -> None:
        if self.degree not in (1, 2, 3):
            raise InputError("effect-degree", effect=self.id, degree=self.degree)

    @property
    def columns(self) -> tuple[Coefficient, ...]:
        """coefficient, coefficient2, coefficient3 of each axis, per degC, degC², degC³."""
        p = self.parameter
        return tuple(
            Coefficient(p.name + (str(n) if n > 1 else ""), axis, p.unit + _EXPONENTS[n - 1])
            for n in range(1, self.degree + 1)
            for axis in self.axes
        )

    @property
    def form_parameters(self) -> tuple[Parameter, ...]:
        """Degree and middle, of what is no straight line."""
        return self.forms if self.degree > 1 else ()

    def size_of(self, coefficients: Floats) -> float:
        """The rms of the straight part."""
        return super().size_of(coefficients[:, : len(self.axes)])

    def draw(self, groups: int, rng: np.random.Generator) -> Floats:
        """Coefficients (groups, 3 · degree), each power's rms `size` at CURVATURE_SPAN_DEGC from the middle."""
        parts = [super(TemperaturePolynomial, self).draw(groups, rng) for _ in range(self.degree)]
        return np.concatenate([part / CURVATURE_SPAN_DEGC**n for n, part in enumerate(parts)], axis=1)

    def polynomial(self, scene: Scene, c: Floats) -> Floats:
        """Σ cₙ · (T − about)ⁿ (n, 3) of the rows' coefficients c (n, 3 · degree)."""
        off = (scene.require("temperature_degC") - self.about_degC)[:, None]
        powers = [off**n * c[:, 3 * (n - 1) : 3 * n] for n in range(1, self.degree + 1)]
        return np.asarray(sum(powers[1:], powers[0]))
