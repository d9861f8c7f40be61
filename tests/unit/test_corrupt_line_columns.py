"""Counters, drives and clocks of the line with a value missing or corrupt are what their neighbours say."""

import numpy as np
import pytest

from station.domain.core.types import Floats
from station.domain.recognition import corrupt_line_columns

VISITS, SAMPLES = 8, 50
VISIT = np.repeat(np.arange(VISITS), SAMPLES)
RUN = VISIT // 4
TIME_S = np.arange(VISITS * SAMPLES) * 0.02 + 3.0 * VISIT
#: 200 frames pass while a pose changes.
COUNTER = np.asarray((np.arange(VISITS * SAMPLES) + 200 * VISIT) % 16, float)
ROWS = [60, 130, 301]


def corrupt(column: Floats, value: float) -> Floats:
    out = np.array(column)
    out[ROWS] = value
    return out


@pytest.mark.parametrize("off", [3.0, 7.0, 9.0, np.nan])
def test_a_count_between_two_that_follow_each_other_is_theirs(off: float) -> None:
    wrong = np.array(COUNTER)
    wrong[ROWS] = (wrong[ROWS] + off) % 16
    np.testing.assert_array_equal(corrupt_line_columns.counts(wrong, VISIT, 16), COUNTER)


def test_lost_doubled_and_swapped_frames_keep_their_counts() -> None:
    lost = np.delete(COUNTER, 60)
    doubled = np.insert(COUNTER, 61, COUNTER[60])
    swapped = np.array(COUNTER)
    swapped[[60, 61]] = swapped[[61, 60]]
    stale = np.array(COUNTER)
    stale[60] = stale[59]
    for counter in (lost, doubled, swapped, stale):
        visit = np.arange(len(counter)) // SAMPLES
        assert corrupt_line_columns.counts(counter, visit, 16) is counter


def test_a_counter_of_another_size_is_no_glitch() -> None:
    wide = np.arange(400.0)
    assert corrupt_line_columns.counts(wide, VISIT, 16) is wide


@pytest.mark.parametrize("value", [np.nan, 255.0])
def test_a_drive_is_as_before(value: float) -> None:
    motor = np.asarray(VISIT % 3 == 0, float)
    np.testing.assert_array_equal(corrupt_line_columns.drives(corrupt(motor, value), VISIT, RUN), motor)
    pulsed = np.asarray(np.arange(len(VISIT)) % 2, float)
    assert corrupt_line_columns.drives(pulsed, VISIT, RUN) is pulsed


@pytest.mark.parametrize("value", [np.nan, 1e12, -5.0])
def test_a_run_starts_once(value: float) -> None:
    started = np.asarray(500.0 * RUN, float)
    np.testing.assert_array_equal(corrupt_line_columns.starts(corrupt(started, value), RUN), started)
    # A column that never says one number twice is no start, and nobody knows which of them would be.
    np.testing.assert_array_equal(corrupt_line_columns.starts(TIME_S, RUN), TIME_S)


@pytest.mark.parametrize("value", [np.nan, 1e9, -1e6])
def test_times_elapsed_go_on_with_the_stamps(value: float) -> None:
    since = TIME_S + 300.0
    assert corrupt_line_columns.elapsed(corrupt(since, value), TIME_S, VISIT, RUN) == pytest.approx(since)
    clamped_anew = TIME_S - np.repeat(TIME_S[::SAMPLES], SAMPLES)
    assert corrupt_line_columns.elapsed(clamped_anew, TIME_S, VISIT, RUN) is clamped_anew


def test_what_is_mostly_missing_stays_so() -> None:
    gaps = np.where(np.arange(len(VISIT)) % 2 == 0, np.nan, 1.0)
    assert np.isnan(corrupt_line_columns.drives(gaps, VISIT, RUN)).any()
    assert np.isnan(corrupt_line_columns.elapsed(gaps, TIME_S, VISIT, RUN)).any()
