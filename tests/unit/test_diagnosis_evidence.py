"""Evidence against plain linear algebra on dense matrices."""

import numpy as np
import pytest

from station.diagnosis.evidence import RATIOS, Sets, spectrum
from station.diagnosis.space import Covariance, Known, Rows, Space, space
from station.domain.types import Floats

U, M = 3, 20


def a_space(rng: np.random.Generator, shared: int) -> Space:
    """White rows of three units with one known column each, and some known ones in common."""
    covariance = Covariance(np.eye(M)[None], np.zeros((U, 1), np.intp), np.ones((U, M), bool), 0.0)
    own, common = rng.standard_normal((U, 1, M, 1)), rng.standard_normal((U, 1, M, shared))
    known = Known(Rows(own), np.zeros((U, 1)), np.zeros((U, 1)), Rows(common), np.zeros(shared), np.zeros(shared))
    return space(covariance, known, Rows(rng.standard_normal((U, 1, M, 1))), U * M)


def random_columns(seen: Space, rng: np.random.Generator, count: int) -> Floats:
    """Columns of a cause as the space sees them."""
    return seen.see(Rows(rng.standard_normal((U, 1, M, count))))


def dense(seen: Space, Z: Floats) -> Floats:
    """L(ρ) with everything written out: known columns projected out, V = I + ρ Z Zᵀ."""
    rows = seen.data.shape[1]
    own = np.zeros((U * rows, U))
    for u in range(U):
        own[u * rows : (u + 1) * rows, u] = seen.basis[u, :, 0]
    X = np.concatenate([own, seen.border.reshape(U * rows, -1)], axis=1)
    y = seen.data.reshape(-1)
    rho = RATIOS / spectrum_mean(seen, Z)
    found = []
    for r in (0.0, *rho):
        V = np.eye(len(y)) + r * Z @ Z.T
        inverse = np.linalg.inv(V)
        normal = X.T @ inverse @ X
        left = y - X @ np.linalg.solve(normal, X.T @ inverse @ y)
        rest = float(left @ inverse @ left)
        found.append(-0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(normal)[1] + seen.dof * np.log(rest)))
    return np.array(found[1:]) - found[0]


def spectrum_mean(seen: Space, Z: Floats) -> float:
    """The mean eigenvalue by which the bank scales amplitudes; own causes are scaled before shared ones are known."""
    if Z.shape[1] == 2:
        P = seen.border.reshape(len(Z), -1)
        Z = Z - P @ np.linalg.lstsq(P, Z, rcond=None)[0] if P.shape[1] else Z
    return float(np.linalg.eigvalsh(Z.T @ Z).mean())


@pytest.mark.parametrize("shared", [0, 2])
@pytest.mark.parametrize("pattern", ["own", "shared"])
def test_the_likelihood_is_that_of_dense_matrices(pattern: str, shared: int) -> None:
    rng = np.random.default_rng(shared + 10)
    seen = a_space(rng, shared)
    columns = random_columns(seen, rng, 2)
    found, turned = spectrum(seen, columns, 1, pattern)  # type: ignore[arg-type]
    sets = Sets.of(seen, seen.data[None])
    u = found.components(np.einsum("umk,num->nuk", turned, sets.data), sets)
    Z = columns.reshape(-1, 2)
    if pattern == "own":
        rows = columns.shape[1]
        Z = np.zeros((U * rows, 2 * U))
        for k in range(U):
            Z[k * rows : (k + 1) * rows, 2 * k : 2 * k + 2] = columns[k]
    assert found.likelihood(u, sets)[0] == pytest.approx(dense(seen, Z), abs=1e-6)


def test_evidence_favours_the_true_cause_and_not_noise() -> None:
    rng = np.random.default_rng(3)
    seen = a_space(rng, 0)
    right, wrong = (random_columns(seen, rng, 1) for _ in range(2))
    data = seen.data + 8 * (right / np.linalg.norm(right, axis=1, keepdims=True))[..., 0]
    sets = Sets.of(seen, data[None])
    scores = []
    for columns in (right, wrong):
        found, turned = spectrum(seen, columns, 1, "own")
        scores.append(
            float(found.evidence(found.components(np.einsum("umk,num->nuk", turned, sets.data), sets), sets)[0])
        )
    assert scores[0] > 8
    assert scores[1] < 2


def test_an_amplitude_beyond_what_is_thinkable_is_no_evidence() -> None:
    rng = np.random.default_rng(4)
    seen = a_space(rng, 0)
    faint = 1e-6 * random_columns(seen, rng, 1)
    data = seen.data + 2e6 * faint[..., 0]
    sets = Sets.of(seen, data[None])
    for most, low, high in ((np.inf, 5.0, np.inf), (1.0, -1.0, 0.1)):
        found, turned = spectrum(seen, faint, 1, "own", most)
        score = float(found.evidence(found.components(np.einsum("umk,num->nuk", turned, sets.data), sets), sets)[0])
        assert low < score < high
