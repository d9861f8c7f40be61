"""N-point: weighted least squares for any positions, offset and gain or the full matrix."""

from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods.calibrate import _linear, _poses
from station.domain.methods.calibrate.three_point import ThreePoint
from station.domain.methods.method import Fit, FitProblem
from station.domain.recipe.recipe import Recipe


class NPoint:
    """[A|B] = M·W·Tᵀ·(T·W·Tᵀ)⁻¹ (ST DT0053's N-point with weights W = 1/variance, Aitken 1935).

    Weights know the noise of every stop and the declared error of poses; what acts on the sensor besides the
    stimulus (a gyroscope's g-sensitivity) is fitted beside the coefficients where the positions tell it apart.
    """

    open_ended: ClassVar[bool] = True
    by_magnitude: ClassVar[bool] = False

    def check(self, recipe: Recipe) -> None:
        """Any positions whose pose is known."""
        _poses.require_poses(recipe)

    def design(self, true: Floats, recipe: Recipe, nuisance: Floats) -> tuple[Floats, tuple[str, ...]]:
        """One regression, the same for each axis; for offset and gain, three lines."""
        if recipe.model == "offset-gain":
            rows, names = ThreePoint().design(true, recipe, nuisance)
            more = np.kron(np.eye(recipe.axes), nuisance)
            return np.column_stack([rows, more]), (*names, *("g-sensitivity",) * more.shape[1])
        rows = np.column_stack([np.ones(len(true)), true[:, : recipe.axes], nuisance])
        return rows, (*_linear.matrix_names(recipe.axes), *("g-sensitivity",) * nuisance.shape[1])

    def together(self, problem: FitProblem) -> Fit | None:
        """By one solution for all units whose visits count alike."""
        return _linear.fit_shared(problem, _linear.COLUMNS_OF_MODEL[problem.model], weighted=True)

    def fit(self, problem: FitProblem) -> Fit:
        """Weighted least squares."""
        return _linear.solve(problem, _linear.COLUMNS_OF_MODEL[problem.model], weighted=True)
