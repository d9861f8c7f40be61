"""Limits, uncertainty and the decision rule → a verdict with every reason (JCGM 106:2012, ILAC-G8:09/2019)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core.types import Calibration, Floats, Outcome, Reason, ReducedVisits, Verdict
from station.domain.methods import coefficients, coverage
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.recipe import Limits, Recipe
from station.messages import Message

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
    recipe: Recipe, found: Calibration, budget: Budget, stops: ReducedVisits, quality: Sequence[Reason]
) -> Verdict:
    """PASS when nothing speaks against it. quality: reasons why the data themselves are no evidence."""
    t = limited_coefficients(recipe.limits, found, budget)
    reasons = (*quality, *_coefficients(recipe, t), *_gates(recipe, found, stops))
    conform = conformance(t)
    passed = not reasons
    return Verdict(
        outcome=Outcome.PASS if passed else Outcome.FAIL,
        reasons=reasons,
        rule=rule_of(recipe.limits),
        false_accept=float(1 - conform) if passed else 0.0,
        false_reject=float(1 - acceptance(t)) if passed else float(conform),
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


def conformance(t: LimitedCoefficients) -> float:
    """Probability that every true value is within its limit, given what was measured (JCGM 106, eq. 8, flat prior)."""
    return _within(t, t.limit)


def acceptance(t: LimitedCoefficients) -> float:
    """Probability that a unit whose true values are those measured would be accepted again under the rule."""
    return _within(t, t.limit - t.guard)


def _within(t: LimitedCoefficients, bound: Floats) -> float:
    """Π P(|deviation + error| ≤ bound), coefficients taken as independent: never too small where they agree."""
    scale = np.maximum(t.std, 1e-300)
    dof = np.clip(t.dof, 1.0, coverage.MANY)
    above, below = (bound - t.deviation) / scale, (-bound - t.deviation) / scale
    inside = scipy.special.stdtr(dof, above) - scipy.special.stdtr(dof, below)
    return float(np.prod(np.maximum(inside, 0.0)))


def _coefficients(recipe: Recipe, t: LimitedCoefficients) -> Iterator[Reason]:
    beyond = (t.guard >= t.limit) | ~(np.abs(t.deviation) <= t.limit - t.guard)
    for c in np.flatnonzero(beyond):
        i, deviation, std, limit, guard = t.index[c], t.deviation[c], t.std[c], t.limit[c], t.guard[c]
        name, unit = coefficients.NAMES[int(i)], coefficients.unit_of(int(i), recipe.unit)
        check = "offset" if coefficients.OFFSETS[i] else "gain" if coefficients.GAINS[i] else "cross-axis"
        what = f"{name} is {deviation:+.4g}{_as_unit(unit)}" + (" off 1" if check == "gain" else "")
        if guard >= limit:
            wide = coverage.factor(t.dof[c]) * std
            told = f"{what}, but its uncertainty {wide:.2g} leaves nothing of the limit {limit:g}"
            yield Reason.text(check, f"{told}: this recipe cannot decide it", float(deviation), float(limit), unit)
        else:
            told = f"{what}, beyond {limit:g}" + (f" less the guard band {guard:.2g}" if guard else "")
            yield Reason.text(check, told, float(deviation), float(limit - guard), unit)


def _as_unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _gates(recipe: Recipe, found: Calibration, stops: ReducedVisits) -> Iterator[Reason]:
    """Limits on how well the stops agree, which speak of the rig and the readings as much as of the unit."""
    limits, kept = recipe.limits, ~found.disturbed
    if not kept.any():
        return
    if limits.residual is not None:
        sizes = np.where(kept, np.abs(found.residual).max(axis=1), 0.0)
        yield from _largest("residual", sizes, limits.residual, found.positions, recipe.unit, "the residual")
    if limits.tilt_deg is not None:
        tilts = np.where(kept, found.tilt_deg, 0.0)
        yield from _largest("tilt", tilts, limits.tilt_deg, found.positions, "deg", "the tilt")
    if limits.noise is not None:
        scatter = np.where(kept, stops.std.max(axis=1), 0.0)
        yield from _largest("noise", scatter, limits.noise, found.positions, recipe.unit, "the noise of a reading")
    if limits.consistency is not None and (spread := consistency(stops, found.disturbed)) > limits.consistency:
        told = (
            f"readings of an axis across the stimulus differ by {spread:.3g} {recipe.unit}, more than "
            f"{limits.consistency:g}: cross-axis or pose errors are larger than the method may ignore"
        )
        yield Reason.text("consistency", told, spread, limits.consistency, recipe.unit)
    if limits.temperature_degC is not None:
        yield from _temperature(limits.temperature_degC, stops)


def _largest(check: str, size: Floats, limit: float, names: Sequence[str], unit: str, what: str) -> Iterator[Reason]:
    worst = int(np.argmax(size))
    if not size[worst] <= limit:
        told = f"{what} at {names[worst]!r} is {size[worst]:.3g} {unit}, more than {limit:g}"
        yield Reason.text(check, told, float(size[worst]), limit, unit)


def _temperature(limits: tuple[float, float], stops: ReducedVisits) -> Iterator[Reason]:
    low, high = limits
    known = np.isfinite(stops.temperature_degC)
    outside = known & ((stops.temperature_degC < low) | (stops.temperature_degC > high))
    for v in np.flatnonzero(outside)[:1]:
        T = float(stops.temperature_degC[v])
        told = f"it was {T:.1f} degC at {stops.position[v]!r}, outside {low:g} to {high:g}"
        yield Reason.text("temperature", told, T, high if high < T else low, "degC")


def consistency(stops: ReducedVisits, disturbed: NDArray[np.bool_]) -> float:
    """Largest difference between readings of an axis across the stimulus, in the recipe's unit.

    In DT0105's table these are its three spare equations, x₂ − x₃, y₁ − y₃ and z₁ − z₂: zero but for cross-axis
    gains and pose errors. 0 where no axis is across the stimulus twice.
    """
    size = np.linalg.norm(stops.true, axis=1, keepdims=True)
    across = (np.abs(stops.true) < ACROSS * size) & ~disturbed[:, None]
    spread = [np.ptp(stops.mean[across[:, i], i]) for i in range(3) if across[:, i].sum() > 1]
    return float(max(spread, default=0.0))
