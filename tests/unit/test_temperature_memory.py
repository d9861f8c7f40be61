"""What lags behind the temperature, and what is on another branch while it rises."""

import numpy as np
import pytest

from station.diagnosis.candidates.temperature_memory import TemperatureMemory

TIME_S = np.arange(400.0)
BOTH = (slice(0, 200), slice(200, 400))


def memory(temperature_degC: np.ndarray) -> TemperatureMemory:
    return TemperatureMemory(temperature_degC, TIME_S, BOTH)


def test_behind_a_steady_ramp_a_lag_is_its_time_constant_late() -> None:
    ramp = 0.02 * TIME_S
    lagged = memory(ramp).lagged(0.1)
    assert lagged[0] == ramp[0]
    assert ramp[199] - lagged[199] == pytest.approx(0.02 * 0.1 * 199, rel=1e-3)


def test_a_lag_and_a_play_begin_anew_with_each_run() -> None:
    course = np.concatenate([np.zeros(200), np.full(200, 9.0)]) + np.tile(np.linspace(0.0, 1.0, 200), 2)
    found = memory(course)
    for values in (found.temperature_degC - found.lagged(0.3), found.branch(0.5)):
        assert np.allclose(values[:200], values[200:])


def test_the_branch_changes_once_the_temperature_has_turned_by_the_play() -> None:
    course = np.tile(np.concatenate([np.linspace(0.0, 4.0, 100), np.linspace(4.0, 0.0, 100)]), 2)
    found = memory(course)
    branch = found.branch(0.25, start=1.0)
    assert found.range_degC == 4.0
    assert np.allclose(branch[:100], 1.0)
    turned = np.flatnonzero(branch[100:200] <= -1.0 + 1e-9)[0]
    assert course[100 + turned] == pytest.approx(4.0 - 1.0, abs=0.05)
    assert np.allclose(branch[100 + turned : 200], -1.0)


def test_a_relay_stays_on_between_its_limits_and_off_where_it_came_from_below() -> None:
    course = np.tile(np.concatenate([np.linspace(0.0, 4.0, 100), np.linspace(4.0, 0.0, 100)]), 2)
    relay = memory(course).relay(1.0, 3.0)
    rises = np.tile(np.arange(200) < 100, 2)
    assert np.array_equal(relay == 1.0, np.where(rises, course > 3.0, course > 1.0))
    # A run that begins between them begins on the side of the nearer one.
    assert memory(np.full(400, 2.5)).relay(1.0, 3.0).all()
    assert not memory(np.full(400, 1.5)).relay(1.0, 3.0).any()
