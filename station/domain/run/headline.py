"""The one value that a verdict hangs on, for a tile that a person reads from two metres."""

from dataclasses import dataclass
from typing import Any, Final

from station.domain.core.types import Outcome, Reason
from station.domain.methods import coefficients
from station.domain.run.progress import UnitResult

#: What is off in the device's own output, which has no sign.
OUTPUT_ERROR = "output error"
#: Checks of coefficients, which have a nominal value and a limit on both sides.
_TWO_SIDED: Final = ("offset", "gain", "cross-axis")


@dataclass(frozen=True, slots=True)
class Headline:
    """what: the coefficient's name, or OUTPUT_ERROR; value, target and limits in `unit`."""

    what: str
    value: float
    low: float
    high: float
    target: float
    unit: str


def headline(result: UnitResult) -> Headline | None:
    """Of a failed unit the first value beyond its limit; of one that passed, the largest error of its own output, or
    the coefficient nearest to its limit. None where no number decided."""
    if result.outcome is Outcome.PASS:
        return _verified(result) or _nearest(result)
    return next((found for found in map(_of_reason, result.reasons) if found is not None), None)


def _of_reason(reason: Reason) -> Headline | None:
    shown: Any = reason.message.parameters
    if reason.value is None or reason.limit is None:
        return None
    if reason.check in _TWO_SIDED and "coefficient" in shown:
        target, limit = _target(str(shown["coefficient"])), float(shown["limit"])
        name = str(shown["coefficient"])
        return Headline(name, target + reason.value, target - limit, target + limit, target, reason.unit)
    if reason.check == "verify":
        return Headline(OUTPUT_ERROR, reason.value, 0.0, reason.limit, 0.0, reason.unit)
    return None


def _verified(result: UnitResult) -> Headline | None:
    verification = result.verification or {}
    errors = [float(p["error"]) for p in verification.get("positions", ()) if p.get("error") is not None]
    if not errors or verification.get("limit") is None:
        return None
    return Headline(OUTPUT_ERROR, max(errors), 0.0, float(verification["limit"]), 0.0, str(verification["unit"]))


def _nearest(result: UnitResult) -> Headline | None:
    decided = [d for d in (result.fit.decisions if result.fit else ()) if d.what in coefficients.NAMES]
    if not decided:
        return None
    d = min(decided, key=lambda d: d.margin / d.limit)
    target = _target(d.what)
    return Headline(d.what, target + d.value, target - d.limit, target + d.limit, target, d.unit)


def _target(name: str) -> float:
    return float(coefficients.NOMINAL[coefficients.NAMES.index(name)])
