"""What is wrong with the mounting of a rig, by the gravity that its units feel: swapped axes, signs, ratios, zeros.

First one small step of each drive: the difference of two readings knows nothing of a unit's offset, and its direction
says which axis turned and which way, its length how far. Then a fit over poses all around: of each drive the scale and
the zero, with the offset and the gain of every axis of every unit free.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.optimize import least_squares

from station.domain.core.types import Floats
from station.domain.rig.kinematics import VERTICAL, attitude
from station.domain.rig.rig_map import Axis, RigMap
from station.messages import Message

#: A step of each drive, degrees as its map has them: small, for the map may be wrong by a factor.
STEP_DEG = 4.0
#: Angles, degrees, that the poses of the fit are made of; they are cut at the limits.
_ANGLES = (0.0, 40.0, -40.0, 80.0, -80.0)
#: Scale and zero of a right mounting, and how often its standard deviation a difference must be.
SCALE_TOLERANCE, ZERO_TOLERANCE_DEG, TIMES_STD = 0.003, 0.3, 4.0

#: Angles of all axes by the present map, degrees → mean reading (3) in g of each unit in the frame of the nest.
Reading = tuple[tuple[float, ...], Mapping[str, Floats]]


@dataclass(frozen=True, slots=True)
class DriveStep:
    """What a step of one drive did. axis: of the map, that it turned; scale: times what the map says, signed."""

    drive: str
    axis: str
    scale: float


@dataclass(frozen=True, slots=True)
class MountingFit:
    """Scales and zeros (degrees) of the axes with their standard deviations; residual_g: what is left."""

    scale: tuple[float, ...]
    scale_std: tuple[float, ...]
    zero_deg: tuple[float, ...]
    zero_std_deg: tuple[float, ...]
    residual_g: float


def up_in_nest(rig: RigMap, angles_deg: Sequence[float]) -> Floats:
    """What a unit in the nest feels (3), in g."""
    return np.asarray(attitude(rig.directions, angles_deg).T @ VERTICAL)


def steps_of(rig: RigMap, start: Reading, after: Sequence[Reading]) -> tuple[DriveStep, ...] | None:
    """What the step of each drive, in the map's order, turned; None where gravity does not show it in this pose."""
    felt = [np.mean([end[1][unit] - start[1][unit] for unit in start[1]], axis=0) for end in after]
    best: tuple[float, tuple[DriveStep, ...]] | None = None
    for order in permutations(range(len(rig.axes))):
        found, off = [], 0.0
        for drive, axis in enumerate(order):
            turned, miss = _turned_deg(rig, start[0], axis, felt[drive])
            found.append(DriveStep(rig.axes[drive].name, rig.axes[axis].name, turned / STEP_DEG))
            off += miss
        if best is None or off < best[0]:
            best = off, tuple(found)
    visible = [np.linalg.norm(f) > np.sin(np.deg2rad(STEP_DEG)) * 0.03 for f in felt]
    return best[1] if best is not None and all(visible) else None


def _turned_deg(rig: RigMap, start: tuple[float, ...], axis: int, felt: Floats) -> tuple[float, float]:
    """Angle about an axis that explains a difference of readings best, within ±80°, and what it leaves over."""
    base = up_in_nest(rig, start)
    tried = np.linspace(-80.0, 80.0, 1601)
    goals = [[a + (t if i == axis else 0.0) for i, a in enumerate(start)] for t in tried.tolist()]
    misses = np.linalg.norm(np.array([up_in_nest(rig, g) for g in goals]) - base - felt, axis=1)
    at = int(np.argmin(misses))
    return float(tried[at]), float(misses[at])


def corrected_by_steps(rig: RigMap, steps: Sequence[DriveStep]) -> RigMap:
    """The map as the steps have shown it: each axis gets the drive that turns it, with its direction and scale."""
    drives = {step.axis: (next(a for a in rig.axes if a.name == step.drive), step.scale) for step in steps}
    return with_axes(rig, [_driven_by(axis, *drives[axis.name]) for axis in rig.axes])


def _driven_by(axis: Axis, drive: Axis, scale: float) -> Axis:
    kept = {name: getattr(drive, name) for name in ("node", "axis", "zero_counts", "homing", "hold", "safe_torque_off")}
    return axis.model_copy(update={**kept, "counts_per_deg": drive.counts_per_deg / scale})


def corrected_by_fit(rig: RigMap, found: MountingFit) -> RigMap:
    """The map with the scales and zeros of a fit, where they matter: angle = scale · (angle by the map) + zero."""
    axes = []
    for i, axis in enumerate(rig.axes):
        counts = axis.counts_per_deg / (found.scale[i] if _is_wrong_scale(found.scale[i], found.scale_std[i]) else 1.0)
        zero = found.zero_deg[i] if _is_wrong_zero(found.zero_deg[i], found.zero_std_deg[i]) else 0.0
        axes.append(
            axis.model_copy(update={"counts_per_deg": counts, "zero_counts": round(axis.zero_counts - zero * counts)})
        )
    return with_axes(rig, axes)


def with_axes(rig: RigMap, axes: Sequence[Axis]) -> RigMap:
    """The map with other axes, checked anew."""
    document = rig.model_dump(by_alias=True) | {"axes": [axis.model_dump() for axis in axes]}
    return RigMap.model_validate(document)


def poses_of(rig: RigMap) -> list[tuple[float, ...]]:
    """Poses for the fit: every angle of one axis with the others at rest, and corners; within limits, out of zones."""
    count = len(rig.axes)
    tried = [tuple(a if i == axis else 0.0 for i in range(count)) for axis in range(count) for a in _ANGLES]
    if count == 2:
        tried += [(a, b) for a in (50.0, -50.0) for b in (50.0, -50.0)]
    cut = [tuple(min(max(a, lo), hi) for a, (lo, hi) in zip(p, rig.limits, strict=True)) for p in tried]
    return [p for p in dict.fromkeys(cut) if rig.space.zone_at(p) is None]


def fit_mounting(rig: RigMap, readings: Sequence[Reading]) -> MountingFit:
    """Scale and zero of each axis from readings all around; offset and gain of every axis of every unit are free."""
    angles = np.array([a for a, _ in readings])
    units = np.stack([[felt[unit] for _, felt in readings] for unit in readings[0][1]])
    count = angles.shape[1]

    def residuals(parameters: Floats) -> Floats:
        true = angles * parameters[:count] + parameters[count:]
        up = np.array([up_in_nest(rig, row) for row in true.tolist()])
        return _left_over(up, units)

    start = np.concatenate([np.ones(count), np.zeros(count)])
    found = least_squares(residuals, start, x_scale=np.concatenate([np.full(count, 0.01), np.ones(count)]))
    free = units.size - len(start) - 6 * len(units)
    variance = 2 * found.cost / max(free, 1)
    std = np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac)) * variance)
    x = found.x.tolist()
    return MountingFit(
        tuple(x[:count]),
        tuple(std[:count].tolist()),
        tuple(x[count:]),
        tuple(std[count:].tolist()),
        float(np.sqrt(variance)),
    )


def _left_over(up: Floats, units: Floats) -> Floats:
    """Readings (units, poses, 3) less the best offset and gain of each axis of each unit, in one row."""
    centred = up - up.mean(axis=0)
    felt = units - units.mean(axis=1, keepdims=True)
    gain = np.einsum("upi,pi->ui", felt, centred) / np.maximum((centred**2).sum(axis=0), 1e-9)
    return np.asarray((felt - gain[:, None] * centred).ravel())


def findings(rig: RigMap, steps: Sequence[DriveStep], found: MountingFit | None) -> tuple[Message, ...]:
    """What is wrong, in sentences; none where the mounting is right."""
    wrong: list[Message] = []
    if any(step.axis != step.drive for step in steps):
        wrong.append(Message("rig-axes-swapped", first=steps[0].drive, second=steps[-1].drive))
    for step in steps:
        scale = abs(step.scale) * (found.scale[_index(rig, step.axis)] if found else 1.0)
        if step.scale < 0:
            wrong.append(Message("rig-axis-backwards", axis=step.drive))
        std = found.scale_std[_index(rig, step.axis)] if found else 0.02
        if _is_wrong_scale(scale, std):
            wrong.append(Message("rig-axis-ratio", axis=step.drive, ratio=scale))
    for axis, zero, std in zip(rig.axes, found.zero_deg, found.zero_std_deg, strict=True) if found else ():
        if _is_wrong_zero(zero, std):
            wrong.append(Message("rig-axis-zero", axis=axis.name, zero_deg=zero, std_deg=std))
    return tuple(wrong)


def _is_wrong_scale(scale: float, std: float) -> bool:
    return abs(scale - 1) > max(SCALE_TOLERANCE, TIMES_STD * std)


def _is_wrong_zero(zero_deg: float, std_deg: float) -> bool:
    return abs(zero_deg) > max(ZERO_TOLERANCE_DEG, TIMES_STD * std_deg)


def _index(rig: RigMap, name: str) -> int:
    return [axis.name for axis in rig.axes].index(name)
