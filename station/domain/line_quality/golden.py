"""Golden and known-bad units: what each must come out as, and whether its last run says so. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

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
