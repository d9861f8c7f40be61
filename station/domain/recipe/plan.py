"""The plan of visits: which position comes when, in which run, and where it came from."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels
from station.domain.recipe import moves
from station.domain.recipe.blocks import Run
from station.domain.recipe.position import Position
from station.domain.recipe.recipe import Recipe

#: Visits of a run whose recipe lists no positions, because a person holds the part in any pose.
HAND_HELD_VISITS = 24


@dataclass(frozen=True, slots=True, eq=False)
class PlannedVisit:
    """One planned visit. nest: nest → station rotation; seat: device → nest rotation; previous: name or None."""

    run: int
    visit: int
    position: str
    seating: str
    nest: Floats
    seat: Floats
    true: Floats
    previous: str | None


def order_of(recipe: Recipe, run: int) -> tuple[Position, ...]:
    """Positions in the order of this run; `shuffled` and `fastest` are the same for every unit and every day."""
    how = recipe.runs[run].order
    listed = recipe.positions
    if how == "reversed":
        return listed[::-1]
    if how == "fastest" and len(listed) > 1:
        return moves.fastest(recipe, recipe.runs[run], *ends(recipe, run))
    if how == "shuffled":
        key = hashlib.sha256(f"{recipe.name}/{recipe.version}/{run}".encode()).digest()
        order = np.random.default_rng(int.from_bytes(key[:8], "big")).permutation(len(listed))
        return tuple(listed[i] for i in order)
    return listed


def ends(recipe: Recipe, run: int) -> tuple[Floats, Floats | None]:
    """Nest → station rotations from which a run starts and to which it goes: from where the run before ended or units
    are loaded, to the verification or the parking place after the last run. None where the next run settles it."""
    start = order_of(recipe, run - 1)[-1].matrix() if run else np.eye(3)
    if run < len(recipe.runs) - 1:
        return start, None
    return start, recipe.verify.positions[0].matrix() if recipe.verify.positions else np.eye(3)


def names(recipe: Recipe, run: int) -> tuple[str, ...]:
    """Names of the visits of one run in order; of a hand-held run without positions, so many numbered ones."""
    return tuple(p.name for p in order_of(recipe, run)) or tuple(f"hand-{i + 1}" for i in range(HAND_HELD_VISITS))


def visit_index(recipe: Recipe, run: int, visit: int) -> int:
    """Place of a visit of one run among the visits of all runs."""
    return sum(len(names(recipe, before)) for before in range(run)) + visit


def planned_visits(recipe: Recipe, run: int) -> tuple[PlannedVisit, ...]:
    """The visits of one run in order. The first visit of a run has no previous position."""
    seating = recipe.runs[run].seating
    return _visits_in_order(recipe, run, order_of(recipe, run), seating, 0)


def verification_visits(recipe: Recipe, run: int, first_visit: int) -> tuple[PlannedVisit, ...]:
    """The visits measured again after the write, in the seating of that run."""
    return _visits_in_order(recipe, run, recipe.verify.positions, recipe.runs[run].seating, first_visit)


def _visits_in_order(
    recipe: Recipe, run: int, order: tuple[Position, ...], seating: str, first: int
) -> tuple[PlannedVisit, ...]:
    seat = recipe.seating(seating)
    return tuple(
        PlannedVisit(
            run=run,
            visit=first + i,
            position=p.name,
            seating=seating,
            nest=p.matrix(),
            seat=seat,
            true=recipe.true_vector(p, seating),
            previous=order[i - 1].name if i else None,
        )
        for i, p in enumerate(order)
    )


def run_of_pass(recipe: Recipe, run: int) -> Run:
    """Which of the recipe's `runs` a pass is: repeated passes go round again."""
    return recipe.runs[run % len(recipe.runs)]


def seating_of_passes(recipe: Recipe, run: NDArray[np.int32]) -> Labels:
    """The seating of visits (v) in passes (v): that of the recipe's run, where nothing says how the unit sat."""
    names = tuple(dict.fromkeys(r.seating for r in recipe.runs))
    code = np.array([names.index(r.seating) for r in recipe.runs], np.int32)
    return Labels(names, code[run % len(recipe.runs)]).used()
