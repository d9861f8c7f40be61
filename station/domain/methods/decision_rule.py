"""Limits, uncertainty and the decision rule → a verdict with every reason (JCGM 106:2012, ILAC-G8:09/2019)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Calibration, Floats, Outcome, Reason, ReducedVisits, Verdict
from station.domain.methods import coefficients, coverage, risk
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.blocks import Limits, Process
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from station.messages import Message, Value

#: Lines of the budget that are each unit's own; the others are the station's, the same for every unit.
OF_THE_UNIT = ("noise", "quantisation", "method", "runs", "reproducibility")
#: Of the variance of results at least this share is the process'.
MIN_PROCESS_SHARE = 0.01
#: An axis is across the stimulus when it feels less than this share of it.
ACROSS = 0.05


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
    reasons = (*quality, *_coefficients(recipe, t), *_gate_reasons(recipe, found, visits))
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


def rule_of(limits: Limits) -> Message:
    """The decision rule in words."""
    if limits.rule == "guard-band":
        return Message("rule-guard-band")
    if limits.rule == "false-accept":
        return Message("rule-false-accept", probability=limits.false_accept)
    return Message("rule-simple")


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


def guard_band(limits: Limits, std: Floats, dof: Floats) -> Floats:
    """w of the decision rule: 0; U = k·u; or the one-sided t quantile that keeps a false accept at the limit rare."""
    if limits.rule == "guard-band":
        return coverage.factor(dof) * std
    if limits.rule == "false-accept" and limits.false_accept is not None:
        return coverage.quantile(dof, 1 - limits.false_accept) * std
    return np.zeros_like(std)


def measured(limits: Limits, t: LimitedCoefficients, budget: Budget) -> risk.Measured:
    """What the risks are computed from."""
    process = limits.process or Process()
    mean, std = _prior(process)
    shared = np.zeros(12)
    if process.of_results:  # the spread of results holds their random errors, and cannot show what they share
        of_unit = sum((budget.std(cause) ** 2 for cause in OF_THE_UNIT if cause in budget.parts), np.zeros(12))
        std = np.sqrt(np.maximum(std**2 - of_unit, MIN_PROCESS_SHARE * std**2))
        shared = np.sqrt(np.maximum(budget.std() ** 2 - of_unit, 0.0))
    root = np.maximum(budget.std(), 1e-300)
    correlation = (budget.total / root[:, None] / root)[np.ix_(t.index, t.index)]
    prior = risk.Prior(mean[t.index], std[t.index], shared[t.index])
    return risk.Measured(t.deviation, t.std, t.dof, correlation, prior)


def _prior(process: Process) -> tuple[Floats, Floats]:
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


@dataclass(frozen=True, slots=True)
class Decision:
    """One limit as it was decided: what, in which unit, value and U, limit, guard band, and the room that is left.

    false_accept: specific risk of this one limit, None where the limit speaks of the rig and not of a true value.
    """

    what: str
    unit: str
    value: float
    expanded: float | None
    limit: float
    guard: float
    false_accept: float | None

    @property
    def margin(self) -> float:
        """Room to the acceptance limit; negative where it is exceeded."""
        return self.limit - self.guard - abs(self.value)


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
    return (*each, *(_rig_decision(g) for g in _gates(recipe.limits, found, visits)))


@dataclass(frozen=True, slots=True)
class _Gate:
    """A limit on how well the visits agree, at its worst visit: the message's id and check, value, U, guard band."""

    check: str
    position: str
    value: float
    std: float
    guard: float
    limit: float
    unit: str


def _rig_decision(gate: _Gate) -> Decision:
    wide = float(coverage.NORMAL * gate.std)
    return Decision(gate.check, gate.unit, gate.value, wide or None, gate.limit, gate.guard, None)


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


def _gate_reasons(recipe: Recipe, found: Calibration, visits: ReducedVisits) -> Iterator[Reason]:
    """Limits on how well the visits agree, which speak of the rig and the readings as much as of the unit."""
    limits = recipe.limits
    for gate in _gates(limits, found, visits):
        if not abs(gate.value) <= gate.limit - gate.guard:
            shown: dict[str, Value] = {
                "position": gate.position,
                "value": gate.value,
                "limit": gate.limit,
                "unit": gate.unit,
            }
            yield Reason(
                Message(f"{gate.check}-beyond-limit", **shown, guard=gate.guard),
                gate.value, gate.limit - gate.guard, gate.unit, gate.check,
            )  # fmt: skip
    if found.disturbed.all():
        return
    if limits.consistency is not None and (spread := consistency(visits, found.disturbed)) > limits.consistency:
        message = Message("consistency-beyond-limit", value=spread, limit=limits.consistency, unit=recipe.unit)
        yield Reason(message, spread, limits.consistency, recipe.unit, "consistency")
    if limits.temperature_degC is not None:
        yield from _temperature(limits.temperature_degC, visits)


def _gates(limits: Limits, found: Calibration, visits: ReducedVisits) -> Iterator[_Gate]:
    """Residual, tilt and noise at their worst visit, against their limits."""
    undisturbed = ~found.disturbed
    if not undisturbed.any():
        return
    of_mean = np.sqrt(np.einsum("vii->vi", visits.cov))
    residual = np.abs(found.residual)
    at = residual.argmax(axis=1)[:, None]
    nothing = np.zeros(len(undisturbed))
    for check, limit, size, std, unit in (
        ("residual", limits.residual, residual.max(axis=1), np.take_along_axis(of_mean, at, 1)[:, 0], found.unit),
        ("tilt", limits.tilt_deg, found.tilt_deg, found.tilt_std_deg, "deg"),
        ("noise", limits.noise, visits.std.max(axis=1), nothing, found.unit),
    ):
        if limit is not None:
            guard = guard_band(limits, std, np.full(len(std), coverage.MANY))
            worst = int(np.argmax(np.where(undisturbed, size + guard, -np.inf)))
            values = float(size[worst]), float(std[worst]), float(guard[worst])
            yield _Gate(check, found.positions[worst], *values, limit, unit)


def _temperature(limits: tuple[float, float], visits: ReducedVisits) -> Iterator[Reason]:
    low, high = limits
    known = np.isfinite(visits.temperature_degC)
    outside = known & ((visits.temperature_degC < low) | (visits.temperature_degC > high))
    for v in np.flatnonzero(outside)[:1]:
        T = float(visits.temperature_degC[v])
        message = Message("temperature-outside", value=T, position=visits.position[v], low=low, high=high)
        yield Reason(message, T, high if high < T else low, "degC", "temperature")


def refuse_unestimated(recipe: Recipe) -> None:
    """RecipeError where a limit is on a coefficient that the recipe's method takes for granted."""
    estimates = {"one-point": (), "three-point": ("gain",)}.get(recipe.method, ("gain", "cross_axis"))
    if recipe.model == "offset-gain":
        estimates = ("gain",)
    for kind in ("gain", "cross_axis"):
        if getattr(recipe.limits, kind) is not None and kind not in estimates:
            raise RecipeError("limit-not-estimated", recipe=recipe.name, limit=kind, method=recipe.method)


def consistency(visits: ReducedVisits, disturbed: NDArray[np.bool_]) -> float:
    """Largest difference between readings of an axis across the stimulus, in the recipe's unit.

    In DT0105's table these are its three spare equations, x₂ − x₃, y₁ − y₃ and z₁ − z₂: zero but for cross-axis
    gains and pose errors. 0 where no axis is across the stimulus twice.
    """
    size = np.linalg.norm(visits.true, axis=1, keepdims=True)
    across = (np.abs(visits.true) < ACROSS * size) & ~disturbed[:, None]
    spread = [np.ptp(visits.mean[across[:, i], i]) for i in range(3) if across[:, i].sum() > 1]
    return float(max(spread, default=0.0))
