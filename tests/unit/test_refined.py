"""The joint fit of calibration and causes where nobody knows the poses."""

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.candidates.solve import whitened
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import with_calibration
from station.diagnosis.search.problem import FloorAllowance, initial_problem, problem_in_view, refined
from station.domain.core.types import Labels, SampleTable
from station.model.forward import BaseResponse
from station.model.model_file import Model

RECIPE = load_recipe("hand-held")


def cap(seed: int) -> SampleTable:
    """Forty readings of a part of one side of an ellipsoid: of a compass beside iron that was turned half round."""
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((40, 3)) + np.array([0.9, 0.0, 0.4])
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    matrix = np.eye(3) + 0.15 * rng.standard_normal((3, 3))
    reading = np.asarray(a @ matrix.T + 0.5 * rng.standard_normal(3) + 0.01 * rng.standard_normal(a.shape), float)
    at, nothing = np.arange(40, dtype=np.int32), np.zeros(40, np.int32)
    position = Labels(tuple(f"hand-{i}" for i in range(40)), at)
    return SampleTable(Labels(("A",), nothing), nothing, at, position, np.linspace(0.0, 0.4, 40), reading)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("away", [0.3, 0.8])
def test_a_fit_of_magnitudes_never_ends_worse_than_it_began(seed: int, away: float) -> None:
    found = initial_problem(reduce_samples(RECIPE, cap(seed)), FloorAllowance.of(RECIPE, Model()), matrix=True)
    rng = np.random.default_rng(100 + seed)
    base = found.view.base
    moved = BaseResponse(base.offset + away * rng.standard_normal((1, 3)),
                         base.matrix + 0.3 * away * rng.standard_normal((1, 3, 3)))  # fmt: skip
    begun = problem_in_view(found, with_calibration(found.view, moved), ())
    floor = begun.fit().space.covariance
    misfit = [np.sum(whitened(floor, p.known, p.readings(moving=False)[0]).data ** 2) for p in (begun, refined(begun))]
    assert misfit[1] <= misfit[0]
