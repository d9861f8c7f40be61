"""DT0053 six-point: offsets, gains and cross-axis gains from the six faces."""

from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods.calibrate import _linear, _poses
from station.domain.methods.method import Fit, FitProblem
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError


class SixPoint:
    """Xofs = mean of all six X readings, XtoY = (y(+X) − y(−X))/2 (ST DT0053).

    Written as plain least squares, to which the closed form is equal at six balanced faces.
    """

    open_ended: ClassVar[bool] = False
    by_magnitude: ClassVar[bool] = False

    def check(self, recipe: Recipe) -> None:
        """The six faces, each once."""
        _poses.require_positions(recipe, 6)
        missing = [face for face in _poses.FACES if face not in _poses.faces(recipe)]
        if missing and recipe.reference.source != "gold":
            raise RecipeError("six-point-faces", recipe=recipe.name, missing=", ".join(missing))

    def design(self, true: Floats, recipe: Recipe, nuisance: Floats) -> tuple[Floats, tuple[str, ...]]:
        """One regression, the same for each axis."""
        return np.column_stack([np.ones(len(true)), true]), _linear.matrix_names(3)

    def together(self, problem: FitProblem) -> Fit | None:
        """By one solution for all units that went through the same visits."""
        return _linear.fit_shared(problem.without_nuisance(), _linear.MATRIX, weighted=False)

    def fit(self, problem: FitProblem) -> Fit:
        """Twelve coefficients, all visits alike."""
        return _linear.solve(problem.without_nuisance(), _linear.MATRIX, weighted=False)
