"""Golden and known-bad units: what each must come out as, and whether its last run says so. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy

#: A line through fewer points has no scatter to speak of.
MIN_TREND = 4

GoldenKind = Literal["golden", "known-bad"]


@dataclass(frozen=True, slots=True)
class RegisteredUnit:
    """What is registered of one unit.

    values: name → (value, half-width) of what must come out; external: they are another laboratory's, with its U, and
    Eₙ decides (ISO 13528, 9.7) where otherwise the half-width does; checks: those that must fail (known-bad); due: day
    by which the unit itself must be looked at again, ISO, or ''.
    """

    serial: str
    kind: GoldenKind
    recipe: str
    outcome: str
    values: Mapping[str, tuple[float, float]]
    checks: tuple[str, ...]
    due: str
    external: bool = False


@dataclass(frozen=True, slots=True)
class LatestResult:
    """What the newest judged attempt of a unit came to; at_s: its end (epoch); expanded: U of the values."""

    at_s: float
    outcome: str
    values: Mapping[str, float]
    checks: tuple[str, ...]
    expanded: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class GoldenStatus:
    """Where one unit stands. age_s: since its last run, None when there was none; problem: '' when all is well."""

    serial: str
    kind: GoldenKind
    age_s: float | None
    problem: str


def golden_status(
    expected: RegisteredUnit, shown: LatestResult | None, now_s: float, today: str, every_h: float
) -> GoldenStatus:
    """Whether the unit's check is done, fresh and as expected. today: ISO day."""
    age_s = None if shown is None else max(0.0, now_s - shown.at_s)
    return GoldenStatus(expected.serial, expected.kind, age_s, _problem(expected, shown, age_s, today, every_h))


def _problem(
    expected: RegisteredUnit, shown: LatestResult | None, age_s: float | None, today: str, every_h: float
) -> str:
    name = f"{expected.kind} unit {expected.serial}"
    if expected.due and today > expected.due:
        return f"{name} is past its due date {expected.due}; have it looked at and register it again"
    if shown is None or age_s is None:
        return f"{name} was never run; run it alone, then go on"
    wrong = differences(expected, shown)
    if wrong:
        return f"{name} came out wrong: {'; '.join(wrong)}; find out why before anything is made"
    if age_s > every_h * 3600:
        return f"the check of {name} is {age_s / 3600:.1f} h old and due every {every_h:g} h; run it alone, then go on"
    return ""


@dataclass(frozen=True, slots=True)
class EnPoint:
    """One coefficient of one attempt against the certificate: when (epoch), value here, its U, and Eₙ."""

    at_s: float
    value: float
    expanded: float
    score: float


@dataclass(frozen=True, slots=True)
class EnTrend:
    """Eₙ of one coefficient over time. drift_per_day with its 95 % half-width; days_to_limit: from the newest point on
    until ± 1, None where no drift is evident."""

    name: str
    points: tuple[EnPoint, ...]
    drift_per_day: float
    drift_half: float
    days_to_limit: float | None


def en_trends(expected: RegisteredUnit, results: Sequence[LatestResult]) -> tuple[EnTrend, ...]:
    """Of each certified value, over results (oldest first) that have it."""
    return tuple(
        _trend(name, tuple(_point(r, name, *certified) for r in results if name in r.values))
        for name, certified in expected.values.items()
    )


def _point(result: LatestResult, name: str, value: float, expanded: float) -> EnPoint:
    own = result.expanded.get(name, 0.0)
    got = result.values[name]
    return EnPoint(result.at_s, got, own, normalised_error(got - value, expanded, own))


def _trend(name: str, points: tuple[EnPoint, ...]) -> EnTrend:
    """A straight line through all points; evident where zero is outside its 95 % interval."""
    day = np.array([p.at_s for p in points]) / 86400
    if len(points) < MIN_TREND or np.ptp(day) == 0:
        return EnTrend(name, points, 0.0, math.inf, None)
    score = np.array([p.score for p in points])
    about = day - day.mean()
    square = float(about @ about)
    slope = float(about @ score / square)
    rest = score - score.mean() - slope * about
    half = float(scipy.special.stdtrit(len(points) - 2, 0.975) * np.sqrt(rest @ rest / (len(points) - 2) / square))
    if abs(slope) <= half:
        return EnTrend(name, points, slope, half, None)
    now = float(score.mean() + slope * about[-1])
    return EnTrend(name, points, slope, half, max(0.0, (math.copysign(1, slope) - now) / slope))


def normalised_error(difference: float, expanded: float, own_expanded: float) -> float:
    """Eₙ (ISO 13528, eq. 32): the difference over both expanded uncertainties; beyond ± 1 they disagree."""
    return difference / math.hypot(expanded, own_expanded) if expanded or own_expanded else math.inf * difference


def differences(expected: RegisteredUnit, shown: LatestResult) -> list[str]:
    """What came out otherwise than registered, a sentence each."""
    found = []
    if shown.outcome != expected.outcome:
        found.append(f"{shown.outcome} instead of {expected.outcome}")
    found += [f"{check} was not found wanting" for check in expected.checks if check not in shown.checks]
    for name, (value, half) in expected.values.items():
        got = shown.values.get(name)
        if expected.external and got is not None:
            score = normalised_error(got - value, half, shown.expanded.get(name, 0.0))
            if abs(score) > 1:
                found.append(
                    f"Eₙ of {name} is {score:+.2f}: {got:.6g} here, {value:.6g} ± {half:.2g} by its certificate"
                )
            continue
        if got is None or abs(got - value) > half:
            reported = "nothing" if got is None else f"{got:.6g}"
            found.append(f"{name} is {reported} instead of {value:.6g} ± {half:.2g}")
    return found
