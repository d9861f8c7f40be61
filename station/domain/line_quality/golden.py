"""Golden and known-bad units: what each must come out as, and whether its last run says so. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

GoldenKind = Literal["golden", "known-bad"]


@dataclass(frozen=True, slots=True)
class RegisteredUnit:
    """What is registered of one unit.

    values: name → (value, half-width) of what must come out; checks: those that must fail (known-bad); due: day by
    which the unit itself must be looked at again, ISO, or ''.
    """

    serial: str
    kind: GoldenKind
    recipe: str
    outcome: str
    values: Mapping[str, tuple[float, float]]
    checks: tuple[str, ...]
    due: str


@dataclass(frozen=True, slots=True)
class LatestResult:
    """What the newest judged attempt of a unit came to; at_s: its end (epoch)."""

    at_s: float
    outcome: str
    values: Mapping[str, float]
    checks: tuple[str, ...]


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


def differences(expected: RegisteredUnit, shown: LatestResult) -> list[str]:
    """What came out otherwise than registered, a sentence each."""
    found = []
    if shown.outcome != expected.outcome:
        found.append(f"{shown.outcome} instead of {expected.outcome}")
    found += [f"{check} was not found wanting" for check in expected.checks if check not in shown.checks]
    for name, (value, half) in expected.values.items():
        got = shown.values.get(name)
        if got is None or abs(got - value) > half:
            said = "nothing" if got is None else f"{got:.6g}"
            found.append(f"{name} is {said} instead of {value:.6g} ± {half:.2g}")
    return found
