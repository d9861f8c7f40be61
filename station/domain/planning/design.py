"""What a recipe's positions determine, before anything moves: rank, refusal, condition, D-efficiency, next position."""

from collections.abc import Sequence

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods import method, rank
from station.domain.planning import optimal
from station.domain.recipe.plan import planned_visits as planned
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from station.messages import Message

#: So many positions are proposed at most to complete a recipe.
MAX_PROPOSALS = 12


def check(recipe: Recipe) -> None:
    """RecipeError when the recipe leaves a coefficient undetermined, naming it and the best position to add."""
    method.of(recipe).check(recipe)
    if recipe.pose_known and recipe.reference.source != "gold":
        rows, names = rows_of(recipe)
        lost = rank.undetermined(rows, names)
        if lost:
            raise RecipeError(_refusal(recipe, rows, lost))


def rows_of(recipe: Recipe) -> tuple[Floats, tuple[str, ...]]:
    """The linearised design (r, k) of all planned visits of all runs, and what its columns determine."""
    position, seating, true = planned_truths(recipe)
    nuisance = method.nuisance(recipe, position, seating, true)
    return method.of(recipe).design(true, recipe, nuisance)


def planned_truths(recipe: Recipe) -> tuple[tuple[str, ...], tuple[str, ...], Floats]:
    """Position, seating and truth (v, 3) of every planned visit of all runs."""
    visits = [s for run in range(len(recipe.runs)) for s in planned(recipe, run)]
    return tuple(s.position for s in visits), tuple(s.seating for s in visits), np.array([s.true for s in visits])


def _refusal(recipe: Recipe, rows: Floats, lost: Sequence[str]) -> Message:
    more = missing(recipe)
    remedy = Message("add-positions", count=len(more), positions=more) if more else Message("no-position-helps")
    return Message(
        "recipe-undetermined",
        recipe=recipe.name,
        method=recipe.method,
        positions=len(recipe.positions),
        coefficients=tuple(lost),
        rank=rank.of(rows),
        full=rows.shape[1],
        remedy=remedy,
    )


def missing(recipe: Recipe) -> tuple[str, ...]:
    """YAML of the positions that complete the recipe, best first; nothing when none helps."""
    _, _, true = planned_truths(recipe)
    out: list[str] = []
    for _ in range(MAX_PROPOSALS):
        rows, _ = method.of(recipe).design(true, recipe, np.zeros((len(true), 0)))
        if rank.of(rows) == rows.shape[1]:
            return tuple(out)
        best = optimal.next_best(true, recipe)
        out.append(optimal.as_yaml(f"extra-{len(out) + 1}", best, recipe))
        true = np.concatenate([true, best[None]])
    return ()


def next_position(recipe: Recipe) -> str:
    """YAML of the position that would add most, even to a complete recipe."""
    _, _, true = planned_truths(recipe)
    return optimal.as_yaml("extra-1", optimal.next_best(true, recipe), recipe)


def efficiency(recipe: Recipe) -> float:
    """D-efficiency: (det XᵀX over that of the best design of as many visits)^(1/k); 1 is best."""
    _, _, true = planned_truths(recipe)
    best = optimal.search(recipe, len(true))
    return float(min(np.exp(optimal.log_det(true, recipe) - optimal.log_det(best, recipe)), 1.0))
