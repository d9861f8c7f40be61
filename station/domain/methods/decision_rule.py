"""Limits, uncertainty and the decision rule → a verdict with every reason (JCGM 106:2012, ILAC-G8:09/2019)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Calibration, Floats, Outcome, Reason, ReducedVisits, Verdict
from station.domain.methods import coefficients, coverage, risk, visit_limits
from station.domain.methods.common_error import common_error
from station.domain.methods.decision import Decision, guard_band, rule_of
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.blocks import Limits, Process
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from station.messages import Message, Value

#: Lines of the budget that are each unit's own; the others are the station's, the same for every unit.
OF_THE_UNIT = ("noise", "quantisation", "method", "runs", "reproducibility")
#: Lines that are the same for all units that the station ever measured by the recipe.
OF_THE_PLACE = ("gravity", "field", "rate")
#: Of the variance of results at least this share is the process'.
MIN_PROCESS_SHARE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class JudgedUnit:
    """What a unit is judged by. quality: reasons why the data themselves are no evidence."""

    found: Calibration
    budget: Budget
    visits: ReducedVisits
    quality: Sequence[Reason] = ()


@dataclass(frozen=True, slots=True, eq=False)
class LimitedCoefficients:
    """Coefficients (c) that have a limit, of units (u): index (c) among the twelve; deviation from nominal,
    distribution of its error, limit and guard band w (u, c). Of what a unit does not estimate the limit is ∞."""

    index: NDArray[np.intp]
    deviation: Floats
    error: coverage.ErrorDistribution
    limit: Floats
    guard: Floats


def judge(recipe: Recipe, units: Sequence[JudgedUnit]) -> list[Verdict]:
    """A verdict each of units that went through the same visits: PASS when nothing speaks against a unit."""
    found, budgets = [unit.found for unit in units], [unit.budget for unit in units]
    t = limited_coefficients(recipe.limits, found, budgets)
    of_coefficients = _coefficients(recipe, t)
    of_visits = visit_limits.visit_reasons(recipe.limits, found, [unit.visits for unit in units])
    reasons = [
        (*unit.quality, *by_coefficient, *by_visit)
        for unit, by_coefficient, by_visit in zip(units, of_coefficients, of_visits, strict=True)
    ]
    known = measured(recipe.limits, t, budgets)
    outside = risk.beyond(known, t.limit)
    passed = np.array([not own for own in reasons])
    rejected = 1 - outside
    rejected[passed] = risk.beyond(known.of_units(passed), (t.limit - t.guard)[passed], again=True)
    rule = rule_of(recipe.limits)
    return [
        Verdict(
            outcome=Outcome.FAIL if own else Outcome.PASS,
            reasons=own,
            rule=rule,
            false_accept=0.0 if own else wrong,
            false_reject=again,
        )
        for own, wrong, again in zip(reasons, outside.tolist(), rejected.tolist(), strict=True)
    ]


def limited_coefficients(
    limits: Limits, found: Sequence[Calibration], budgets: Sequence[Budget]
) -> LimitedCoefficients:
    """What the limits apply to: estimated coefficients of a kind that has one."""
    kinds = {"offset": coefficients.OFFSETS, "gain": coefficients.GAINS, "cross_axis": coefficients.CROSS}
    limit = np.full(12, np.inf)
    for kind, which in kinds.items():
        value = getattr(limits, kind)
        if value is not None:
            limit[which] = value
    index = np.flatnonzero(np.isfinite(limit))
    estimated = np.array([np.diagonal(one.covariance) for one in found])[:, index] > 0
    theta = np.array([np.concatenate([one.offset, one.matrix.ravel()]) for one in found])
    error = errors(budgets).take(slice(None), index)
    deviation, limit = (theta - coefficients.NOMINAL)[:, index], np.where(estimated, limit[index], np.inf)
    return LimitedCoefficients(index, deviation, error, limit, guard_band(limits, error))


def errors(budgets: Sequence[Budget]) -> coverage.ErrorDistribution:
    """Distributions of the twelve coefficients' errors (u, 12)."""
    rest = (np.array([getattr(budget, name) for budget in budgets]) for name in ("dof", "rectangle", "shift"))
    return coverage.ErrorDistribution(_std(budgets), *rest)


def measured(limits: Limits, t: LimitedCoefficients, budgets: Sequence[Budget]) -> risk.Measured:
    """What the risks are computed from."""
    root = np.maximum(_std(budgets), 1e-300)
    total = np.array([budget.total for budget in budgets])
    correlation = (total / root[:, :, None] / root[:, None, :])[:, t.index[:, None], t.index]
    return risk.Measured(t.deviation, t.error, correlation, prior_of(limits, budgets).take(t.index))


def prior_of(limits: Limits, budgets: Sequence[Budget]) -> risk.Prior:
    """What is known of the twelve coefficients' deviations (u, 12) before a unit is measured."""
    process = limits.process or Process()
    mean, std = (np.tile(stated, (len(budgets), 1)) for stated in _stated(process))
    if not process.of_results:
        return risk.Prior.of_truths(mean, std)
    # The spread of results holds their random errors, and cannot show what they share.
    of_unit = np.array([_variance(budget, OF_THE_UNIT) for budget in budgets])
    true_std = np.sqrt(np.maximum(std**2 - of_unit, MIN_PROCESS_SHARE * std**2))
    shared = np.sqrt(np.maximum(_std(budgets) ** 2 - of_unit, 0.0))
    prior = risk.Prior(mean, true_std, shared, np.zeros_like(mean), shared)
    return prior if process.units is None else _with_error_of_place(prior, std / np.sqrt(process.units + 1), budgets)


def _with_error_of_place(prior: risk.Prior, mean_std: Floats, budgets: Sequence[Budget]) -> risk.Prior:
    """The prior with what its mean, known to mean_std (u, 12), says of the error that all results share."""
    of_place = np.array([_covariance(budget, OF_THE_PLACE) for budget in budgets])
    error, error_std = np.zeros_like(prior.mean), prior.shared.copy()
    for kind in (coefficients.OFFSETS, coefficients.GAINS, coefficients.CROSS):
        own = np.flatnonzero(kind & np.isfinite(prior.std[0]))
        at = of_place[:, own[:, None], own]
        if at.any():
            error[:, own], left = common_error(prior.mean[:, own], mean_std[:, own], prior.std[:, own], at)
            rest = prior.shared[:, own] ** 2 - np.einsum("uii->ui", at)
            error_std[:, own] = np.sqrt(np.maximum(rest, 0.0) + left**2)
    return replace(prior, error=error, error_std=error_std)


def _std(budgets: Sequence[Budget]) -> Floats:
    """Standard uncertainties (u, 12)."""
    return np.asarray(np.sqrt(np.maximum(np.array([np.diagonal(budget.total) for budget in budgets]), 0.0)))


def _variance(budget: Budget, causes: Sequence[str]) -> Floats:
    """Of the twelve coefficients, by some causes."""
    return np.asarray(np.diagonal(_covariance(budget, causes)))


def _covariance(budget: Budget, causes: Sequence[str]) -> Floats:
    """Of the twelve coefficients (12, 12), by some causes."""
    return sum((budget.parts[cause] for cause in causes if cause in budget.parts), np.zeros((12, 12)))


def _stated(process: Process) -> tuple[Floats, Floats]:
    """Mean and standard deviation (12) of the process; infinite where nothing is stated."""
    mean, std = np.zeros(12), np.full(12, np.inf)
    kinds = ((coefficients.OFFSETS, process.offset), (coefficients.GAINS, process.gain))
    for which, stated in (*kinds, (coefficients.CROSS, process.cross_axis)):
        if stated is not None:
            mean[which], std[which] = stated
    for i, own in enumerate(process.each or ()):
        if own is not None:
            mean[i], std[i] = own
    return mean, std


def decisions(recipe: Recipe, found: Calibration, budget: Budget, visits: ReducedVisits) -> tuple[Decision, ...]:
    """Every limit of one unit that was decided by value, uncertainty and the one rule."""
    t = limited_coefficients(recipe.limits, [found], [budget])
    known, wide = measured(recipe.limits, t, [budget]), t.error.expanded()
    each = tuple(
        Decision(
            what=coefficients.NAMES[int(t.index[c])],
            unit=coefficients.unit_of(int(t.index[c]), recipe.unit),
            value=float(t.deviation[0, c]),
            expanded=float(wide[0, c]),
            limit=float(t.limit[0, c]),
            guard=float(t.guard[0, c]),
            false_accept=float(risk.beyond(known.of_coefficient(c), t.limit[:, c : c + 1])[0]),
        )
        for c in np.flatnonzero(np.isfinite(t.limit[0])).tolist()
    )
    return (*each, *visit_limits.decided(recipe.limits, found, visits))


def _coefficients(recipe: Recipe, t: LimitedCoefficients) -> list[list[Reason]]:
    """The reasons of each unit."""
    beyond = np.isfinite(t.limit) & ((t.guard >= t.limit) | ~(np.abs(t.deviation) <= t.limit - t.guard))
    reasons: list[list[Reason]] = [[] for _ in beyond]
    for u, c in np.argwhere(beyond).tolist():
        reasons[u].append(_coefficient(recipe, t, u, c))
    return reasons


def _coefficient(recipe: Recipe, t: LimitedCoefficients, u: int, c: int) -> Reason:
    i, deviation, limit, guard = int(t.index[c]), float(t.deviation[u, c]), float(t.limit[u, c]), float(t.guard[u, c])
    unit = coefficients.unit_of(i, recipe.unit)
    check = "offset" if coefficients.OFFSETS[i] else "gain" if coefficients.GAINS[i] else "cross-axis"
    shown: dict[str, Value] = {
        "coefficient": coefficients.NAMES[i],
        "deviation": deviation,
        "limit": limit,
        "unit": _as_unit(unit),
    }
    if guard >= limit:
        wide = float(t.error.expanded()[u, c])
        return Reason(Message("coefficient-not-decidable", **shown, expanded=wide), deviation, limit, unit, check)
    if guard:
        message = Message("coefficient-beyond-guard", **shown, guard=guard)
        return Reason(message, deviation, limit - guard, unit, check)
    return Reason(Message("coefficient-beyond-limit", **shown), deviation, limit, unit, check)


def _as_unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def estimated(recipe: Recipe) -> tuple[str, ...]:
    """Which of `gain` and `cross_axis` the recipe's method finds beside the offset."""
    if recipe.method == "one-point":
        return ()
    return ("gain",) if recipe.method == "three-point" or recipe.model == "offset-gain" else ("gain", "cross_axis")


def refuse_unestimated(recipe: Recipe) -> None:
    """RecipeError where a limit is on what the recipe's method takes for granted, or what its visits cannot show; and
    where the recipe wants a model that its method does not follow."""
    if recipe.model == "offset-gain" and recipe.method in ("six-point", "norm"):
        raise RecipeError("model-not-of-method", recipe=recipe.name, method=recipe.method)
    for kind in ("gain", "cross_axis"):
        if getattr(recipe.limits, kind) is not None and kind not in estimated(recipe):
            raise RecipeError(
                "limit-not-estimated", recipe=recipe.name, limit=kind, method=recipe.method, model=recipe.model
            )
    for kind in _not_shown(recipe):
        if getattr(recipe.limits, kind) is not None:
            raise RecipeError("limit-not-shown", recipe=recipe.name, limit=kind, method=recipe.method)


def _not_shown(recipe: Recipe) -> tuple[str, ...]:
    """Limits that any unit keeps: no reading is left over to speak against the fit, or nobody knows the poses."""
    by_hand = () if recipe.pose_known else ("tilt_deg", "consistency")
    unknowns = {"one-point": 3, "three-point": 6}.get(recipe.method, 6 if recipe.model == "offset-gain" else 12)
    visits = len(recipe.positions) * len(recipe.runs)
    if recipe.method == "norm" or not visits or 3 * visits > unknowns:
        return by_hand
    return "residual", "tilt_deg", *(("consistency",) if visits == 1 else by_hand)
