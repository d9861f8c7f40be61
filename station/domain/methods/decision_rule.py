"""Limits, uncertainty and the decision rule → a verdict with every reason (JCGM 106:2012, ILAC-G8:09/2019)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Calibration, Floats, Outcome, Reason, ReducedVisits, Verdict
from station.domain.methods import coefficients, coverage, risk, visit_limits
from station.domain.methods.decision import Decision, guard_band, rule_of
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.blocks import Limits, Process
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from station.messages import Message, Value

#: Lines of the budget that are each unit's own; the others are the station's, the same for every unit.
OF_THE_UNIT = ("noise", "quantisation", "method", "runs", "reproducibility")
#: Of the variance of results at least this share is the process'.
MIN_PROCESS_SHARE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class LimitedCoefficients:
    """Coefficients that have a limit (c): index among the twelve, deviation from nominal, standard uncertainty,
    degrees of freedom, limit, guard band w."""

    index: NDArray[np.intp]
    deviation: Floats
    std: Floats
    dof: Floats
    limit: Floats
    guard: Floats


def judge(
    recipe: Recipe, found: Calibration, budget: Budget, visits: ReducedVisits, quality: Sequence[Reason]
) -> Verdict:
    """PASS when nothing speaks against it. quality: reasons why the data themselves are no evidence."""
    t = limited_coefficients(recipe.limits, found, budget)
    reasons = (*quality, *_coefficients(recipe, t), *visit_limits.visit_reasons(recipe.limits, found, visits))
    known = measured(recipe.limits, t, budget)
    outside = risk.beyond(known, t.limit)
    passed = not reasons
    return Verdict(
        outcome=Outcome.PASS if passed else Outcome.FAIL,
        reasons=reasons,
        rule=rule_of(recipe.limits),
        false_accept=outside if passed else 0.0,
        false_reject=risk.beyond(known, t.limit - t.guard, again=True) if passed else 1 - outside,
    )


def limited_coefficients(limits: Limits, found: Calibration, budget: Budget) -> LimitedCoefficients:
    """What the limits apply to: estimated coefficients of a kind that has one."""
    kinds = {"offset": coefficients.OFFSETS, "gain": coefficients.GAINS, "cross_axis": coefficients.CROSS}
    limit = np.full(12, np.nan)
    for kind, which in kinds.items():
        value = getattr(limits, kind)
        if value is not None:
            limit[which] = value
    estimated = np.diagonal(found.covariance) > 0
    index = np.flatnonzero(np.isfinite(limit) & estimated)
    theta = np.concatenate([found.offset, found.matrix.ravel()])
    std, dof = budget.std()[index], budget.dof[index]
    return LimitedCoefficients(
        index, (theta - coefficients.NOMINAL)[index], std, dof, limit[index], guard_band(limits, std, dof)
    )


def measured(limits: Limits, t: LimitedCoefficients, budget: Budget) -> risk.Measured:
    """What the risks are computed from."""
    root = np.maximum(budget.std(), 1e-300)
    correlation = (budget.total / root[:, None] / root)[np.ix_(t.index, t.index)]
    return risk.Measured(t.deviation, t.std, t.dof, correlation, prior_of(limits, budget).take(t.index))


def prior_of(limits: Limits, budget: Budget) -> risk.Prior:
    """What is known of the twelve coefficients' deviations before a unit is measured."""
    process = limits.process or Process()
    mean, std = _stated(process)
    shared = np.zeros(12)
    if process.of_results:  # the spread of results holds their random errors, and cannot show what they share
        of_unit = sum((budget.std(cause) ** 2 for cause in OF_THE_UNIT if cause in budget.parts), np.zeros(12))
        std = np.sqrt(np.maximum(std**2 - of_unit, MIN_PROCESS_SHARE * std**2))
        shared = np.sqrt(np.maximum(budget.std() ** 2 - of_unit, 0.0))
    return risk.Prior(mean, std, shared)


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
    """Every limit that was decided by value, uncertainty and the one rule."""
    t = limited_coefficients(recipe.limits, found, budget)
    known, wide = measured(recipe.limits, t, budget), coverage.factor(t.dof) * t.std
    each = tuple(
        Decision(
            what=coefficients.NAMES[int(i)],
            unit=coefficients.unit_of(int(i), recipe.unit),
            value=float(t.deviation[c]),
            expanded=float(wide[c]),
            limit=float(t.limit[c]),
            guard=float(t.guard[c]),
            false_accept=risk.beyond(known.take(c), t.limit[c : c + 1]),
        )
        for c, i in enumerate(t.index)
    )
    return (*each, *(one.decision for one in visit_limits.decided(recipe.limits, found, visits)))


def _coefficients(recipe: Recipe, t: LimitedCoefficients) -> Iterator[Reason]:
    beyond = (t.guard >= t.limit) | ~(np.abs(t.deviation) <= t.limit - t.guard)
    for c in np.flatnonzero(beyond):
        i, deviation, limit, guard = int(t.index[c]), float(t.deviation[c]), float(t.limit[c]), float(t.guard[c])
        unit = coefficients.unit_of(i, recipe.unit)
        check = "offset" if coefficients.OFFSETS[i] else "gain" if coefficients.GAINS[i] else "cross-axis"
        shown: dict[str, Value] = {
            "coefficient": coefficients.NAMES[i],
            "deviation": deviation,
            "limit": limit,
            "unit": _as_unit(unit),
        }
        if guard >= limit:
            wide = float(coverage.factor(t.dof[c]) * t.std[c])
            message = Message("coefficient-not-decidable", **shown, expanded=wide)
            yield Reason(message, deviation, limit, unit, check)
        elif guard:
            message = Message("coefficient-beyond-guard", **shown, guard=guard)
            yield Reason(message, deviation, limit - guard, unit, check)
        else:
            yield Reason(Message("coefficient-beyond-limit", **shown), deviation, limit, unit, check)


def _as_unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def refuse_unestimated(recipe: Recipe) -> None:
    """RecipeError where a limit is on what the recipe's method takes for granted, or what its visits cannot show."""
    estimates = {"one-point": (), "three-point": ("gain",)}.get(recipe.method, ("gain", "cross_axis"))
    if recipe.model == "offset-gain":
        estimates = ("gain",)
    for kind in ("gain", "cross_axis"):
        if getattr(recipe.limits, kind) is not None and kind not in estimates:
            raise RecipeError("limit-not-estimated", recipe=recipe.name, limit=kind, method=recipe.method)
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
