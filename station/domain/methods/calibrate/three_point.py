"""DT0105 three-point: offsets from the two off-axis readings, gains from on-axis minus offset; cross-axis 0."""

from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods.calibrate import _linear, _poses
from station.domain.methods.method import Fit, FitProblem
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError

NAMES = (*(f"offset {a}" for a in "xyz"), *(f"gain {a}" for a in "xyz"))


class ThreePoint:
    """Each axis' line through its three readings (ST DT0105 rev 2): Xofs = (x2 + x3)/2, Xgain = (x1 − Xofs)/m.

    Written as least squares of meas_i = gain_i · true_i + offset_i, of which the table is the case true = m·e_i, so
    that a gold reference, other faces and repeated passes need no formula of their own.
    """

    open_ended: ClassVar[bool] = False
    by_magnitude: ClassVar[bool] = False

    def check(self, recipe: Recipe) -> None:
        """Three positions, one along each axis."""
        _poses.require_positions(recipe, 3)
        axes = {face[1:] for face in _poses.faces(recipe)} - {""}
        if recipe.reference.source != "gold" and len(axes) < 3:
            missing = ", ".join(f"up: +{a}" for a in "xyz" if a not in axes)
            raise RecipeError("three-point-axes", recipe=recipe.name, missing=missing)

    def design(self, true: Floats, recipe: Recipe, nuisance: Floats) -> tuple[Floats, tuple[str, ...]]:
        """Three lines, block by block."""
        v, axes = len(true), recipe.axes
        rows = np.zeros((axes, v, 2 * axes))
        for i in range(axes):
            rows[i, :, i], rows[i, :, axes + i] = 1.0, true[:, i]
        return rows.reshape(axes * v, 2 * axes), (*NAMES[:axes], *NAMES[3 : 3 + axes])

    def together(self, problem: FitProblem) -> Fit | None:
        """By one solution for all units that went through the same visits."""
        return _linear.fit_shared(problem.without_nuisance(), _linear.OFFSET_GAIN, weighted=False)

    def fit(self, problem: FitProblem) -> Fit:
        """Offset and own gain of each axis, all visits alike."""
        return _linear.solve(problem.without_nuisance(), _linear.OFFSET_GAIN, weighted=False)
