"""Offsets that jump while a unit rests, and what only looks like it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.diagnosis.data import preflight
from station.diagnosis.data.stays import recut
from station.domain.capture import mean_steps, rest_segments
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.recipe.recipe import Recipe
from tests.blind.recipes import recipe

RATE_HZ = 50.0
N = 6000


def rest(rng: np.random.Generator, noise: float = 5e-4, rows: int = N) -> Floats:
    """Readings (n, 3) of one pose in g."""
    return np.array([0.01, -0.02, 0.99]) + noise * rng.standard_normal((rows, 3))


@given(st.integers(0, 2**32 - 1), st.integers(1000, 5000), st.floats(2.0, 40.0))
def test_a_step_is_found_where_it_is(seed: int, at: int, size: float) -> None:
    """size: in noises of a reading. A window of 12 readings shows 5.9 of its own deviations for two of them, so that
    longer ones find it: to within the readings in which the noise hides it."""
    rng = np.random.default_rng(seed)
    y = rest(rng)
    y[at:] += size * 5e-4 * np.array([0.8, 0.0, -0.6])
    (row,) = mean_steps.find(y, 1 / RATE_HZ)
    assert abs(row - at) <= 12 + 100 / size**2


def courses(rng: np.random.Generator) -> dict[str, Floats]:
    """What a rest may do without a step of its mean."""
    t = np.arange(N)[:, None] / RATE_HZ
    walk = np.cumsum(rng.standard_normal((N, 3)), axis=0)
    coloured = np.zeros((N, 3))
    kicks = rng.standard_normal((N, 3))
    for i in range(1, N):
        coloured[i] = 0.99 * coloured[i - 1] + kicks[i]
    return {
        "white": np.zeros((N, 3)),
        "heavy": 5e-4 * rng.standard_t(3, (N, 3)),
        "walk": 1e-4 * walk,
        "coloured": 1e-4 * coloured,
        "drift": 1e-4 * t,
        "warm-up": 0.01 * np.exp(-t / 30),
        "settling": 0.02 * np.exp(-t / 2),
        "wave": 5e-3 * np.sin(t),
        "knock": np.where((t > 50) & (t < 51), 0.02, 0.0),
    }


@pytest.mark.parametrize("course", list(courses(np.random.default_rng(0))))
def test_what_drifts_settles_or_passes_is_no_step(course: str) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        assert mean_steps.find(rest(rng) + courses(rng)[course], 1 / RATE_HZ) == []


def test_a_coarse_converter_that_drifts_from_code_to_code_does_not_step(rng: np.random.Generator) -> None:
    y = rest(rng, 2e-5) + np.linspace(0, 4e-3, N)[:, None]
    assert mean_steps.find(np.round(y / 1e-3) * 1e-3, 1 / RATE_HZ) == []


def test_a_rest_ends_where_its_offset_jumps(rng: np.random.Generator) -> None:
    """4 mg: less than a third of a degree of another pose."""
    y = rest(rng)
    y[3333:] += [0.004, 0.0, -0.002]
    (first, second) = rest_segments.find(np.arange(N) / RATE_HZ, y).tolist()
    assert first[1] <= 3333 <= second[0]
    assert second[0] - first[1] < RATE_HZ


def table(reading: Floats, visits: int) -> SampleTable:
    """One unit in one position for N readings, in visits of one length."""
    n = len(reading)
    return SampleTable(
        unit=Labels(("U0",), np.zeros(n, np.int32)),
        run=np.zeros(n, np.int32),
        visit=(np.arange(n) * visits // n).astype(np.int32),
        position=Labels(("z-up",), np.zeros(n, np.int32)),
        time_s=np.arange(n) / RATE_HZ,
        reading=reading,
    )


def one_pose() -> Recipe:
    whole = recipe(1)
    return whole.model_copy(update={"positions": [whole.positions[0].model_copy(update={"name": "z-up"})]})


@pytest.mark.parametrize("visits", [1, 3, 24])
def test_a_stay_is_cut_at_its_step_however_it_came(rng: np.random.Generator, visits: int) -> None:
    y = rest(rng)
    y[3333:] += [0.004, 0.0, -0.002]
    made = recut(one_pose(), table(y, visits))
    assert made.steps == 1
    assert not made.as_it_came
    begins = np.flatnonzero(np.diff(made.table.visit, prepend=-1))
    assert np.any(np.abs(begins - 3333) <= 12)
    assert np.array_equal(made.table.visit, recut(one_pose(), table(y, 1)).table.visit)


def test_the_preflight_says_when_and_by_how_much(rng: np.random.Generator) -> None:
    y = rest(rng)
    y[3333:] += [0.004, 0.0, -0.003]
    whole = recipe(1)
    made = replace(table(y, 1), position=Labels((whole.positions[0].name,), np.zeros(N, np.int32)))
    found, cleaned = preflight.inspect(whole, made)
    (said,) = [m for m in found.remarks if m.id == "mean-steps"]
    assert said.parameters["time_s"] == pytest.approx(3333 / RATE_HZ, abs=0.3)
    assert said.parameters["step"] == pytest.approx(0.005, rel=0.05)
    assert found.visits == 2
    assert len(np.unique(cleaned.visit)) == 2
