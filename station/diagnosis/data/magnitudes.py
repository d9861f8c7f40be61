"""Where nobody knows how the part was held: the direction of the stimulus at each visit, from the reading itself.

With the calibration at hand a reading gives a vector; its direction is taken for the true one, its length is the
datum. Two of a visit's three numbers are spent that way, and the one left is |M⁻¹(y − b)| − |stimulus|: the norm fit.
"""

from dataclasses import replace

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Array, Floats
from station.domain.recognition.ellipsoid import axis_parallel
from station.model.forward import BaseResponse
from station.model.scene import Scene, Signal

#: Directions are found when they no longer move by more than this, rad.
CONVERGED_RAD = 1e-9


def initial_base(mean: Floats, unit: Array, units: int, magnitude: float) -> BaseResponse:
    """Offset and gain of each unit from the axis-parallel ellipsoid through its readings (v, 3).

    Σ A_i y_i² + B_i y_i = 1, linear in A and B; a unit whose readings do not span one gets no offset and one gain.
    """
    offset, matrix = np.zeros((units, 3)), np.tile(np.eye(3), (units, 1, 1))
    for u in range(units):
        y = mean[unit == u]
        size = float(np.sqrt(np.mean(np.sum(y**2, axis=1)))) or 1.0
        found = axis_parallel(y / size)
        middle, radius = (np.zeros(3), np.ones(3)) if found is None else found
        offset[u], matrix[u] = middle * size, np.diag(radius * size / magnitude)
    return BaseResponse(offset, matrix)


def with_directions(scene: Scene, true: Floats) -> Scene:
    """The scene with nests turned so that each part feels a vector (v, 3) of the direction given."""
    visits = scene.visits
    in_nest = np.einsum("vij,vj->vi", visits.seat_R, true)
    turned = rotation.shortest(_unit_vectors(in_nest), _unit_vectors(visits.stimulus))
    return replace(scene, visits=replace(visits, nest_R=turned))


def next_direction(signal: Signal, residual: Floats, base: BaseResponse) -> tuple[Floats, float]:
    """Directions (v, 3) after what the readings differ by (v, 3) is laid to those that the sensors feel now, and the
    largest move, rad."""
    now = signal.at_visit
    lacking = np.linalg.solve(base.matrix[signal.scene.visits.unit.code], residual[..., None])[..., 0]
    found = _unit_vectors(now + lacking)
    return found, float(np.max(np.linalg.norm(found - _unit_vectors(now), axis=1), initial=0.0))


def _unit_vectors(vectors: Floats) -> Floats:
    """Vectors (v, 3) of length one; the third axis for a vector of none."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 1.0]))
