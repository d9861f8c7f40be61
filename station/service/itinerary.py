"""Every visit of a fixture load in order, and how long they should take."""

from itertools import pairwise

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.planning import adaptive_dwell
from station.domain.recipe import plan
from station.domain.recipe.plan import HAND_HELD_VISITS, PlannedVisit
from station.domain.recipe.recipe import Recipe
from station.ports.positioner import Positioner


def tumble_visits(recipe: Recipe, run: int) -> tuple[PlannedVisit, ...]:
    """The visits of one run; of a hand-held run, so many nameless ones, spread evenly where a drive turns it."""
    if recipe.pose_known or recipe.positions:
        return plan.planned_visits(recipe, run)
    unknown = np.full(3, np.nan)
    names = plan.names(recipe, run)
    up = np.array([0.0, 0.0, 1.0])
    return tuple(
        PlannedVisit(
            run,
            i,
            name,
            "home",
            rotation.shortest(_spread_direction(i), up),
            np.eye(3),
            unknown,
            names[i - 1] if i else None,
        )
        for i, name in enumerate(names)
    )


def _spread_direction(number: int) -> Floats:
    """One of STOPS_BY_HAND directions (3) spread evenly over the sphere: the golden spiral."""
    z = 1 - (2 * number + 1) / HAND_HELD_VISITS
    angle = number * np.pi * (3 - np.sqrt(5))
    return np.array([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z])


def verification_visits(recipe: Recipe) -> tuple[PlannedVisit, ...]:
    """The visits measured again after the write, in the seating in which the unit sits then."""
    last = len(recipe.runs) - 1
    return plan.verification_visits(recipe, last, len(tumble_visits(recipe, last)))


def check_reach(recipe: Recipe, positioner: Positioner) -> None:
    """Whether every position of the recipe can be reached, and from the one before, before anything moves.

    Errors: PositionerFault of the first that cannot.
    """
    if positioner.by_hand:
        return
    visits = [visit for run in range(len(recipe.runs)) for visit in tumble_visits(recipe, run)]
    for origin, visit in pairwise([None, *visits, *verification_visits(recipe)]):
        if visit is not None:
            positioner.estimate_s(origin, visit)


def estimate_s(recipe: Recipe, positioner: Positioner) -> float:
    """Expected time of a load from its first move to parking, s; SDO traffic is not in it."""
    runs = [tumble_visits(recipe, run) for run in range(len(recipe.runs))]
    visits = [*(visit for run in runs for visit in run), *verification_visits(recipe)]
    moves = sum(positioner.estimate_s(a, b) for a, b in pairwise([None, *visits]) if b is not None)
    dwell_s = adaptive_dwell.dwells_by_sheet_s(recipe)
    verified = len(visits) - len(dwell_s)
    stay = len(visits) * recipe.settle.time_s + dwell_s.sum() + verified * dwell_s.mean()
    return float(moves + stay + sum(run.prewarm_s for run in recipe.runs))
