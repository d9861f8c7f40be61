"""Stacks of small matrices, of which one that is singular must not stop the others: it becomes NaN."""

from contextlib import suppress

import numpy as np

from station.domain.core.types import Array, Floats


def solve(A: Array, B: Array) -> Floats:
    """A⁻¹B for stacks A (…, k, k) and B (…, k, m) that broadcast; NaN where A is singular or not finite."""
    try:
        return np.asarray(np.linalg.solve(A, B))
    except np.linalg.LinAlgError:
        return _one_by_one(A, B)


def _one_by_one(A: Array, B: Array) -> Floats:
    shape = np.broadcast_shapes(A.shape[:-2], B.shape[:-2])
    A = np.broadcast_to(A, shape + A.shape[-2:])
    B = np.broadcast_to(B, shape + B.shape[-2:])
    out = np.full(B.shape, np.nan)
    for at in np.ndindex(shape):
        with suppress(np.linalg.LinAlgError):
            out[at] = np.linalg.solve(A[at], B[at])
    return out


def inverse(A: Array) -> Floats:
    """A⁻¹ for a stack (…, k, k); NaN where A is singular."""
    return solve(A, np.broadcast_to(np.eye(A.shape[-1]), A.shape))


def nearest_rotation(B: Array) -> Floats:
    """The rotations (u, 3, 3) nearest to B (u, 3, 3), by singular values (Markley 1988); NaN where B is not finite."""
    sound = np.asarray(np.isfinite(B).all(axis=(1, 2)))
    U, _, Vt = np.linalg.svd(np.where(sound[:, None, None], B, np.eye(3)))
    U[:, :, 2] *= (np.linalg.det(U) * np.linalg.det(Vt))[:, None]
    return np.where(sound[:, None, None], U @ Vt, np.nan)
