"""Stamps and temperatures that a line or a thermometer corrupted are what their neighbours say, and others stay."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.recognition import corrupt_columns

VISITS, SAMPLES, PERIOD_S = 8, 50, 0.02
VISIT = np.repeat(np.arange(VISITS), SAMPLES)
RUN = VISIT // (VISITS // 2)
#: Each run begins at 0, and a pose changes for 3 s between two visits.
TIME_S = np.arange(VISITS * SAMPLES) % (VISITS // 2 * SAMPLES) * PERIOD_S + VISIT % (VISITS // 2) * 3.0


@given(
    row=st.integers(1, VISITS * SAMPLES - 5),
    length=st.integers(1, 3),
    stamp=st.sampled_from([-5.0, 60.0, 1e9, 1.7e18, -1e300]),
)
def test_an_outlying_stamp_keeps_the_pace_of_its_visit(row: int, length: int, stamp: float) -> None:
    rows = np.arange(row, row + length)
    if len(set(RUN[[row - 1, *rows, rows[-1] + 1]])) > 1:
        return  # what stands at the beginning or end of a run has no neighbour on one side
    corrupt = np.array(TIME_S)
    corrupt[rows] = stamp
    assert corrupt_columns.repaired_stamps(corrupt, VISIT, RUN) == pytest.approx(TIME_S, abs=1e-9)


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_late_frames_and_clocks_that_begin_again_keep_their_stamps(late_s: float, rng: np.random.Generator) -> None:
    time_s = TIME_S + late_s * (rng.random(len(TIME_S)) < 0.02)
    assert corrupt_columns.repaired_stamps(time_s, VISIT, RUN) is time_s
    each_from_zero = np.tile(np.arange(SAMPLES) * PERIOD_S, VISITS)
    assert corrupt_columns.repaired_stamps(each_from_zero, VISIT, RUN) is each_from_zero


def course() -> np.ndarray:
    return np.asarray(21.0 + 4 * (1 - np.exp(-TIME_S / 8)) + 10 * RUN)


@pytest.mark.parametrize("code", [np.nan, -127.0, 85.0, 0.0, 1e9, -np.inf])
@pytest.mark.parametrize("rows", [[0, 1, 2, 3, 4], [100], [30, 77, 78, 79, 301, 399]])
def test_a_thermometer_that_fails_reads_what_it_did_before_and_after(code: float, rows: list[int]) -> None:
    corrupt = course()
    corrupt[rows] = code
    found = corrupt_columns.repaired_temperatures(corrupt, TIME_S, VISIT, RUN)
    assert np.flatnonzero(found != corrupt).tolist() == rows
    # Between visits, and before the first reading, a course of .5 °C a second is a straight line to .06 °C.
    assert found == pytest.approx(course(), abs=0.06)


def test_what_a_chamber_does_stays() -> None:
    ramp = 20.0 + 40.0 * (VISIT % 2) + 0.1 * TIME_S  # 40 °C from one visit to the next, and back
    np.testing.assert_array_equal(corrupt_columns.repaired_temperatures(ramp, TIME_S, VISIT, RUN), ramp)


def test_a_run_whose_temperature_is_mostly_missing_stays_unknown() -> None:
    gaps = course()
    gaps[RUN == 1] = np.where(np.arange(np.count_nonzero(RUN == 1)) % 2 == 0, np.nan, gaps[RUN == 1])
    found = corrupt_columns.repaired_temperatures(gaps, TIME_S, VISIT, RUN)
    np.testing.assert_array_equal(found, gaps)
    assert np.isnan(found).any()
