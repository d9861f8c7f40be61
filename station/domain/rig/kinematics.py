"""Angles of one or two axes ↔ rotation of the nest, nest → station.

The outer axis stands in the station, the inner one is carried by it: R(a, b) = R(u₁, a) · R(u₂, b), with both
directions given where all angles are zero. Bringing a direction of the nest up is subproblem 2 of Paden and Kahan
(Murray, Li, Sastry 1994, section 3.3.2): w = R(u₁, a)ᵀ z = R(u₂, b) g has two solutions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats

VERTICAL = np.array([0.0, 0.0, 1.0])
#: Directions that lie closer than this (sine) turn about themselves.
_SINGULAR = 1e-9
#: A pose that differs by less counts as reached in full, degrees.
SAME_DEG = 0.01


@dataclass(frozen=True, slots=True)
class Pose:
    """Angles of all axes, degrees; yaw_deg: how far the nest is turned about the vertical against the plan."""

    angles_deg: tuple[float, ...]
    yaw_deg: float


def attitude(axes: Sequence[Floats], angles_deg: Sequence[float]) -> Floats:
    """Nest → station rotation (3, 3) at these angles. axes: unit vectors (3), outer first."""
    R = np.eye(3)
    for axis, angle in zip(axes, angles_deg, strict=True):
        R = R @ rotation.about(axis, angle)
    return R


def attitudes(axes: Sequence[Floats], angles_deg: Floats) -> Floats:
    """Nest → station rotations (n, 3, 3) at many angles (n, axes)."""
    R = np.broadcast_to(np.eye(3), (len(angles_deg), 3, 3))
    for axis, column in zip(axes, np.deg2rad(angles_deg).T, strict=True):
        R = R @ rotation.from_vector(column[:, None] * axis)
    return np.asarray(R)


def poses(axes: Sequence[Floats], nest: Floats, tolerance_deg: float) -> list[Pose]:
    """Angles that bring up what `nest` (nest → station) brings up, within a tolerance; the full attitude first.

    Angles lie within ±180°. Empty where these axes cannot bring that direction up.
    """
    up = nest.T @ VERTICAL
    found = _one_axis(axes[0], nest) if len(axes) == 1 else _two_axes(axes[0], axes[1], up, nest)
    reached = []
    for angles in found:
        R = attitude(axes, angles)
        off = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(R.T @ VERTICAL, up)), (R.T @ VERTICAL) @ up)))
        if off <= tolerance_deg:
            reached.append(Pose(angles, float(np.degrees(np.linalg.norm(rotation.to_vector(R @ nest.T))))))
    return sorted(reached, key=lambda pose: pose.yaw_deg)


def within(pose: Pose, limits_deg: Sequence[tuple[float, float]]) -> list[Pose]:
    """The same pose with whole turns added, wherever all axes stay within their limits."""
    choices = [
        [angle + 360.0 * k for k in range(-4, 5) if low <= angle + 360.0 * k <= high]
        for angle, (low, high) in zip(pose.angles_deg, limits_deg, strict=True)
    ]
    return [Pose(angles, pose.yaw_deg) for angles in product(*choices)]


def _one_axis(axis: Floats, nest: Floats) -> list[tuple[float, ...]]:
    """The angle that comes closest to the attitude, and the one that brings the direction up."""
    return [(_closest(axis, nest),), (_angle(axis, nest.T @ VERTICAL, VERTICAL),)]


def _two_axes(outer: Floats, inner: Floats, up: Floats, nest: Floats) -> list[tuple[float, ...]]:
    """Both solutions; where one axis is parallel to what it would have to turn, its angle follows the attitude."""
    cosine, p, q = float(outer @ inner), float(outer @ VERTICAL), float(inner @ up)
    square = 1.0 - cosine * cosine
    if square < _SINGULAR:
        return []
    alpha, beta = (p - cosine * q) / square, (q - cosine * p) / square
    normal = np.cross(outer, inner)
    rest = (1.0 - alpha * alpha - beta * beta - 2.0 * alpha * beta * cosine) / square
    gamma = float(np.sqrt(max(rest, 0.0)))
    found: list[tuple[float, ...]] = []
    for sign in (1.0, -1.0):
        w = alpha * outer + beta * inner + sign * gamma * normal
        w = w / np.linalg.norm(w)
        if np.linalg.norm(np.cross(inner, up)) < _SINGULAR:
            a = _angle(outer, w, VERTICAL)
            found.append((a, _closest(inner, rotation.about(outer, a).T @ nest)))
        elif np.linalg.norm(np.cross(outer, VERTICAL)) < _SINGULAR:
            b = _angle(inner, up, w)
            found.append((_closest(outer, nest @ rotation.about(inner, b).T), b))
        else:
            found.append((_angle(outer, w, VERTICAL), _angle(inner, up, w)))
    return found


def _angle(axis: Floats, start: Floats, goal: Floats) -> float:
    """Angle about `axis` that turns `start` towards `goal`, degrees within ±180; subproblem 1."""
    a, b = start - axis * (axis @ start), goal - axis * (axis @ goal)
    angle = float(np.degrees(np.arctan2(axis @ np.cross(a, b), a @ b)))
    return 0.0 if abs(angle) < 1e-9 else angle


def _closest(axis: Floats, R: Floats) -> float:
    """Angle about `axis` of the rotation closest to R, degrees: the maximum of trace(R(axis, angle)ᵀ R)."""
    K = rotation.cross_matrix(axis)
    along, across = float(np.trace(K.T @ R)), float(np.trace((np.eye(3) - np.outer(axis, axis)) @ R))
    return float(np.degrees(np.arctan2(along, across)))
