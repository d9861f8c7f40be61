"""The axes' own errors from the readings of many units: zeros, scales, non-orthogonality, wobble of the encoders.

A unit's own matrix and offset are free, so whatever a unit could do by itself is not laid to the axes:
m = M_u · g(angles; errors) + o_u. What remains is common to all units. Gauss–Newton: with M near 1 the errors act
linearly, J · errors, and the twelve coefficients of each unit are projected out (Golub and Pereyra 2003, variable
projection).

The diagnosis names such errors position by position (`index-error`) or as `base-tilt`; here they are those of two axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.rig.commissioning import TIMES_STD, with_axes
from station.domain.rig.kinematics import VERTICAL
from station.domain.rig.rig_map import RigMap

#: Directions of errors that change the readings less than this, relative to the strongest, cannot be told apart.
_SINGULAR = 1e-6
_ROUNDS = 4
#: What is worth a correction: an error that moves a place of the axis by so much, degrees.
WORTH_DEG = 0.01
#: A place half a turn away, by which an error of scale is judged, degrees.
_HALF_TURN_DEG = 180.0


@dataclass(frozen=True, slots=True)
class AxisError:
    """One error of an axis. kind: zero, scale, square, sine or cosine; value and std in degrees (scale: 1); interval:
    half its 95 % interval; None: these positions cannot show it."""

    axis: str
    kind: str
    value: float | None
    std: float | None
    interval: float | None


@dataclass(frozen=True, slots=True, eq=False)
class UnitOnAxes:
    """One unit's visits: angles_deg (v, axes) as the encoders read, readings (v, 3) means in g, seats (v, 3, 3)
    device → nest."""

    angles_deg: Floats
    readings: Floats
    seats: Floats


@dataclass(frozen=True, slots=True)
class AxisErrors:
    """Every error; residual_g: what is left of a reading; dof: readings less everything that was estimated."""

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


def estimate_axis_errors(rig: RigMap, units: Sequence[UnitOnAxes]) -> AxisErrors:
    """Errors of the axes, from one unit at least.

    Standard deviations hold for whatever of the errors these visits can show; the others are None.
    """
    kinds = kinds_of(rig)
    errors = np.zeros(len(kinds))
    for _ in range(_ROUNDS):
        step, shown, covariance = _solve(*_projected(rig, units, errors))
        errors = errors + step
    _, left = _projected(rig, units, errors)
    dof = len(left) - 12 * len(units) - int(shown.sum())
    variance = float(left @ left) / max(dof, 1)
    std = np.sqrt(np.diag(covariance) * variance)
    factor = float(scipy.special.stdtrit(max(dof, 1), 0.975))
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


def worth_telling(error: AxisError) -> bool:
    """Whether it is far beyond its uncertainty, and moves a place within half a turn by `WORTH_DEG` or more."""
    moved_deg = abs(_significant(error)) * (_HALF_TURN_DEG if error.kind == "scale" else 1.0)
    return moved_deg >= WORTH_DEG


def _significant(error: AxisError) -> float:
    """Nine errors are judged at once: an interval of 95 % would find one by chance in every third rig."""
    if error.value is None or error.std is None or abs(error.value) <= TIMES_STD * error.std:
        return 0.0
    return error.value


def _normal(rig: RigMap) -> Floats:
    """Direction about which the inner axis leans towards the outer one."""
    outer, inner = rig.directions
    normal = np.cross(outer, inner)
    return np.asarray(normal / np.linalg.norm(normal))


def _projected(rig: RigMap, units: Sequence[UnitOnAxes], errors: Floats) -> tuple[Floats, Floats]:
    """Derivatives (units · v · 3, errors) and residuals, both without what the units' own coefficients explain."""
    blocks, left = [], []
    for unit in units:
        own = np.column_stack([felt(rig, unit.angles_deg, errors, unit.seats), np.ones(len(unit.readings))])
        Q, _ = np.linalg.qr(own)
        slopes = np.stack([_slope(rig, unit, errors, i) for i in range(len(errors))], axis=-1)
        M = np.linalg.lstsq(own, unit.readings, rcond=None)[0][:3].T
        J = np.einsum("ij,vjk->vik", M, slopes)
        J = J - np.einsum("vq,qik->vik", Q, np.einsum("vq,vik->qik", Q, J))
        blocks.append(J.reshape(-1, len(errors)))
        left.append((unit.readings - Q @ (Q.T @ unit.readings)).ravel())
    return np.vstack(blocks), np.concatenate(left)


def _slope(rig: RigMap, unit: UnitOnAxes, errors: Floats, index: int) -> Floats:
    step = np.zeros(len(errors))
    step[index] = 1e-4
    ahead, behind = (felt(rig, unit.angles_deg, errors + way * step, unit.seats) for way in (1, -1))
    return np.asarray((ahead - behind) / 2e-4)


def _solve(design: Floats, left: Floats) -> tuple[Floats, Floats, Floats]:
    """Least squares over what the design shows; which errors that is (bool), and (JᵀJ)⁻¹."""
    length = np.linalg.norm(design, axis=0)
    visible = length > _SINGULAR * length.max()
    size = np.where(visible, length, 1.0)
    U, s, Vt = np.linalg.svd(np.where(visible, design / size, 0.0), full_matrices=False)
    keep = s > _SINGULAR * s[0]
    inverse = Vt[keep].T / s[keep]
    hidden = (Vt[~keep] ** 2).sum(axis=0) if (~keep).any() else np.zeros(len(size))
    shown = visible & (hidden < 1e-3)
    step = np.where(shown, inverse @ (U[:, keep].T @ left) / size, 0.0)
    return step, shown, (inverse @ inverse.T) / np.outer(size, size)
