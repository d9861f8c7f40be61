"""The rotation between found and nominal directions (Wahba 1965; SVD solution, Markley 1988), and its derivative."""

import numpy as np

from station.domain.core.linear_algebra import nearest_rotation, solve
from station.domain.core.types import Floats


def align(found: Floats, nominal: Floats, keep: Floats) -> Floats:
    """Rotations Q (u, 3, 3) with found (u, v, 3) ≈ Q · nominal (u, v, 3), unit vectors; keep (u, v) 0 or 1."""
    return nearest_rotation((found * keep[..., None]).transpose(0, 2, 1) @ nominal)


def rotation_derivative(Q: Floats, nominal: Floats, keep: Floats) -> tuple[Floats, Floats]:
    """How Q turns when found directions move: rotation vector = Σ_v T_v · δfound_v, T (u, 3, v, 3); and Q·nominal.

    From Σ keep (Q·nominal × δfound) = Σ keep (1 − d dᵀ) φ, to first order in the misfit.
    """
    d = nominal @ Q.transpose(0, 2, 1)
    S = np.einsum("uv,ij->uij", keep, np.eye(3)) - (d * keep[..., None]).transpose(0, 2, 1) @ d
    cross = np.cross(d[:, :, None, :], np.eye(3), axis=-1).transpose(0, 1, 3, 2) * keep[..., None, None]
    u, v = keep.shape
    return solve(S, cross.transpose(0, 2, 1, 3).reshape(u, 3, 3 * v)).reshape(u, 3, v, 3), d
