"""What leaves each of very many visits free is left out before its matrix is diagonalised."""

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.candidates.free_visits import MOST_FREE_VISITS, says_nothing
from station.diagnosis.candidates.kernels import kernel_candidates
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.domain.core.types import Labels, SampleTable
from station.model.model_file import Model

RECIPE = load_recipe("hand-held")


def view_of(visits: int, positions: int) -> ResidualView:
    """Single readings of a hand-held part, at so many named positions by turns."""
    rng = np.random.default_rng(1)
    a = rng.standard_normal((visits, 3))
    reading = a / np.linalg.norm(a, axis=1, keepdims=True) + 3e-4 * rng.standard_normal(a.shape)
    at, nothing = np.arange(visits, dtype=np.int32), np.zeros(visits, np.int32)
    position = Labels(tuple(f"hand-{i}" for i in range(positions)), at % positions)
    time_s = np.linspace(0.0, 2.0 * visits, visits)
    table = SampleTable(Labels(("A",), nothing), nothing, at, position, time_s, reading)
    return initial_problem(reduce_samples(RECIPE, table), FloorAllowance.of(RECIPE, Model())).view


@pytest.mark.parametrize(
    ("visits", "positions", "out"),
    [(MOST_FREE_VISITS + 40, MOST_FREE_VISITS + 40, {"position", "order"}), (MOST_FREE_VISITS + 40, 20, set()),
     (40, 40, set())],
)  # fmt: skip
def test_only_what_frees_each_of_many_visits_is_left_out(visits: int, positions: int, out: set[str]) -> None:
    view = view_of(visits, positions)
    assert {c.name for c in kernel_candidates(view) if says_nothing(c, view)} == out


def test_every_kernel_of_the_position_before_goes_where_each_visit_has_its_own() -> None:
    """The first two visits have no position before the last one: a group of two lengths is as free as one of one."""
    view = view_of(MOST_FREE_VISITS + 40, MOST_FREE_VISITS + 40)
    assert all(says_nothing(c, view) for c in kernel_candidates(view) if c.of == "previous")
