"""What a calibration can take in of a simulation that has learnt, and the recipe that then does.

A device keeps an offset and a matrix. A cause of its own that changes its readings by nothing else than these two
could undo, whatever the pose, belongs into them: the recipe then fits the whole matrix in place of gains alone.
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods import coefficients, method
from station.domain.planning import design
from station.domain.planning.forecast import forecast
from station.domain.recipe.blocks import Run
from station.domain.recipe.position import Position
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from station.model.campaign import campaign_of
from station.model.effect import Effect
from station.model.forward import BaseResponse, resting_stimulus, signature
from station.model.model_file import Model
from station.model.scene import Scene
from station.model.simulated_line import SimulatedLine
from station.model.timeline import FleetPart

#: Share of a signature that rounding may leave outside offset and matrix.
ROUNDING_SHARE = 1e-9
#: Poses that it is tried on.
PROBE_POSES = 16


@dataclass(frozen=True, slots=True, eq=False)
class CompensatedRecipe:
    """recipe: as it is to be run; causes: ids that its calibration holds; uncompensated: why each other cause stays."""

    recipe: Recipe
    causes: tuple[str, ...]
    uncompensated: tuple[str, ...]


def compensate(recipe: Recipe, model: Model, *, gains_only: bool) -> CompensatedRecipe:
    """The recipe with every cause of the model in its calibration that belongs there.

    gains_only: the product keeps no cross-axis terms. Errors: RecipeError where the matrix is needed, but the
    recipe's positions do not determine it, with the positions to add.
    """
    whole = recipe.model_copy(update={"model": "matrix"})
    effects = {listed.effect: listed.build() for listed in model.effects}
    why = {name: _reason_against(effect, whole, gains_only=gains_only) for name, effect in effects.items()}
    causes = tuple(name for name, reason in why.items() if not reason)
    if causes:
        _check(whole, causes)
    uncompensated = tuple(f"{name} {reason}" for name, reason in why.items() if reason)
    return CompensatedRecipe(whole if causes else recipe, causes, uncompensated)


def _reason_against(effect: Effect, whole: Recipe, *, gains_only: bool) -> str:
    """Why the calibration cannot hold a cause; empty where it can."""
    if effect.level != "device":
        return f"is of the {effect.level} and not of the device, so no calibration takes it in; have it put right"
    if not in_matrix(effect, whole):
        return "is no part of offset and matrix, which is all that the device keeps; it stays in the device's output"
    if gains_only:
        return "needs the matrix, but this product keeps offsets and gains only; it stays in the device's output"
    if not _fits_matrix(whole):
        return f"needs the matrix, which method {whole.method} does not determine; use method: n-point"
    return ""


def in_matrix(effect: Effect, recipe: Recipe) -> bool:
    """Whether an offset and a matrix hold all that a cause does to the readings, in whatever pose and run."""
    if effect.of[0] != "unit":
        return False
    scene = _random_scene(recipe)
    felt = resting_stimulus(scene)[scene.visit]
    columns = np.concatenate([np.tile(np.eye(3), (len(felt), 1)), np.kron(felt, np.eye(3))], axis=1)
    done = np.stack(signature(scene, BaseResponse.ideal(1), effect), axis=-1).reshape(len(columns), -1)
    total = float(np.sum(done**2))
    return total > 0 and float(np.sum(_outside(columns, done) ** 2)) < ROUNDING_SHARE * total


def _outside(columns: Floats, done: Floats) -> Floats:
    return np.asarray(done - columns @ np.linalg.lstsq(columns, done, rcond=None)[0])


def _random_scene(recipe: Recipe) -> Scene:
    """One unit through poses (and rates) at random."""
    draws = np.random.default_rng(0).standard_normal((PROBE_POSES, 7))
    size = recipe.reference.strength()
    positions = tuple(
        Position(
            name=f"p{i}",
            quaternion=tuple(row[:4] / np.linalg.norm(row[:4])),
            rate=tuple(size * row[4:]) if recipe.reference.source == "rate" else None,
        )
        for i, row in enumerate(draws)
    )
    reference = recipe.reference.model_copy(update={"pose": "known"})
    changes = {"positions": positions, "runs": (Run(),), "seatings": {}, "reference": reference}
    probing = recipe.model_copy(update=changes)
    return campaign_of(probing, FleetPart(("any",)), 1, SimulatedLine()).dwells(np.array([recipe.device.rate_hz]))


def _fits_matrix(whole: Recipe) -> bool:
    """Whether the recipe's method estimates cross-axis terms at all: with given positions, or with enough of any."""
    if method.of(whole).open_ended:
        return True
    return bool(np.diagonal(forecast(whole, np.zeros(12)).budget.total)[coefficients.CROSS].any())


def _check(whole: Recipe, causes: tuple[str, ...]) -> None:
    try:
        design.check(whole)
    except RecipeError as exc:
        raise RecipeError("compensation-not-possible", causes=causes, reason=exc.message) from None
