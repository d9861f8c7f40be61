"""Single readings far off their neighbours: each is found wherever it stands, and nothing else is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.core.types import Floats
from station.domain.recognition.outliers import replace_outliers
from station.domain.recognition.sheet import step_of

NOISE, SAMPLES = 0.001, 60


def at_rest(seed: int, visits: int = 6) -> Floats:
    rng = np.random.default_rng(seed)
    pose = np.vstack([np.eye(3), -np.eye(3)])[:visits]
    return np.asarray(np.repeat(pose, SAMPLES, axis=0) + NOISE * rng.standard_normal((visits * SAMPLES, 3)))


def visits_of(reading: Floats) -> tuple[np.ndarray, np.ndarray]:
    begin = np.arange(0, len(reading), SAMPLES)
    return begin, begin + SAMPLES


@given(
    row=st.integers(0, 6 * SAMPLES - 1),
    length=st.integers(1, 3),
    axis=st.integers(0, 2),
    size=st.sampled_from([0.05, -0.5, 16.0, -1e9, 1e30]),
    seed=st.integers(0, 99),
)
def test_outlying_readings_become_what_their_neighbours_read(
    row: int, length: int, axis: int, size: float, seed: int
) -> None:
    reading = at_rest(seed)
    corrupt = np.array(reading)
    rows = np.arange(row, min(row + length, (row // SAMPLES + 1) * SAMPLES))
    corrupt[rows, axis] += size
    found, off = replace_outliers(corrupt, *visits_of(corrupt), 1.0)
    assert np.flatnonzero(off).tolist() == rows.tolist()
    # A median of twelve scatters by .36 of one reading, and the reading replaced by one: six deviations of both.
    assert np.abs(found - reading).max() < 6 * NOISE * np.hypot(1, 0.5)
    assert off[rows] == pytest.approx(abs(size), abs=6 * NOISE)


@pytest.mark.parametrize("effect", ["none", "tone", "shift", "ramp", "shaking", "coarse"])
def test_nothing_else_is_outlying(effect: str) -> None:
    reading = at_rest(3)
    sample = np.arange(len(reading))[:, None]
    if effect == "tone":  # alternates from one reading to the next: the fastest that samples show
        reading = reading + 0.2 * (-1.0) ** sample
    if effect == "shift":  # a pose changes within a visit
        reading = reading + 0.5 * (sample > 90)
    if effect == "ramp":
        reading = reading + 0.05 * (sample % SAMPLES)
    if effect == "shaking":
        reading = reading + 0.4 * np.random.default_rng(4).standard_t(3, reading.shape) * (sample > 200)
    if effect == "coarse":
        reading = np.round(reading + 0.02 * np.random.default_rng(5).standard_normal(reading.shape), 1)
    found, off = replace_outliers(reading, *visits_of(reading), 1.0)
    assert not off.any()
    assert found is reading or np.array_equal(found, reading)


def test_what_stands_in_its_place_is_on_the_grid_of_the_output() -> None:
    """Twelve neighbours on two levels have their median between them, where the output has no step."""
    reading = np.array([[0.0, 0.0, 1.0], [0.004, 0.004, 1.0]] * 30)
    reading[31] += 2.0
    found, off = replace_outliers(reading, np.array([0]), np.array([60]), 1.0)
    assert np.flatnonzero(off).tolist() == [31]
    assert np.unique(found[:, 0]).tolist() == [0.0, 0.004]


def test_a_visit_of_which_much_is_outlying_is_left_as_it_is() -> None:
    reading = at_rest(6)
    reading[10:58:8, 0] += 3.0  # six of sixty
    reading[100, 1] += 3.0
    _, off = replace_outliers(reading, *visits_of(reading), 1.0)
    assert np.flatnonzero(off).tolist() == [100]


def test_an_outlier_hides_no_step() -> None:
    column = np.round(np.random.default_rng(7).normal(0, 0.01, 500) / 0.004) * 0.004
    column[100] = 1e30
    assert step_of(column) == pytest.approx(0.004)
