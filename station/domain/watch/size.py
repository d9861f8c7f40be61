"""How big the change of an alert is, and when a drift meets the recipe's limit."""

import math
from dataclasses import dataclass

import numpy as np

from station.domain.recipe.blocks import Limits
from station.domain.watch.bank import Alert

_TURNS = ("nest-tilt", "base-tilt", "index-error")
#: These are watched as logarithms: their change is a factor.
_FACTORS = ("residual", "noise")
_WITHIN_95 = 1.96


@dataclass(frozen=True, slots=True)
class Size:
    """value: rad of a rotation, the recipe's unit of an offset (unit ""), 1 of a gain, a factor of residual and noise;
    low, high: 95 %; vector: along the signal's components, None for a factor."""

    value: float
    std: float
    low: float
    high: float
    unit: str
    vector: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class Drift:
    """per_load: in the unit of the size, of a factor per load its logarithm; loads_to_limit: None without a limit."""

    per_load: float
    loads_to_limit: float | None


def size_of(alert: Alert) -> Size:
    """The length of the change where it has several components."""
    kind = alert.place.signal.kind
    step = np.array([c.after - c.before for c in alert.changes])
    std = np.array([c.size_std for c in alert.changes])
    if kind in _FACTORS:
        low, high = np.exp(step[0] - _WITHIN_95 * std[0]), np.exp(step[0] + _WITHIN_95 * std[0])
        value = float(np.exp(step[0]))
        return Size(value, value * float(std[0]), float(low), float(high), "1", None)
    value = float(np.linalg.norm(step))
    along = float(np.sqrt((step / max(value, 1e-300)) ** 2 @ std**2))
    unit = "rad" if kind in _TURNS else "1" if kind == "gain" else ""
    half = _WITHIN_95 * along
    return Size(value, along, max(0.0, value - half), value + half, unit, tuple(step.tolist()))


def drift_of(alert: Alert, limits: Limits) -> Drift | None:
    """The steepest component, None where nothing drifts by more than three standard deviations."""
    drifting = [c for c in alert.changes if abs(c.slope) > 3 * c.slope_std > 0]
    if not drifting:
        return None
    steepest = max(drifting, key=lambda c: abs(c.slope) / c.slope_std)
    limit = _limit(alert.place.signal.kind, limits)
    if limit is None:
        return Drift(steepest.slope, None)
    level = steepest.before + steepest.slope * (alert.loads - alert.begin + 1)
    if alert.place.signal.kind in _TURNS:
        level -= steepest.before  # where the seat stood before is calibrated away; a turn counts from there
    room = limit - level * math.copysign(1, steepest.slope)
    return Drift(steepest.slope, max(0.0, room / abs(steepest.slope)))


def _limit(kind: str, limits: Limits) -> float | None:
    if kind in _TURNS:
        return None if limits.tilt_deg is None else math.radians(limits.tilt_deg)
    if kind == "residual":
        return None if limits.residual is None else math.log(limits.residual)
    return {"offset": limits.offset, "gain": limits.gain}.get(kind)
