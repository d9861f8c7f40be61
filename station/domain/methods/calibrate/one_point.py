"""DT0105 one-point: offsets from a single position; gains are taken as 1, cross-axis as 0."""

from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods.calibrate import _linear, _poses
from station.domain.methods.method import Fit, FitProblem
from station.domain.recipe.recipe import Recipe


class OnePoint:
    """offset = reading − truth (ST DT0105 rev 2). Every error of gain and pose goes straight into the offset."""

    open_ended: ClassVar[bool] = False
    by_magnitude: ClassVar[bool] = False

    def check(self, recipe: Recipe) -> None:
        """One position."""
        _poses.require_positions(recipe, 1)

    def design(self, true: Floats, recipe: Recipe, nuisance: Floats) -> tuple[Floats, tuple[str, ...]]:
        """The offset is seen at every visit."""
        return np.ones((len(true), 1)), ("offset",)

    def together(self, problem: FitProblem) -> Fit | None:
        """By one solution for all units that went through the same visits."""
        return _linear.fit_shared(problem.without_nuisance(), _linear.OFFSET_ONLY, weighted=False)

    def fit(self, problem: FitProblem) -> Fit:
        """Mean of reading − truth over all visits."""
        return _linear.solve(problem.without_nuisance(), _linear.OFFSET_ONLY, weighted=False)
