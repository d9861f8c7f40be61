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
#: Units of one load begin within so many seconds.
LOAD_S = 5.0


@dataclass(frozen=True, slots=True)
class CycleForecast:
    """Duration of a load, s, of all its units and of one. attempts: how many of the log it rests on; same: whether they
    used this very recipe."""

    cycle_s: float
    one_s: float
    attempts: int
    same: bool


def forecast_cycle(recipe: Recipe, log: LogReader | None, units: int) -> CycleForecast:
    """By attempts with the same recipe, else at the pace of others that passed, else at that of an ordinary bench.
    units: of a load."""
    dwell_s = visit_dwells_s(recipe)
    same = [] if log is None else log.attempts(Query(recipe_hash=recipe_hash(recipe), outcome="PASS"), NEWEST)
    newest = [] if log is None else same or log.attempts(Query(outcome="PASS"), NEWEST)
    known = [] if log is None else [t for a in newest if (t := _timed(log, a)) is not None]
    if same and not known:  # a recipe without poses has no moves to foretell
        lasted_s = float(np.median([(a.ended_ns - a.started_ns) / 1e9 for a in same if a.ended_ns is not None]))
        return CycleForecast(lasted_s, lasted_s, len(same), same=True)
    pace = cycle_time.learn(known)

    def lasts_s(count: int) -> float:
        """By the recipe's own attempts, what other units of the load add or leave out set right."""
        planned_s = cycle_time.predict_s(recipe, dwell_s, pace, count)
        own = [t.duration_s - cycle_time.predict_s(recipe, dwell_s, pace, t.units) for t in known] if same else []
        return planned_s + (float(np.median(own)) if own else 0.0)

    return CycleForecast(lasts_s(units), lasts_s(1), len(known), same=bool(same))


def _load_size(log: LogReader, attempt: Attempt) -> int:
    """How many units went on the fixture together with this one, itself included."""
    reach = int(LOAD_S * 1e9)
    near = Query(station=attempt.station, recipe_hash=attempt.recipe_hash, since_ns=attempt.started_ns - reach,
                 until_ns=attempt.started_ns + reach)  # fmt: skip
    return len({a.serial for a in log.attempts(near)})


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
    duration_s = (stored["ended_ns"] - began) / 1e9
    return TimedAttempt(recipe, visit_dwells_s(recipe), duration_s, visits, max(1, _load_size(log, attempt)))
