"""The Earth and gravity go round a turning table: known physics at an unknown angle, and no cause."""

from dataclasses import replace

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.candidates.going_round import going_round_columns
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import ResidualView, initial_view
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.blocks import DwellRule
from station.domain.recipe.recipe import Recipe
from station.model.simulate import SimulationJob, simulate
from tests.blind.inspection import searched

#: The Earth's level rate at 48 degrees north, deg/s.
LEVEL = 0.00279


def spins(dwell_s: float, density: float = 0.0005) -> Recipe:
    """Six spins at 100 deg/s of a quiet gyroscope, its steps far below its noise."""
    recipe = load_recipe("gyroscope-six-point")
    sheet = recipe.device.model_copy(update={"noise_density": density, "lsb": 1e-5})
    return recipe.model_copy(update={"dwell": DwellRule(time_s=dwell_s), "device": sheet})


def going_round(table: SampleTable, pull: Floats, seed: int) -> Floats:
    """What each reading of spins about x, y and z gains (n, 3): a level vector that the turning device sees turn back,
    from an angle of its own at each visit, and on each axis pull (3) of another."""
    rng = np.random.default_rng(seed)
    added = np.zeros((len(table.time_s), 3))
    begins = np.flatnonzero(np.r_[True, np.diff(table.visit) != 0])
    for first, last in zip(begins, [*begins[1:], len(added)], strict=True):
        name = table.position.names[table.position.code[first]]
        axis, sense = "xyz".index(name[5]), 1 if name.endswith("fwd") else -1
        angle = rng.uniform(0, 2 * np.pi) + np.deg2rad(100) * table.time_s[first:last]
        added[first:last, (axis + 1) % 3] = LEVEL * np.cos(angle)
        added[first:last, (axis + 2) % 3] = -sense * LEVEL * np.sin(angle)
        added[first:last] += np.cos(angle)[:, None] * pull
    return added


@pytest.mark.parametrize("dwell_s", [3.6, 1.8, 0.9])
def test_the_earth_over_whole_half_and_quarter_turns_is_no_cause(dwell_s: float) -> None:
    recipe = spins(dwell_s)
    table = simulate(SimulationJob(recipe, ("A", "B"), seed=5)).table
    turned = replace(table, reading=table.reading + going_round(table, np.zeros(3), seed=2))
    found = searched(recipe, turned)
    assert [f.name for f in found.findings] == []


def left_of(view: ResidualView, added: SampleTable) -> float:
    """The share of what was added to the samples that no column takes, of means and contrasts."""
    table_only = reduce_samples(view.scene.recipe, added)
    rows = view.rows(table_only.mean[..., None], table_only.contrast[..., None])
    found = going_round_columns(view)
    assert found is not None and found.columns.dwell is not None and rows.dwell is not None
    columns = found.columns
    left = total = 0.0
    for u in range(len(rows.visit)):
        C = np.concatenate([columns.visit[u].reshape(-1, columns.visit.shape[-1]), found.columns.dwell[u]])
        r = np.concatenate([rows.visit[u].ravel(), rows.dwell[u].ravel()])
        rest = r - C @ np.linalg.lstsq(C, r, rcond=1e-9)[0]
        left, total = left + float(rest @ rest), total + float(r @ r)
    return float(np.sqrt(left / total))


@pytest.mark.parametrize("level", [False, True])
def test_columns_follow_what_goes_round_in_either_sense(level: bool) -> None:
    """About an upright axis a vector of the Earth's, about a level one what each axis feels of gravity, too."""
    recipe = spins(1.8)
    if level:
        lying = tuple(
            p.model_copy(update={"up": {"x": "+y", "y": "+z", "z": "+x"}[p.name[5]]}) for p in recipe.positions
        )
        recipe = recipe.model_copy(update={"positions": lying})
    table = simulate(SimulationJob(recipe, ("A",), seed=5)).table
    pull = np.array([0.01, -0.02, 0.015]) * level
    only = replace(table, reading=going_round(table, pull, seed=2))
    assert left_of(initial_view(reduce_samples(recipe, table)), only) < 0.01


def test_where_the_noise_hides_it_there_are_no_columns() -> None:
    recipe = spins(3.6, density=0.1)
    table = simulate(SimulationJob(recipe, ("A",), seed=5)).table
    assert going_round_columns(initial_view(reduce_samples(recipe, table))) is None
