"""Rotations as 3×3 matrices and rotation vectors (rad), vectorised over leading axes."""

import numpy as np

from station.domain.core.types import Array


def from_vector(rotvec_rad: Array) -> Array:
    """Rotation matrices (…, 3, 3) of rotation vectors (…, 3) in rad, right-handed (Rodrigues)."""
    v = np.asarray(rotvec_rad, float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    K = cross_matrix(v)
    # sinc forms stay exact down to angle 0, where the axis is undefined.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * K + second * (K @ K))


def cross_matrix(v: Array) -> Array:
    """Skew matrices (…, 3, 3) with cross_matrix(v) @ a == v × a."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def from_quaternion(q: Array) -> Array:
    """Rotation matrix of a quaternion, scalar first; it is normalised."""
    w, x, y, z = np.asarray(q, float) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def about(axis: Array, angle_deg: float) -> Array:
    """Rotation matrix about an axis (any length but zero) by an angle in degrees."""
    a = np.asarray(axis, float)
    return from_vector(a / np.linalg.norm(a) * np.deg2rad(angle_deg))


def shortest(a: Array, b: Array) -> Array:
    """The shortest rotations (…, 3, 3) of unit vectors a into b (…, 3); opposite ones turn about an axis across."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    axis = (cross_matrix(a) @ b[..., None])[..., 0]
    sine, cosine = np.linalg.norm(axis, axis=-1, keepdims=True), np.sum(a * b, axis=-1, keepdims=True)
    apart = sine >= 1e-12
    turn = np.where(apart, axis / np.where(apart, sine, 1.0) * np.arctan2(sine, cosine), 0.0)
    return from_vector(np.where(~apart & (cosine < 0), np.pi * _across(a), turn))


def _across(a: Array) -> Array:
    """Unit vectors (…, 3) across others. Any will do; x for ±z, y for ±x, z for ±y keeps it predictable."""
    following = np.eye(3)[(np.argmax(np.abs(a), axis=-1) + 1) % 3]
    found = following - np.sum(following * a, axis=-1, keepdims=True) * a
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def to_vector(R: Array) -> Array:
    """Rotation vectors (…, 3) in rad of rotation matrices (…, 3, 3), angle up to π; at π either sign may come."""
    R = np.asarray(R, float)
    w = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1) / 2
    sine = np.linalg.norm(w, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    scale = np.where(sine > 1e-12, angle / np.where(sine > 1e-12, sine, 1.0), 1.0)
    # Near a half turn the skew part vanishes; there the symmetric part, 2·a·aᵀ − 1, holds the axis.
    return np.asarray(np.where((angle > np.pi - 1e-6)[..., None], angle[..., None] * _axis(R, w), w * scale[..., None]))


def _axis(R: Array, w: Array) -> Array:
    outer = (R + np.swapaxes(R, -1, -2)) / 4 + np.eye(3) / 2
    column = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    axis = np.take_along_axis(outer, column[..., None, None], axis=-1)[..., 0]
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return np.asarray(axis * np.where(np.sum(axis * w, axis=-1, keepdims=True) < 0, -1.0, 1.0))
