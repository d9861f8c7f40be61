"""The noise of each stop beside that of all: nothing where chance explains it, and its size where a stop is noisier."""

import numpy as np
import pytest

from station.diagnosis.data.visit_noise import axis_noise, sample_noise, visit_differences
from station.domain.core.types import Floats

STOPS = 120


def excess(reading: Floats, units: int = 1) -> Floats:
    """Of readings (v, n, 3) of so many units."""
    visit = np.repeat(np.arange(len(reading)), reading.shape[1])
    flat = reading.reshape(-1, 3)
    return visit_differences(flat, visit, sample_noise(flat, visit)).excess_variance(
        np.arange(len(reading)) * units // len(reading)
    )


@pytest.mark.parametrize("samples", [10, 50, 400])
@pytest.mark.parametrize("kind", ["gauss", "t5", "walk", "fine codes", "coarse codes", "axes"])
def test_stops_of_one_noise_have_no_excess(kind: str, samples: int, rng: np.random.Generator) -> None:
    white = rng.standard_normal((STOPS, samples, 3))
    at_rest = rng.normal(0, 50, (STOPS, 1, 3))
    readings = {
        "gauss": white,
        "t5": rng.standard_t(5, white.shape),
        "walk": white + 0.1 * np.cumsum(rng.standard_normal(white.shape), axis=1),
        "fine codes": np.rint(white + at_rest),
        "coarse codes": 3.0 * np.rint((white + at_rest) / 3),
        "axes": white * [1.0, 5.0, 0.2],
    }
    assert np.all(excess(readings[kind]) == 1.0)
    assert np.all(excess(readings[kind], 5) == 1.0)


def noise_of_codes(step: float) -> float:
    """What the middle of the differences of two rounded unit normals comes to, each code spread as far as half way to
    the next: the chance of a code is the normal's density under the triangle of two rounding errors."""
    x, dx = np.linspace(-12, 12, 48_001, retstep=True)
    density = np.exp(-(x**2) / 4) / np.sqrt(4 * np.pi)
    codes = np.arange(int(10 / step) + 2)
    chance = np.array([np.sum(density * np.maximum(1 - np.abs(x / step - k), 0)) * dx for k in codes])
    chance[1:] *= 2
    edges, up_to = np.append(0.0, (codes + 0.5) * step), np.append(0.0, np.cumsum(chance))
    return float(np.interp(0.5 * up_to[-1], up_to, edges) / 0.6745 / np.sqrt(2))


@pytest.mark.parametrize("step", [0.3, 0.6, 0.7, 0.9, 1.1, 1.4, 2.0])
def test_the_noise_of_coarse_codes_is_that_of_what_they_stand_for(step: float, rng: np.random.Generator) -> None:
    reading = step * np.rint((rng.standard_normal((STOPS, 60, 3)) + rng.uniform(0, 9, (STOPS, 1, 3))) / step)
    found = sample_noise(reading.reshape(-1, 3), np.repeat(np.arange(STOPS), 60))
    # Neighbours share a reading: a median of 7,080 differences is known to √(8/7080)/2 = 1.7 %, of which 4.
    assert found == pytest.approx(noise_of_codes(step), rel=0.068)
    # And that is the noise with the converter's own error, step²/12, but for 7 %: a median of codes is 30 % off.
    assert noise_of_codes(step) == pytest.approx(np.sqrt(1 + step**2 / 12), rel=0.07)


def test_an_axis_that_never_scatters_leaves_the_others_their_noise(rng: np.random.Generator) -> None:
    reading = rng.standard_normal((STOPS, 60, 3)) * [1.0, 2.0, 0.0]
    sigma = sample_noise(reading.reshape(-1, 3), np.repeat(np.arange(STOPS), 60))
    rms = np.sqrt(np.mean(sigma[:2] ** 2))
    assert rms * axis_noise(sigma, STOPS * 59)[:2] == pytest.approx([1.0, 2.0], rel=0.06)


@pytest.mark.parametrize("units", [2, 5])
@pytest.mark.parametrize("times", [3.0, 10.0, 30.0])
def test_a_noisy_unit_has_its_noise_and_the_others_theirs(times: float, units: int, rng: np.random.Generator) -> None:
    reading = rng.standard_normal((STOPS, 25, 3))
    noisy = np.arange(STOPS) * units // STOPS == 0
    reading[noisy] *= times
    sigma = sample_noise(reading.reshape(-1, 3), np.repeat(np.arange(STOPS), 25))
    noise = sigma * np.sqrt(excess(reading, units))
    # The middle of 24 logarithms, each known to √(4/24): 5 % of a noise by chance, of which four.
    assert noise[noisy] == pytest.approx(times, rel=0.2)
    assert noise[~noisy] == pytest.approx(1.0, rel=0.2)


def test_a_noisier_stop_stands_out_by_itself_and_a_quieter_one_does_not(rng: np.random.Generator) -> None:
    reading = rng.standard_normal((STOPS, 100, 3))
    reading[7] *= [3.0, 3.0, 1.0]
    reading[9] *= 0.1
    found = excess(reading)
    # The logarithm of a mean of 100 squares of differences has a standard error of √(3/100) = 0.17: four of them.
    assert np.log(found[7, :2]) == pytest.approx(np.log([9.0, 9.0]), abs=0.7)
    found[7, :2] = 1.0
    assert np.all(found == 1.0)


def test_stops_that_differ_altogether_have_each_their_own(rng: np.random.Generator) -> None:
    scale = np.exp(rng.normal(0, 0.5, (STOPS, 3)))
    found = excess(rng.standard_normal((STOPS, 100, 3)) * scale[:, None])
    beside = np.log(found / scale**2)
    assert np.std(beside) < 0.3 < np.std(np.log(scale**2))


def test_a_few_wild_samples_are_no_noise_and_readings_that_never_change_have_none(rng: np.random.Generator) -> None:
    reading = rng.standard_normal((STOPS, 60, 3))
    reading[3, 20] += 40.0
    assert np.all(excess(reading) == 1.0)
    assert np.all(excess(np.zeros((STOPS, 60, 3))) == 1.0)
    assert excess(np.zeros((0, 60, 3))).shape == (0, 3)
