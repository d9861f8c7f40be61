"""Designs of positions and their recipes, by formulas that share nothing with the product's."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.recipe.recipe import Recipe

Floats = NDArray[np.float64]
READINGS, NOISE = 60, 4e-4
MEAN_NOISE = NOISE / READINGS**0.5
DEG = np.pi / 180
FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
EDGES = np.array(
    [(a, b, 0) for a in (1, -1) for b in (1, -1)]
    + [(a, 0, b) for a in (1, -1) for b in (1, -1)]
    + [(0, a, b) for a in (1, -1) for b in (1, -1)],
    float,
)
UPS = {"six": FACES, "n18": np.vstack([FACES, EDGES / 2**0.5]), "one": FACES[4:5], "three": FACES[::2]}
METHODS = {"six": "six-point", "n18": "n-point", "norm": "norm", "one": "one-point", "three": "three-point"}
EXACT = {"magnitude_std": 0, "nest_std_deg": 0, "base_std_deg": 0}


def orientation(up: Floats) -> Floats:
    """Device → station rotation with the device's axis `up` upright: Rodrigues' formula, the shortest way."""
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), float(up @ z)
    if np.linalg.norm(axis) < 1e-9:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return spun(axis / np.linalg.norm(axis) * np.arccos(np.clip(cosine, -1, 1)))


def spun(vector: Floats) -> Floats:
    """Rotation matrices (…, 3, 3) of rotation vectors (…, 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    K = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2)
    a = np.maximum(angle, 1e-12)
    return np.asarray(np.eye(3) + np.sin(a) / a * K + (1 - np.cos(a)) / a**2 * K @ K)


def recipe(design: str, reference: dict[str, Any] | None = None, **more: Any) -> Recipe:
    """A recipe of that design, its errors stated as nothing but for what is given."""
    poses = [orientation(up) for up in UPS["n18" if design == "norm" else design]]
    return Recipe.model_validate(
        {
            "schema": "station.recipe/1", "name": design, "version": 1, "sensor": "accelerometer", "unit": "g",
            "reference": {"source": "gravity", "magnitude": 1.0, **EXACT, **(reference or {})},
            "positions": [{"name": f"p{i:02d}", "quaternion": quaternion(R)} for i, R in enumerate(poses)],
            "method": METHODS[design], **more, "device": {"rounding": "nearest", **more.get("device", {})},
        }
    )  # fmt: skip


def quaternion(R: Floats) -> list[float]:
    """Scalar first; half-turns by their axis."""
    w = np.sqrt(max(1 + np.trace(R), 0)) / 2
    if w < 1e-6:
        axis = np.sqrt(np.maximum(np.diagonal(R) + 1, 0) / 2)
        return [0.0, *axis.tolist()]
    return [float(w), *(float(v) for v in (R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / (4 * w))]
