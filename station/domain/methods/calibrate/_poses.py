"""Checks of a recipe's positions that several methods share."""

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError

#: A position counts as a face when its truth is within this angle of an axis.
FACE_DEG = 5.0
FACES = tuple(f"{s}{a}" for a in "xyz" for s in "+-")


def directions(recipe: Recipe) -> Floats:
    """Nominal truths (p, 3) of the recipe's positions at home."""
    return np.array([recipe.true_vector(p) for p in recipe.positions])


def faces(recipe: Recipe) -> tuple[str, ...]:
    """The face of each position: +x … −z where the truth lies along an axis, '' otherwise."""
    out = []
    for true in directions(recipe):
        size = float(np.linalg.norm(true))
        i = int(np.abs(true).argmax())
        straight = size > 0 and abs(true[i]) / size > np.cos(np.deg2rad(FACE_DEG))
        out.append(f"{'+' if true[i] > 0 else '-'}{'xyz'[i]}" if straight else "")
    return tuple(out)


def require_poses(recipe: Recipe) -> None:
    """RecipeError when a method that needs known poses has none."""
    if not recipe.pose_known:
        raise RecipeError("method-needs-poses", method=recipe.method)


def require_positions(recipe: Recipe, count: int) -> None:
    """RecipeError when the recipe has another number of positions than the method is made for."""
    require_poses(recipe)
    if len(recipe.positions) != count and recipe.reference.source != "gold":
        raise RecipeError(
            f"{recipe.method}-positions", recipe=recipe.name, positions=len(recipe.positions), count=count
        )
