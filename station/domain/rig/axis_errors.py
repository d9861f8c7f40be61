"""The axes' own errors from the readings of many units: zeros, scales, non-orthogonality, wobble of the encoders.

A unit's own matrix and offset are free, so whatever a unit could do by itself is not laid to the axes:
m = M_u · g(angles; errors) + o_u. What remains is common to all units. Gauss–Newton: with M near 1 the errors act
linearly, J · errors, and the twelve coefficients of each unit are projected out (Golub and Pereyra 2003, variable
projection).

The diagnosis names such errors position by position (`index-error`) or as `base-tilt`; here they are those of two axes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.rig.commissioning import with_axes
from station.domain.rig.kinematics import VERTICAL
from station.domain.rig.rig_map import RigMap

#: Directions of errors that change the readings less than this, relative to the strongest, cannot be told apart.
_SINGULAR = 1e-6
_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class AxisError:
    """One error of an axis. kind: zero, scale, square, sine or cosine; value and std in degrees (scale: 1); interval:
    half its 95 % interval; None: these positions cannot show it."""

    axis: str
    kind: str
    value: float | None
    std: float | None
    interval: float | None


@dataclass(frozen=True, slots=True)
class AxisErrors:
    """Every error; residual_g: what is left of a reading; angles (v, axes): the visits' commanded angles."""

    errors: tuple[AxisError, ...]
    residual_g: float
    dof: int

    def of(self, axis: str, kind: str) -> AxisError:
        """One of them."""
        return next(e for e in self.errors if (e.axis, e.kind) == (axis, kind))


def kinds_of(rig: RigMap) -> list[tuple[str, str]]:
    """(axis, kind) of the errors that are looked for. The zero of the inner axis shows only where units are measured in
    two seatings: one that lies turned by as much in its nest reads the same in every position."""
    found = []
    for number, axis in enumerate(rig.axes):
        found += [(axis.name, kind) for kind in ("zero", "scale", "sine", "cosine")]
        if number == 1:
            found.append((axis.name, "square"))
    return found


def felt(rig: RigMap, angles_deg: Floats, errors: Floats, seats: Floats | None = None) -> Floats:
    """What units feel (v, 3), in g, at commanded angles (v, axes) of a rig with these errors (degrees; scale 1), in the
    order of `kinds_of`. seats (v, 3, 3): device → nest, left out: at home."""
    value = dict(zip(kinds_of(rig), errors.tolist(), strict=True))
    R = np.broadcast_to(np.eye(3), (len(angles_deg), 3, 3))
    for number, axis in enumerate(rig.axes):
        angle = angles_deg[:, number]
        turned = np.deg2rad(angle)
        wobble = value[axis.name, "sine"] * np.sin(turned) + value[axis.name, "cosine"] * np.cos(turned)
        true = angle * (1 + value[axis.name, "scale"]) + value[axis.name, "zero"] + wobble
        direction = axis.direction
        if number == 1:
            direction = rotation.from_vector(np.deg2rad(value[axis.name, "square"]) * _normal(rig)) @ direction
        R = R @ rotation.from_vector(np.deg2rad(true)[:, None] * direction)
    if seats is not None:
        R = R @ seats
    return np.asarray(np.einsum("vij,i->vj", R, VERTICAL))


def estimate_axis_errors(rig: RigMap, angles_deg: Floats, readings: Floats, seats: Floats | None = None) -> AxisErrors:
    """Errors of the axes. angles_deg (v, axes) commanded; readings (units, v, 3) means in g; seats (v, 3, 3):
    device → nest, left out: at home.

    Standard deviations hold for whatever of the errors these positions can show; the others are None.
    """
    kinds = kinds_of(rig)
    errors = np.zeros(len(kinds))
    for _ in range(_ROUNDS):
        design, left = _projected(lambda e: felt(rig, angles_deg, e, seats), readings, errors)
        step, shown, covariance = _solve(design, left)
        errors = errors + step
    design, left = _projected(lambda e: felt(rig, angles_deg, e, seats), readings, errors)
    dof = readings.size - 12 * len(readings) - int(shown.sum())
    variance = float(left @ left) / max(dof, 1)
    std = np.sqrt(np.diag(covariance) * variance)
    factor = float(stats.t.ppf(0.975, max(dof, 1)))
    found = [
        AxisError(*kind, float(e), float(s), factor * float(s)) if ok else AxisError(*kind, None, None, None)
        for kind, e, s, ok in zip(kinds, errors, std, shown, strict=True)
    ]
    return AxisErrors(tuple(found), float(np.sqrt(variance)), dof)


def corrected_by_errors(rig: RigMap, found: AxisErrors) -> RigMap:
    """The map with zeros, scales and the direction of the inner axis as found, where they are significant; a map has no
    place for the wobble of an encoder."""
    value = {(e.axis, e.kind): _significant(e) for e in found.errors}
    axes = []
    for number, axis in enumerate(rig.axes):
        counts = axis.counts_per_deg / (1 + value[axis.name, "scale"])
        update: dict[str, object] = {
            "counts_per_deg": counts,
            "zero_counts": round(axis.zero_counts - value[axis.name, "zero"] * counts),
        }
        if number == 1 and (tilt := value[axis.name, "square"]):
            turned = rotation.from_vector(np.deg2rad(tilt) * _normal(rig)) @ axis.direction
            update["turns"] = tuple(turned.tolist())
        axes.append(axis.model_copy(update=update))
    return with_axes(rig, axes)


def _significant(error: AxisError) -> float:
    if error.value is None or error.interval is None or abs(error.value) <= error.interval:
        return 0.0
    return error.value


def _normal(rig: RigMap) -> Floats:
    """Direction about which the inner axis leans towards the outer one."""
    outer, inner = rig.directions
    normal = np.cross(outer, inner)
    return np.asarray(normal / np.linalg.norm(normal))


def _projected(model: Callable[[Floats], Floats], readings: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Derivatives (units · v · 3, errors) and residuals, both without what the units' own coefficients explain."""
    up = model(errors)
    own = np.column_stack([up, np.ones(len(up))])
    Q, _ = np.linalg.qr(own)
    slopes = np.stack([_slope(model, errors, i) for i in range(len(errors))], axis=-1)
    blocks, left = [], []
    for unit in readings:
        M = np.linalg.lstsq(own, unit, rcond=None)[0][:3].T
        J = np.einsum("ij,vjk->vik", M, slopes)
        J = J - np.einsum("vq,qik->vik", Q, np.einsum("vq,vik->qik", Q, J))
        blocks.append(J.reshape(-1, len(errors)))
        left.append((unit - Q @ (Q.T @ unit)).ravel())
    return np.vstack(blocks), np.concatenate(left)


def _slope(function: Callable[[Floats], Floats], at: Floats, index: int) -> Floats:
    step = np.zeros(len(at))
    step[index] = 1e-4
    return np.asarray((function(at + step) - function(at - step)) / 2e-4)


def _solve(design: Floats, left: Floats) -> tuple[Floats, Floats, Floats]:
    """Least squares over what the design shows; which errors that is (bool), and (JᵀJ)⁻¹."""
    length = np.linalg.norm(design, axis=0)
    seen = length > _SINGULAR * length.max()
    size = np.where(seen, length, 1.0)
    U, s, Vt = np.linalg.svd(np.where(seen, design / size, 0.0), full_matrices=False)
    keep = s > _SINGULAR * s[0]
    inverse = Vt[keep].T / s[keep]
    hidden = (Vt[~keep] ** 2).sum(axis=0) if (~keep).any() else np.zeros(len(size))
    shown = seen & (hidden < 1e-3)
    step = np.where(shown, inverse @ (U[:, keep].T @ left) / size, 0.0)
    return step, shown, (inverse @ inverse.T) / np.outer(size, size)


def angles_of_visits(rig: RigMap, nests: Sequence[Floats]) -> Floats:
    """Commanded angles (v, axes) of visits by their nest → station rotations, in order, each the nearest to the one
    before."""
    at, found = rig.park_deg, []
    for nest in nests:
        goals = rig.goals(nest)
        at = min(goals, key=lambda goal: rig.space.hop_s(at, goal))
        found.append(at)
    return np.array(found)


def by_unit(readings: Mapping[str, Floats]) -> Floats:
    """Readings (units, v, 3) in the order of the units' names."""
    return np.stack([readings[unit] for unit in sorted(readings)])
