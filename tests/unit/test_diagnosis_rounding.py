"""Means of coarse readings err, and all that lie alike err alike; noise of that size is laid into their samples."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from station.diagnosis.data.faults import inspect
from station.diagnosis.data.faults.rounding import error_of_means
from station.domain.core.types import SampleTable
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


def coarse(step: float, seed: int) -> SampleTable:
    """Six faces in three runs, healthy, in steps."""
    made, _ = hide(FACES, None, seed, units=3)
    return replace(made, reading=np.round(made.reading / step) * step)


def test_fine_readings_stay_as_they_are() -> None:
    made, _ = hide(recipe(1), None, 1, units=2)
    np.testing.assert_array_equal(inspect(recipe(1), made).table.reading, made.reading)


def test_rounding_is_no_cause() -> None:
    assert diagnosis_of(COARSE, coarse(STEP, 2)).verdict == "none"
