"""Eigenvectors of normal matrices, those of which LAPACK's divide and conquer makes nothing too."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.diagnosis.linear.eigen import eigenvectors, left_singular_vectors, pseudo_inverse

#: A kernel of the pose in two nests, beside offsets and gains: of its 60 columns 12 are rounding.
NORMAL = Path(__file__).parents[1] / "data" / "normal-matrix.npz"


def test_a_matrix_that_divide_and_conquer_gives_up_has_its_eigenvectors() -> None:
    with np.load(NORMAL) as kept:
        normal = np.stack([kept["normal"], np.diag(np.arange(60.0))])
    values, vectors = eigenvectors(normal)
    size = np.abs(normal).max(axis=(1, 2), keepdims=True)
    made = (vectors * values[:, None]) @ vectors.swapaxes(1, 2)
    assert np.all(np.diff(values) >= 0)
    # Sixty products each of rounding, and as much again of the factors themselves.
    rounding = 120 * np.finfo(float).eps
    assert np.all(np.abs(made - normal) < rounding * size)
    assert np.all(np.abs(vectors.swapaxes(1, 2) @ vectors - np.eye(60)) < rounding)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_others_have_those_that_numpy_finds(seed: int, n: int) -> None:
    half = np.random.default_rng(seed).standard_normal((3, 2, n, n))
    normal = half @ half.swapaxes(-1, -2)
    for found, expected in zip(eigenvectors(normal), np.linalg.eigh(normal), strict=True):
        assert np.array_equal(found, expected)


def test_a_matrix_that_divide_and_conquer_gives_up_has_a_pseudo_inverse() -> None:
    """A gyroscope's calibration beside known columns that say the same: the diagnosis ended without a report."""
    with np.load(NORMAL) as kept:
        normal = kept["normal"]
    normal = normal / np.abs(normal).max()
    inverse = pseudo_inverse(normal, 1e-12)
    assert normal @ inverse @ normal == pytest.approx(normal, abs=1e-9)
    assert inverse @ normal @ inverse == pytest.approx(inverse, abs=1e-9 * np.abs(inverse).max())


@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_of_others_it_is_that_of_numpy(seed: int, n: int) -> None:
    half = np.random.default_rng(seed).standard_normal((3, 2, n, max(n - 1, 1)))
    normal = half @ half.swapaxes(-1, -2)
    expected = np.linalg.pinv(normal, 1e-9, hermitian=True)
    np.testing.assert_allclose(pseudo_inverse(normal, 1e-9), expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_columns_that_divide_and_conquer_gives_up_have_their_singular_vectors(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = np.random.default_rng(5).standard_normal((3, 9, 4))
    vectors, values = left_singular_vectors(columns)

    def gives_up(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", gives_up)
    others, again = left_singular_vectors(columns)
    np.testing.assert_allclose(again, values, rtol=1e-12)
    alike = np.abs(np.einsum("umk,umk->uk", vectors, others))
    np.testing.assert_allclose(alike, 1.0, rtol=1e-12)
