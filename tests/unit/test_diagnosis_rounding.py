"""Means of coarse readings err, and all that lie alike err alike; noise of that size is laid into their samples."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.diagnosis.data.faults import inspect
from station.diagnosis.data.faults.rounding import error_of_means, noise_below_steps, with_honest_rounding
from station.domain.core.types import Labels, SampleTable
from station.model.timeline import noise_density_of
from tests.blind.bench import hide
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe, six_faces

FACES = six_faces("listed", "reversed", "listed")
STEP = 4 * noise_density_of(FACES) * np.sqrt(FACES.device.rate_hz / 2)
COARSE = FACES.model_copy(update={"device": FACES.device.model_copy(update={"lsb": STEP})})


@settings(max_examples=20)
@given(st.floats(0.1, 0.6), st.integers(0, 2**32 - 1))
def test_means_of_coarse_readings_err_by_what_is_said(ratio: float, seed: int) -> None:
    """noise ÷ step; at 400 places of 400 readings, drawn and as a sum of waves."""
    rng = np.random.default_rng(seed)
    place = rng.random(400)
    mean = np.mean(np.round(place[:, None] + ratio * rng.standard_normal((400, 400))), axis=1)
    # What 400 readings leave of the noise itself.
    drawn = np.mean((mean - place) ** 2) - (ratio**2 + 1 / 12) / 400
    said = float(error_of_means(np.array([1.0]), np.array([ratio]))[0]) ** 2
    # The errors' squares are those of a wave: their mean scatters by 1/√8 of itself for each of √400, noise beside it.
    assert abs(drawn - said) < 5 * (said / np.sqrt(8) + (ratio**2 + 1 / 12) / 400) / np.sqrt(400) * 2 + 1 / 12 / 400


@settings(max_examples=20)
@given(st.floats(0.1, 0.6), st.integers(0, 2**32 - 1))
def test_noise_below_the_steps_shows_in_many_dwells(ratio: float, seed: int) -> None:
    """noise ÷ step; 400 dwells of 100 readings anywhere between two steps."""
    rng = np.random.default_rng(seed)
    within = np.var(np.round(rng.random((400, 1)) + ratio * rng.standard_normal((400, 100))), axis=1, ddof=1)
    off = 5 * np.std(within) / np.sqrt(400)
    least, most = noise_below_steps(within.mean() + np.array([-off, off]), 1.0)
    # The table's waves end at the eighth; between its places a straight line is good to a tenth of their distance.
    assert least - 0.0005 < ratio < most + 0.0005


def test_noise_is_laid_evenly_and_leaves_what_dwells_that_lie_alike_share() -> None:
    """Twelve dwells of ten readings, eight of which lie alike on x, six each on y, and none on z; no noise shows."""
    level = np.stack([np.r_[np.zeros(8), 10.0, 20, 30, 40], np.repeat([5.0, 50], 6), np.arange(12.0)], axis=1)
    visit, one = np.repeat(np.arange(12), 10), Labels(("A",), np.zeros(120, np.int32))
    table = SampleTable(
        unit=one, run=np.zeros(120, np.int32), visit=visit.astype(np.int32), position=one, time_s=np.arange(120.0),
        reading=level[visit],
    )  # fmt: skip
    laid = with_honest_rounding(table, visit, np.ones(1), sheet=0.1).reading.reshape(12, 10, 3).mean(axis=1) - level
    error = float(error_of_means(np.ones(1), np.zeros(1))[0])
    for axis, alike in ((0, slice(0, 8)), (1, slice(0, 6)), (1, slice(6, 12))):
        some = laid[alike, axis]
        assert abs(some.mean()) < 1e-9
        assert np.std(some, ddof=1) == pytest.approx(error * np.sqrt(len(some)))
    assert np.abs(laid[8:, 0]).max() < 1e-9
    assert np.abs(laid[:, 2]).max() < 1e-9


def coarse(step: float, seed: int) -> SampleTable:
    """Six faces in three runs, healthy, in steps."""
    made, _ = hide(FACES, None, seed, units=3)
    return replace(made, reading=np.round(made.reading / step) * step)


def test_fine_readings_stay_as_they_are() -> None:
    made, _ = hide(recipe(1), None, 1, units=2)
    np.testing.assert_array_equal(inspect(recipe(1), made).table.reading, made.reading)


def test_rounding_is_no_cause() -> None:
    assert diagnosis_of(COARSE, coarse(STEP, 2)).verdict == "none"
