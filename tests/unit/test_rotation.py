"""Rotations against known answers and their algebra."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.core import rotation

coordinate = st.floats(-3, 3, allow_nan=False)
vectors = st.tuples(coordinate, coordinate, coordinate).map(np.array)


def test_a_quarter_turn_about_z_brings_x_to_y() -> None:
    np.testing.assert_allclose(rotation.about(np.array([0, 0, 2]), 90) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_a_quaternion_with_scalar_first_is_the_same_turn() -> None:
    half = np.deg2rad(45)
    R = rotation.from_quaternion(np.array([np.cos(half), 0, 0, np.sin(half)]))
    np.testing.assert_allclose(R, rotation.about(np.array([0, 0, 1]), 90), atol=1e-15)


@pytest.mark.parametrize("axis", [np.eye(3)[i] * s for i in range(3) for s in (1, -1)])
def test_shortest_brings_any_face_up(axis: np.ndarray) -> None:
    R = rotation.shortest(axis, np.array([0, 0, 1.0]))
    np.testing.assert_allclose(R @ axis, [0, 0, 1], atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1)


@pytest.mark.parametrize("opposite", [True, False])
def test_shortest_turns_any_vectors_at_once(opposite: bool) -> None:
    a, b = np.random.default_rng(3).normal(size=(2, 50, 3))
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b))
    b = -a if opposite else b
    R = rotation.shortest(a, b)
    np.testing.assert_allclose(np.einsum("vij,vj->vi", R, a), b, atol=1e-14)
    angle = np.linalg.norm(rotation.to_vector(R), axis=1)
    np.testing.assert_allclose(angle, np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1)), atol=1e-7)


@given(vectors)
def test_a_rotation_vector_gives_a_proper_rotation_that_keeps_its_axis(v: np.ndarray) -> None:
    R = rotation.from_vector(v)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ v, v, atol=1e-12)


@given(vectors.filter(lambda v: np.linalg.norm(v) < 3.1))
def test_to_vector_undoes_from_vector(v: np.ndarray) -> None:
    np.testing.assert_allclose(rotation.to_vector(rotation.from_vector(v)), v, atol=1e-7)


@given(vectors, vectors)
def test_cross_matrix_is_the_cross_product(v: np.ndarray, a: np.ndarray) -> None:
    np.testing.assert_allclose(rotation.cross_matrix(v) @ a, np.cross(v, a), atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, np.pi - 1e-3, np.pi - 1e-7, np.pi - 1e-12, np.pi])
def test_a_rotation_vector_comes_back_up_to_a_half_turn(angle: float) -> None:
    axes = np.random.default_rng(5).normal(size=(50, 3))
    R = rotation.from_vector(angle * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    v = rotation.to_vector(R)
    assert np.allclose(rotation.from_vector(v), R, atol=1e-9)
    assert np.allclose(np.linalg.norm(v, axis=1), angle, atol=1e-8)
