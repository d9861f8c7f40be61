"""The cycle time of a recipe, predicted from the station's own log."""

from dataclasses import dataclass

import numpy as np

from station.config.recipes import recipe_hash
from station.domain.planning import cycle_time
from station.domain.planning.cycle_time import TimedAttempt, TimedVisit
from station.domain.recipe.recipe import Recipe
from station.model.timeline import visit_dwells_s
from station.ports.log_reader import Attempt, LogReader, Query

#: So many of the newest attempts are looked at.
NEWEST = 40


@dataclass(frozen=True, slots=True)
class CycleForecast:
    """Duration of a load, s. attempts: how many of the log it rests on; same: whether they used this very recipe."""

    cycle_s: float
    attempts: int
    same: bool


def forecast_cycle(recipe: Recipe, log: LogReader | None) -> CycleForecast:
    """By attempts with the same recipe, else at the pace of others that passed, else at that of an ordinary bench."""
    if log is not None:
        same = log.attempts(Query(recipe_hash=recipe_hash(recipe), outcome="PASS"), NEWEST)
        lasted = [(a.ended_ns - a.started_ns) / 1e9 for a in same if a.ended_ns is not None]
        if lasted:
            return CycleForecast(float(np.median(lasted)), len(lasted), same=True)
    others = [] if log is None else [_timed(log, a) for a in log.attempts(Query(outcome="PASS"), NEWEST)]
    known = [a for a in others if a is not None]
    pace = cycle_time.learn(known)
    return CycleForecast(cycle_time.predict_s(recipe, visit_dwells_s(recipe), pace), len(known), same=False)


def _timed(log: LogReader, attempt: Attempt) -> TimedAttempt | None:
    """What the log holds of an attempt's times; None where its recipe is not there or knows no poses."""
    text = log.recipe_and_product(attempt)[0]
    recipe = Recipe.model_validate_json(text) if text else None
    if recipe is None or not recipe.pose_known:
        return None
    stored = log.attempt(attempt)
    began = stored["started_ns"]
    visits = tuple(
        TimedVisit(
            v["run"],
            v["position"],
            (v["arrived_ns"] - began) / 1e9,
            (v["left_ns"] - began) / 1e9,
            v["kind"] == "verify",
        )
        for v in stored["visits"]
    )
    return TimedAttempt(recipe, visit_dwells_s(recipe), (stored["ended_ns"] - began) / 1e9, visits)
