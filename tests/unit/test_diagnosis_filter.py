"""Runs of any length are whitened as their whole covariance says, block by block."""

import numpy as np
import pytest

from station.diagnosis.linear import noise_floor as floors
from station.diagnosis.linear.grid import VisitGrid
from station.diagnosis.linear.run_filter import MAX_BLOCK_ROWS, block_visits

UNITS = 2


def structure(visits: int, k: int, rng: np.random.Generator) -> tuple[floors.FloorStructure, np.ndarray]:
    """Two runs a unit, the second one shorter; with the parts (3, m, m) of each run, written out."""
    short = visits - visits // 3
    slot = np.full((UNITS, 2, visits), -1)
    slot[:, 0], slot[0, 1, :short] = np.arange(UNITS * visits).reshape(UNITS, visits), UNITS * visits + np.arange(short)
    n = int(slot.max()) + 1
    # Numbers of few digits: kinds of runs are told apart by seven.
    weight = rng.choice([0.5, 1.0, 2.0], n)
    turn, project = (np.round(rng.standard_normal((n, k, 3)), 3) for _ in range(2))
    steps = np.zeros(n)
    for run in slot.reshape(-1, visits):
        steps[run[run >= 0]] = np.cumsum(rng.integers(1, 4, np.count_nonzero(run >= 0)))
    made = floors.floor_structure(VisitGrid(slot, k), weight, turn, steps, project)
    return made, np.stack([_written_out(run, k, weight, turn, steps, project) for run in slot.reshape(-1, visits)])


def _written_out(
    run: np.ndarray, k: int, weight: np.ndarray, turn: np.ndarray, steps: np.ndarray, project: np.ndarray
) -> np.ndarray:
    """D, T and K (3, m, m) of one run, 0 where there is no visit."""
    on = np.flatnonzero(run >= 0)
    parts = np.zeros((3, len(run), k, len(run), k))
    for i in on:
        parts[0, i, :, i] = np.eye(k) / weight[run[i]]
        parts[1, i, :, i] = turn[run[i]] @ turn[run[i]].T
        for j in on:
            parts[2, i, :, j] = min(steps[run[i]], steps[run[j]]) * project[run[i]] @ project[run[j]].T
    return parts.reshape(3, len(run) * k, len(run) * k)


@pytest.mark.parametrize(("visits", "k"), [(5, 3), (20, 3), (32, 3), (33, 3), (75, 3), (150, 1)])
@pytest.mark.parametrize("variances", [(2.0, 0.0, 0.0), (1.0, 0.7, 0.0), (1.0, 0.7, 0.2), (0.3, 0.0, 4.0)])
def test_a_run_is_whitened_as_its_covariance_says(
    visits: int, k: int, variances: tuple[float, ...], rng: np.random.Generator
) -> None:
    made, parts = structure(visits, k, rng)
    floor = made.covariance(np.array(variances))
    whole = np.einsum("i,rijk->rjk", variances, parts)
    live = floor.live.reshape(len(parts), -1)
    m = visits * k
    rows = rng.standard_normal((UNITS, 2, m, 4)) * live.reshape(UNITS, 2, m, 1)
    white, back, coloured = (
        f(rows).reshape(-1, m, 4) for f in (floor.runs.whiten, floor.runs.transposed, floor.runs.coloured)
    )
    logdet = 0.0
    for r in range(len(parts)):
        L = np.linalg.cholesky(whole[r][np.ix_(live[r], live[r])])
        mine = rows.reshape(-1, m, 4)[r][live[r]]
        assert np.allclose(white[r][live[r]], np.linalg.solve(L, mine), atol=1e-9)
        assert np.allclose(back[r][live[r]], np.linalg.solve(L.T, mine), atol=1e-9)
        assert np.allclose(coloured[r][live[r]], L @ mine, atol=1e-9)
        logdet += 2 * float(np.log(np.diag(L)).sum())
    assert floor.logdet == pytest.approx(logdet, rel=1e-10)


@pytest.mark.parametrize(("visits", "k"), [(5, 3), (75, 3), (150, 1)])
@pytest.mark.parametrize("variances", [(1.0, 0.7, 0.0), (1.0, 0.7, 0.2)])
def test_parts_and_traces_are_those_of_the_matrices(
    visits: int, k: int, variances: tuple[float, ...], rng: np.random.Generator
) -> None:
    made, parts = structure(visits, k, rng)
    floor = made.covariance(np.array(variances))
    whole = np.einsum("i,rijk->rjk", variances, parts)
    live = floor.live.reshape(len(parts), -1)
    rows = rng.standard_normal((UNITS, 2, visits * k, 4)) * live.reshape(UNITS, 2, -1, 1)
    acted, traces = made.times(rows), made.traces(floor.runs)[made.member].reshape(-1, 3)
    walked = np.zeros(4)
    for r in range(len(parts)):
        mine = rows.reshape(len(parts), -1, 4)[r]
        assert np.allclose(acted.reshape(len(parts), -1, 3, 4)[r], np.einsum("ijk,kc->jic", parts[r], mine), atol=1e-9)
        at = np.ix_(live[r], live[r])
        inverse = np.linalg.inv(whole[r][at]) if live[r].any() else np.zeros((0, 0))
        assert np.allclose(traces[r], [np.trace(inverse @ part[at]) for part in parts[r]], rtol=1e-8, atol=1e-8)
        walked += np.einsum("kc,kj,jc->c", mine, parts[r, 2], mine)
    assert np.allclose(made.walked(rows, slice(None)), walked, rtol=1e-9)


def test_a_block_is_never_larger_than_its_limit() -> None:
    for k in (1, 3):
        for visits in (1, 24, 32, 33, 96, 97, 720, 5000):
            blocks, size = block_visits(visits, k)
            assert size * k <= MAX_BLOCK_ROWS
            assert blocks * size >= visits > (blocks - 1) * size
