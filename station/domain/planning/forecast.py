"""What a recipe will know of every coefficient, before anything moves: the calibration of an ideal unit.

The forecast is no formula of its own. It is the recipe's method, budget and limits applied to the visits of a perfect
sensor with the data sheet's noise.
"""

from dataclasses import dataclass

import numpy as np

from station.domain.capture.rest_detection import expected_noise
from station.domain.core.types import Floats
from station.domain.methods import coefficients, method, uncertainty
from station.domain.methods.decision import decide_limit, guard_band
from station.domain.methods.decision_rule import prior_of
from station.domain.methods.risk import Prior, global_risks
from station.domain.methods.uncertainty import Budget
from station.domain.planning import adaptive_dwell, nominal_visits
from station.domain.recipe import references
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: From this ratio of limit to expanded uncertainty on, the uncertainty hardly matters (ILAC-G8, 4:1).
COMFORTABLE = 4.0


@dataclass(frozen=True, slots=True)
class LimitForecast:
    """Whether a limit can be decided: limit and expanded uncertainty U of its least certain coefficient; guard: the
    guard band there; verdict: comfortable | tight | impossible; risks: global consumer's and producer's, over the
    process that the recipe states or the log taught; None where nothing is known of it."""

    kind: str
    coefficient: str
    limit: float
    expanded: float
    guard: float
    verdict: str
    risks: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Budget of a perfect unit, and what each limit can decide; noise: of one sample, in the recipe's unit;
    dwell_s (v): of every planned visit; missed: what falls short of the recipe's until_std, or None."""

    budget: Budget
    decisions: tuple[LimitForecast, ...]
    noise: float
    dwell_s: Floats
    missed: Message | None


def forecast(recipe: Recipe, rounding: Floats) -> Forecast:
    """The forecast of a recipe that `design.check` accepts and that lists its positions."""
    noise = expected_noise(recipe)
    dwell_s = adaptive_dwell.dwells_by_sheet_s(recipe)
    visits = nominal_visits.nominal_visits(recipe, dwell_s)
    problem = method.fit_problem(recipe, [visits])
    fit = method.of(recipe).fit(problem)
    budget = uncertainty.budgets(recipe, problem, fit, visits, rounding)[0]
    wanted = adaptive_dwell.target_std(recipe, fit.free, float(problem.magnitude.max()))
    missed = adaptive_dwell.shortfall(recipe, wanted, budget.covering_std("noise"))
    decisions = (*_decisions(recipe, budget), *_verification(recipe, noise))
    return Forecast(budget, decisions, noise, dwell_s, missed)


def _decisions(recipe: Recipe, budget: Budget) -> tuple[LimitForecast, ...]:
    limits, std = recipe.limits, budget.std()
    guard, prior = guard_band(limits, budget.error()), prior_of(limits, [budget])
    kinds = {"offset": coefficients.OFFSETS, "gain": coefficients.GAINS, "cross_axis": coefficients.CROSS}
    out = []
    for kind, which in kinds.items():
        limit = getattr(limits, kind)
        if limit is None:
            continue
        worst = int(np.argmax(np.where(which, std, -1.0)))
        expanded = float(budget.expanded()[worst])
        prospect = _prospect(limit, expanded, float(guard[worst]))
        risks = _risks(prior.take(np.array([worst])), float(std[worst]), limit, float(guard[worst]))
        name, wide = coefficients.NAMES[worst], float(guard[worst])
        out.append(LimitForecast(kind, name, limit, expanded, wide, prospect, risks))
    return tuple(out)


def _risks(prior: Prior, std: float, limit: float, guard: float) -> tuple[float, float] | None:
    """Global risks of one coefficient; None where nothing is known of its process."""
    mean, spread, shared, error, error_std = (
        float(part[0, 0]) for part in (prior.mean, prior.std, prior.shared, prior.error, prior.error_std)
    )
    if not np.isfinite(spread):
        return None
    left = float(np.sqrt(max(std**2 - shared**2, 0.0) + error_std**2))
    return global_risks((mean - error, spread), left, limit, guard, error)


def _verification(recipe: Recipe, noise: float) -> tuple[LimitForecast, ...]:
    """Of verify.limit at the position whose error is least certain."""
    limit = recipe.verify.limit
    if limit is None or not recipe.verify.positions:
        return ()
    pose = np.deg2rad(recipe.reference.pose_std_deg or 0.0)
    of_dwell = noise**2 / max(recipe.dwell.longest_s * recipe.device.rate_hz, 1.0)
    found, seating = [], recipe.runs[-1].seating
    for position in recipe.verify.positions:
        true = recipe.true_vector(position, seating)
        of_pose = pose**2 * (true @ true * np.eye(3) - np.outer(true, true))
        shared = references.stimulus_covariance(recipe, position.name, seating, true)
        found.append(float(np.linalg.eigvalsh(shared + of_pose)[-1] + of_dwell))
    worst = int(np.argmax(found))
    name = recipe.verify.positions[worst].name
    decision = decide_limit(recipe.limits, (name, recipe.unit), 0.0, found[worst] ** 0.5, limit)
    expanded = decision.expanded or 0.0
    prospect = _prospect(limit, expanded, decision.guard)
    return (LimitForecast("verification", name, limit, expanded, decision.guard, prospect),)


def _prospect(limit: float, expanded: float, guard: float) -> str:
    if max(expanded, guard) >= limit:
        return "impossible"
    return "comfortable" if COMFORTABLE * expanded <= limit else "tight"
