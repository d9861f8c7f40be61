"""Where the true stimulus comes from, and how wrong it may be."""

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe.recipe import GoldReference, Recipe
from station.errors import RecipeError, ReferenceOverdue

#: Nominal stimulus (v, 3) by positions and seatings: units of one fleet share it.
Truths = dict[tuple[tuple[str, ...], tuple[str, ...]], Floats]


def true_vectors(recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
    """Nominal stimulus (v, 3) in the device's frame for stops by name; NaN where the pose is unknown."""
    if not recipe.pose_known:
        return np.full((len(position), 3), np.nan)
    known = {
        key: recipe.true_vector(recipe.position(key[0]), key[1]) for key in set(zip(position, seating, strict=True))
    }
    return np.array([known[key] for key in zip(position, seating, strict=True)])


def gold_vectors(recipe: Recipe, reading: tuple[Floats, Floats], seating: tuple[str, ...]) -> tuple[Floats, Floats]:
    """The stimulus (v, 3) in the device's frame as a gold reference measured it, and its covariance (v, 3, 3).

    reading: mean (v, 3) and covariance (v, 3, 3) of the gold sensor, which sits in the nest's frame: its own
    calibration is undone, then the seating turns it into the device's frame.
    """
    gold = gold_of(recipe)
    mean, cov = reading
    inverse = np.linalg.inv(np.array(gold.matrix))
    back = np.array([recipe.seating(s).T for s in seating]) @ inverse
    true = np.einsum("vij,vj->vi", back, mean - np.array(gold.offset))
    return true, back @ cov @ back.transpose(0, 2, 1)


def gold_of(recipe: Recipe) -> GoldReference:
    """The gold reference of a recipe that has one; RecipeError otherwise."""
    if recipe.reference.gold is None:
        raise RecipeError("reference-gold-missing")
    return recipe.reference.gold


def check_due(recipe: Recipe, today: str) -> None:
    """ReferenceOverdue when the recipe takes its truth from a gold sensor past its due date; `today` is ISO 8601."""
    gold = recipe.reference.gold
    if recipe.reference.source == "gold" and gold is not None and gold.due < today[:10]:
        raise ReferenceOverdue("gold-overdue", serial=gold.serial, due=gold.due, today=today[:10])


def gold_errors(recipe: Recipe, true: Floats, seating: tuple[str, ...]) -> Floats:
    """Patterns (k, v, 3) of one-standard-deviation errors of the truth (v, 3) that a gold reference shares.

    Three for its offset, three for its gain, three for how its axes sit in the nest.
    """
    gold = gold_of(recipe)
    back = np.array([recipe.seating(s).T for s in seating])
    nest = np.einsum("vji,vj->vi", back, true)
    offset = gold.offset_std * back.transpose(2, 0, 1)
    gain = gold.gain_std * np.einsum("vik,vk->kvi", back, nest)
    turned = np.cross(np.eye(3)[:, None, :], nest[None])
    seat = np.deg2rad(gold.seat_std_deg) * np.einsum("vij,kvj->kvi", back, turned)
    return np.concatenate([offset, gain, seat])
