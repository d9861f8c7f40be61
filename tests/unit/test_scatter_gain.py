"""The gain of a variance on visits that are predicted from the others."""

import numpy as np

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.rank import with_free_variance
from station.diagnosis.search.scatter_gain import predicted_visits, scatter_gain
from station.diagnosis.search.scoring import ScoringProblem
from tests.blind.bench import Floor, hide
from tests.blind.recipes import six_faces

SEED = 11
FACES = six_faces("listed", "reversed")


def _problem(floor: Floor, seed: int = SEED, units: int = 1) -> ScoringProblem:
    table, _ = hide(FACES, None, seed, units=units, floor=floor)
    return initial_problem(reduce_samples(FACES, table), FloorAllowance())


def test_each_visit_is_predicted_as_by_a_fit_to_all_others() -> None:
    """Against generalised least squares on the other visits, by dense matrices: no visit knows of another."""
    problem = _problem(Floor(turn=1e-3))
    variances = np.array([2e-4, 1e-3, 0.0]) ** 2
    found = predicted_visits(problem, variances, 1)
    _, R, m, _ = problem.known.own.visit.shape
    root = problem.structure.covariance(variances).runs.coloured(np.eye(R * m).reshape(1, R, m, R * m))
    V = root.reshape(R * m, -1) @ root.reshape(R * m, -1).T
    X, y = problem.known.own.visit.reshape(R * m, -1), problem.readings(moving=False)[0].visit.ravel()
    for visit, (told, squares) in enumerate(zip(found.told.ravel(), found.squares.ravel(), strict=True)):
        own = np.arange(R * m) // 3 == visit
        weighted = X[~own].T @ np.linalg.inv(V[np.ix_(~own, ~own)])
        spread = np.linalg.inv(weighted @ X[~own])
        off = y[own] - X[own] @ spread @ weighted @ y[~own]
        assert told == 3
        assert np.isclose(squares, off @ np.linalg.solve(V[np.ix_(own, own)] + X[own] @ spread @ X[own].T, off))


def test_scatter_pays_where_it_is_and_not_where_it_is_not() -> None:
    scattered = with_free_variance(_problem(Floor(turn=1e-3), units=2), "repeatability")
    healthy = with_free_variance(_problem(Floor(), units=2), "repeatability")
    upper = _problem(Floor()).upper
    assert scatter_gain(scattered, "repeatability", upper, 0.0).accepted
    assert not scatter_gain(healthy, "repeatability", upper, 0.0).accepted
