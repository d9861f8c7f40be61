"""Limits on how well the visits agree, which speak of rig and readings as much as of the unit."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Calibration, Floats, Reason, ReducedVisits
from station.domain.methods import coverage
from station.domain.methods.decision import Decision, decide_limit, guard_band
from station.domain.recipe.blocks import Limits
from station.messages import Message, Value

#: An axis is across the stimulus when it feels less than this share of it.
ACROSS = 0.05


@dataclass(frozen=True, slots=True)
class VisitDecision:
    """A limit as it was decided, and at which position; '' where it is of several."""

    decision: Decision
    position: str


def decided(limits: Limits, found: Calibration, visits: ReducedVisits) -> Iterator[VisitDecision]:
    """Residual, tilt and noise at their worst visit, and how far readings across the stimulus differ."""
    undisturbed = ~found.disturbed
    if not undisturbed.any():
        return
    of_mean, residual = np.sqrt(np.einsum("vii->vi", visits.cov)), np.abs(found.residual)
    at = residual.argmax(axis=1)[:, None]
    noise = visits.std.max(axis=1)
    # s of ν degrees of freedom is known to s/√(2ν).
    of_noise = noise / np.sqrt(2 * np.maximum(visits.effective - 1, 1.0))
    for what, limit, size, std, unit in (
        ("residual", limits.residual, residual.max(axis=1), np.take_along_axis(of_mean, at, 1)[:, 0], found.unit),
        ("tilt", limits.tilt_deg, found.tilt_deg, found.tilt_std_deg, "deg"),
        ("noise", limits.noise, noise, of_noise, found.unit),
    ):
        if limit is not None:
            guard = guard_band(limits, std, np.full(len(std), coverage.MANY))
            worst = int(np.argmax(np.where(undisturbed, size + guard, -np.inf)))
            own = decide_limit(limits, (what, unit), float(size[worst]), float(std[worst]), limit)
            yield VisitDecision(own, found.positions[worst])
    if limits.consistency is not None:
        spread, std = consistency(visits, found.disturbed)
        yield VisitDecision(decide_limit(limits, ("consistency", found.unit), spread, std, limits.consistency), "")


def visit_reasons(limits: Limits, found: Calibration, visits: ReducedVisits) -> Iterator[Reason]:
    """What is not accepted, and temperatures outside their range, which decides whether the readings are evidence."""
    for one in decided(limits, found, visits):
        own = one.decision
        if not own.accepted:
            shown: dict[str, Value] = {"value": own.value, "limit": own.limit, "unit": own.unit, "guard": own.guard}
            where: dict[str, Value] = {"position": one.position} if one.position else {}
            message = Message(f"{own.what}-beyond-limit", **where, **shown)
            yield Reason(message, own.value, own.limit - own.guard, own.unit, own.what)
    if limits.temperature_degC is not None and not found.disturbed.all():
        yield from _temperature(limits.temperature_degC, visits)


def consistency(visits: ReducedVisits, disturbed: NDArray[np.bool_]) -> tuple[float, float]:
    """Largest difference between readings of an axis across the stimulus, and its u, in the recipe's unit.

    In DT0105's table these are its three spare equations, x₂ − x₃, y₁ − y₃ and z₁ − z₂: zero but for cross-axis
    gains and pose errors. 0 where no axis is across the stimulus twice.
    """
    size = np.linalg.norm(visits.true, axis=1, keepdims=True)
    across = (np.abs(visits.true) < ACROSS * size) & ~disturbed[:, None]
    found = [_spread(visits.mean[own, i], visits.cov[own, i, i]) for i in range(3) if (own := across[:, i]).sum() > 1]
    return max(found, default=(0.0, 0.0))


def _spread(mean: Floats, variance: Floats) -> tuple[float, float]:
    low, high = int(np.argmin(mean)), int(np.argmax(mean))
    return float(mean[high] - mean[low]), float(np.sqrt(variance[low] + variance[high]))


def _temperature(limits: tuple[float, float], visits: ReducedVisits) -> Iterator[Reason]:
    low, high = limits
    known = np.isfinite(visits.temperature_degC)
    outside = known & ((visits.temperature_degC < low) | (visits.temperature_degC > high))
    for v in np.flatnonzero(outside)[:1]:
        T = float(visits.temperature_degC[v])
        message = Message("temperature-outside", value=T, position=visits.position[v], low=low, high=high)
        yield Reason(message, T, high if high < T else low, "degC", "temperature")
