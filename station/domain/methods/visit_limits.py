"""Limits on how well the visits agree, which speak of rig and readings as much as of the unit."""

from collections.abc import Iterator, Sequence
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


@dataclass(frozen=True, slots=True, eq=False)
class LimitedVisits:
    """A limit on the visits of units (u), in a unit: value and standard uncertainty (u) at each one's worst visit, its
    index (u), None where the value is of several; decided (u): where there is a visit to decide on."""

    what: str
    unit: str
    limit: float
    value: Floats
    std: Floats
    worst: NDArray[np.intp] | None
    decided: NDArray[np.bool_]

    def refused(self, limits: Limits) -> list[int]:
        """The units whose value the rule does not accept; no number is not accepted."""
        room = self.limit - _guard(limits, self.std)
        return np.flatnonzero(self.decided & ~(np.abs(self.value) <= room)).tolist()

    def decision(self, limits: Limits, u: int) -> Decision:
        """The limit as it was decided for one of the units."""
        return decide_limit(limits, (self.what, self.unit), float(self.value[u]), float(self.std[u]), self.limit)


def _guard(limits: Limits, std: Floats) -> Floats:
    """w where the standard uncertainty is taken as known."""
    return guard_band(limits, coverage.ErrorDistribution.plain(std, np.full_like(std, coverage.MANY)))


def decided(limits: Limits, found: Calibration, visits: ReducedVisits) -> Iterator[Decision]:
    """Each limit of one unit: residual, tilt and noise at the worst visit, and how far readings across the stimulus
    differ."""
    for one in limited_visits(limits, [found], [visits]):
        if one.decided[0]:
            yield one.decision(limits, 0)


def visit_reasons(limits: Limits, found: Sequence[Calibration], visits: Sequence[ReducedVisits]) -> list[list[Reason]]:
    """What is not accepted of each unit, and temperatures outside their range, which decide whether the readings are
    evidence. The units went through the same visits."""
    reasons: list[list[Reason]] = [[] for _ in found]
    for one in limited_visits(limits, found, visits):
        for u in one.refused(limits):
            own = one.decision(limits, u)
            shown: dict[str, Value] = {"value": own.value, "limit": own.limit, "unit": own.unit, "guard": own.guard}
            where: dict[str, Value] = {} if one.worst is None else {"position": found[u].positions[one.worst[u]]}
            message = Message(f"{own.what}-beyond-limit", **where, **shown)
            reasons[u].append(Reason(message, own.value, own.limit - own.guard, own.unit, own.what))
    if limits.temperature_degC is not None:
        for u, why in _temperatures(limits.temperature_degC, found, visits):
            reasons[u].append(why)
    return reasons


def limited_visits(
    limits: Limits, found: Sequence[Calibration], visits: Sequence[ReducedVisits]
) -> Iterator[LimitedVisits]:
    """Every limit on visits, of units that went through the same ones."""
    undisturbed = ~np.array([one.disturbed for one in found])
    some, unit = np.asarray(undisturbed.any(axis=1)), found[0].unit
    for what, limit, of, own_unit in (
        ("residual", limits.residual, _residuals, unit),
        ("tilt", limits.tilt_deg, _tilts, "deg"),
        ("noise", limits.noise, _noises, unit),
    ):
        if limit is not None:
            size, std = of(found, visits)
            wide = np.where(undisturbed, size + _guard(limits, std), -np.inf)
            worst = wide.argmax(axis=1)
            value, std = (np.take_along_axis(each, worst[:, None], 1)[:, 0] for each in (size, std))
            yield LimitedVisits(what, own_unit, limit, value, std, worst, some)
    if limits.consistency is not None:
        pairs = zip(found, visits, strict=True)
        spread, std = np.array([consistency(own, one.disturbed) for one, own in pairs]).T
        yield LimitedVisits("consistency", unit, limits.consistency, spread, std, None, some)


def _residuals(found: Sequence[Calibration], visits: Sequence[ReducedVisits]) -> tuple[Floats, Floats]:
    """Largest residual of each visit, and its standard uncertainty, each (u, v)."""
    residual = np.abs(np.array([one.residual for one in found]))
    of_mean = np.sqrt(np.array([_variances(one) for one in visits]))
    at = residual.argmax(axis=2)[..., None]
    return residual.max(axis=2), np.take_along_axis(of_mean, at, 2)[..., 0]


def _tilts(found: Sequence[Calibration], visits: Sequence[ReducedVisits]) -> tuple[Floats, Floats]:
    """Tilt of each visit, and its standard uncertainty, each (u, v), in degrees."""
    del visits
    return np.array([one.tilt_deg for one in found]), np.array([one.tilt_std_deg for one in found])


def _noises(found: Sequence[Calibration], visits: Sequence[ReducedVisits]) -> tuple[Floats, Floats]:
    """Noise of each visit's noisiest axis, and its standard uncertainty, each (u, v): s of ν degrees of freedom is
    known to s/√(2ν)."""
    del found
    noise = np.array([one.std for one in visits]).max(axis=2)
    effective = np.array([one.effective for one in visits])
    return noise, noise / np.sqrt(2 * np.maximum(effective - 1, 1.0))


def consistency(visits: ReducedVisits, disturbed: NDArray[np.bool_]) -> tuple[float, float]:
    """Largest difference between readings of an axis across the stimulus, and its u, in the recipe's unit.

    In DT0105's table these are its three spare equations, x₂ − x₃, y₁ − y₃ and z₁ − z₂: zero but for cross-axis
    gains and pose errors. 0 where no axis is across the stimulus twice.
    """
    size = np.linalg.norm(visits.true, axis=1, keepdims=True)
    across = (np.abs(visits.true) < ACROSS * size) & ~disturbed[:, None]
    of_mean = _variances(visits)
    found = [_spread(visits.mean[own, i], of_mean[own, i]) for i in range(3) if (own := across[:, i]).sum() > 1]
    return max(found, default=(0.0, 0.0))


def _variances(visits: ReducedVisits) -> Floats:
    """Of the mean readings (v, 3), with as much rounding as budgets count."""
    more = 0.0 if visits.rounding is None else visits.rounding - visits.quantisation
    return np.asarray(np.einsum("vii->vi", visits.cov) + more)


def _spread(mean: Floats, variance: Floats) -> tuple[float, float]:
    low, high = int(np.argmin(mean)), int(np.argmax(mean))
    return float(mean[high] - mean[low]), float(np.sqrt(variance[low] + variance[high]))


def _temperatures(
    limits: tuple[float, float], found: Sequence[Calibration], visits: Sequence[ReducedVisits]
) -> Iterator[tuple[int, Reason]]:
    """Of each unit that was too cold or too warm the first visit at which it was."""
    low, high = limits
    degC = np.array([one.temperature_degC for one in visits])
    outside = np.isfinite(degC) & ((degC < low) | (degC > high))
    outside &= ~np.array([one.disturbed.all() for one in found])[:, None]
    for u in np.flatnonzero(outside.any(axis=1)).tolist():
        v = int(outside[u].argmax())
        T = float(degC[u, v])
        message = Message("temperature-outside", value=T, position=visits[u].position[v], low=low, high=high)
        yield u, Reason(message, T, high if high < T else low, "degC", "temperature")
