"""Offsets that jump within a short dwell, and what only looks like it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.diagnosis.data import dwell_steps, preflight
from station.diagnosis.data.stays import recut
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.recipe import plan
from tests.blind.recipes import recipe

UNITS, S, NOISE = 3, 50, 7e-4
RECIPE = recipe(1)
ORDER = plan.order_of(RECIPE, 0)
VISITS = UNITS * len(ORDER)
#: Seconds since the dwell began, and what each visit's unit feels.
LATE = np.arange(S)[:, None] / 25.0
FELT = np.tile([p.matrix().T @ [0.0, 0.0, 1.0] for p in ORDER], (UNITS, 1))


def dwells(rng: np.random.Generator) -> Floats:
    """Readings (v, S, 3) in g of three units with an offset and a gain."""
    unit = np.repeat(np.arange(UNITS), len(ORDER))
    offset, gain = 0.02 * rng.standard_normal((UNITS, 3)), 1 + 0.01 * rng.standard_normal((UNITS, 3))
    still = gain[unit] * FELT + offset[unit]
    return np.asarray(still[:, None] + NOISE * rng.standard_normal((VISITS, S, 3)))


def table(reading: Floats) -> SampleTable:
    """The visits, 3.5 s apart."""
    visit = np.tile(np.arange(len(ORDER)), UNITS)
    names = tuple(p.name for p in RECIPE.positions)
    position = np.array([names.index(p.name) for p in ORDER] * UNITS, np.int32)
    return SampleTable(
        unit=Labels(tuple(f"U{u}" for u in range(UNITS)), np.repeat(np.arange(UNITS), len(ORDER) * S).astype(np.int32)),
        run=np.zeros(VISITS * S, np.int32),
        visit=np.repeat(visit, S).astype(np.int32),
        position=Labels(names, np.repeat(position, S)),
        time_s=(3.5 * visit[:, None] + LATE.T).ravel(),
        reading=reading.reshape(-1, 3),
    )


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(2, 21), st.integers(8, S - 8), st.floats(4.0, 20.0))
def test_a_jump_in_a_dwell_ends_the_visit(seed: int, visit: int, row: int, size: float) -> None:
    """size: in noises of a reading, along one axis; of eight readings beside 42 four of them are 10 deviations."""
    y = dwells(np.random.default_rng(seed))
    v = len(ORDER) + visit
    y[v, row:, 1] += size * NOISE
    y[v + 1 : 2 * len(ORDER), :, 1] += size * NOISE
    made = recut(RECIPE, table(y))
    assert made.steps == 1
    begins = np.flatnonzero(np.diff(made.table.visit, prepend=-1))
    assert np.min(np.abs(begins - (v * S + row))) <= 3
    assert len(begins) == VISITS + 1


def arrivals(rng: np.random.Generator) -> dict[str, Floats]:
    """What a dwell may do that is no jump (v, S, 3)."""
    one = np.zeros((VISITS, 1, 1))
    one[30] = 1.0
    step = np.roll(FELT, 1, axis=0) - FELT
    return {
        "nothing": np.zeros((VISITS, S, 3)),
        "heavy": NOISE * rng.standard_t(3, (VISITS, S, 3)),
        "settling": 0.02 * step[:, None] * np.exp(-LATE / 0.3),
        "late arrivals of one axis": 0.02 * step[:, None] * np.array([0, 0, 1.0]) * (LATE < 0.4),
        "bump": 0.01 * one * (LATE > 0.8),
        "bump with a long tail": 0.01 * one * np.exp(-LATE / 0.5),
        "drift": 0.001 * LATE * np.ones(3) * np.ones((VISITS, 1, 1)),
        "wave": 0.003 * np.sin(3 * LATE + 6 * rng.random((VISITS, 1, 1))) * np.ones(3),
    }


@pytest.mark.parametrize("course", list(arrivals(np.random.default_rng(0))))
def test_what_arrives_drifts_or_passes_is_no_jump(course: str) -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        assert recut(RECIPE, table(dwells(rng) + arrivals(rng)[course])).steps == 0


def test_coarse_steps_of_one_median_on_both_sides_are_no_jump() -> None:
    made, (each, step) = table(dwells(np.random.default_rng(0))), (300, 5e-3)
    rows = np.repeat(np.flatnonzero(np.diff(made.visit, prepend=-1)), each)
    place = np.arange(len(rows)) % each
    late = (place > each / 2) & (made.visit[rows] == 7) & (made.unit.code[rows] == 1)
    steps = np.round(made.reading[rows] / step) + (np.where(late, 4, 1) * (place % 3 == 2))[:, None]
    coarse = replace(made[rows], time_s=made.time_s[rows] + place * 1e-4, reading=steps * step)
    begin = np.arange(0, len(rows), each)
    assert dwell_steps.find(RECIPE, coarse, begin, begin + each, np.ones(len(begin), bool)) == []


def test_the_preflight_says_when_it_jumped(rng: np.random.Generator) -> None:
    y = dwells(rng)
    y[30, 20:] += [0.004, 0.0, -0.003]
    y[31 : 2 * len(ORDER)] += [0.004, 0.0, -0.003]
    found, cleaned = preflight.inspect(RECIPE, table(y))
    (said,) = [m for m in found.remarks if m.id == "mean-steps"]
    assert said.parameters["time_s"] == pytest.approx(3.5 * 6 + 20 / 25, abs=0.1)
    assert found.visits == VISITS + 1
    assert len(np.unique(cleaned.visit)) == len(ORDER) + 1
