"""Rates from stamps on a grid: what a rounding puts on a slope, alike in every visit or not."""

import numpy as np
import pytest

from station.diagnosis.data.faults.rounded_stamps import deviation_of_rounding, period_within_rounding, stamp_grid

GRID_S = 1e-3


def _stamps(period: float, begin: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n) of frames of visits that begin at these times, their numbers and their visits."""
    number = np.tile(np.arange(frames), len(begin))
    group = np.repeat(np.arange(len(begin)), frames)
    return begin[group] + number * period, number, group


def _slope(time_s: np.ndarray, number: np.ndarray, group: np.ndarray) -> float:
    """Period by least squares, an offset for each visit."""
    t, k = (x - (np.bincount(group, x) / np.bincount(group))[group] for x in (time_s, number.astype(float)))
    return float(k @ t / (k @ k))


@pytest.mark.parametrize("cut", [np.round, np.floor])
@pytest.mark.parametrize("in_step", [True, False])
def test_a_rate_by_rounded_stamps_is_within_its_interval(cut: object, in_step: bool) -> None:
    rng = np.random.default_rng(5)
    off = []
    for _ in range(60):
        period = 0.01 / (1 + rng.uniform(-0.02, 0.02))
        begin = np.arange(8) + (rng.uniform(0, GRID_S, 1) if in_step else rng.uniform(0, GRID_S, 8))
        time_s, number, group = _stamps(period, begin, 80)
        stamps = GRID_S * cut(time_s / GRID_S)  # type: ignore[operator]
        found = period_within_rounding(stamps, number, group)
        assert found is not None
        off.append(abs(found[0] - period) / found[1])
    # The truth lies within the interval, of which 1.96 deviations are 95 %.
    assert max(off) <= 1.96 / 0.95 + 1e-6
    # Nor is it wider than need be: half of the interval's width is within it.
    assert np.sqrt(np.mean(np.square(off))) > 0.5


def test_a_clock_one_percent_slow_is_not_misled_by_stamps_in_step() -> None:
    time_s, number, group = _stamps(0.01 / 0.99, np.arange(12.0) + 0.3e-3, 100)
    found = period_within_rounding(np.round(time_s, 3), number, group)
    assert found is not None
    assert abs(found[0] - 0.01 / 0.99) < 1.96 * found[1]


@pytest.mark.parametrize("late", [0.1, 0.3])
def test_late_stamps_fit_no_period(late: float) -> None:
    rng = np.random.default_rng(7)
    # One period is one step: every stamp shows the same side of it, but for what is late.
    time_s, number, group = _stamps(0.01 / 1.0007, np.arange(6.0) + 0.2e-3, 100)
    jittered = np.round(time_s + rng.exponential(late * GRID_S, len(time_s)), 3)
    assert period_within_rounding(jittered, number, group) is None


@pytest.mark.parametrize("in_step", [True, False])
def test_what_visits_in_step_share_of_a_rounding_is_known(in_step: bool) -> None:
    rng = np.random.default_rng(9)
    ratio = []
    for _ in range(40):
        period = 0.01 / (1 + rng.uniform(-0.02, 0.02))
        begin = np.arange(8) + (rng.uniform(0, GRID_S, 1) if in_step else rng.uniform(0, GRID_S, 8))
        time_s, number, group = _stamps(period, begin, 80)
        stamps = np.round(time_s, 3)
        found = _slope(stamps, number, group)
        ratio.append((found - period) / max(deviation_of_rounding(stamps, number, group, found), 1e-12) if in_step
                     else deviation_of_rounding(stamps, number, group, found))  # fmt: skip
    if in_step:
        # At the most the worst phase of a saw, √3 of its rms, and the worst of its periods.
        assert np.sqrt(np.mean(np.square(ratio))) < 1
        assert np.max(np.abs(ratio)) < 1.96
    else:
        # Of drawn phases about half show no share at all: 20 ± 3.2.
        assert np.count_nonzero(np.array(ratio) == 0) > 20 - 3 * 3.2


@pytest.mark.parametrize(("step", "grid"), [(1e-3, 1e-3), (1e-2, 1e-2), (1e-4, 1e-4), (7e-4, 1e-4), (1e-6, 0.0)])
def test_the_grid_of_stamps_is_the_coarsest(step: float, grid: float) -> None:
    assert stamp_grid(np.asarray(step * np.arange(1, 500, 7), np.float64)) == grid


def test_nothing_bounds_a_period_of_single_readings() -> None:
    assert period_within_rounding(np.arange(5.0), np.zeros(5, int), np.arange(5)) is None
