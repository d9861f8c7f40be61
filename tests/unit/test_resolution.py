"""Steps in readings are recognised, and what they leave in a mean is known."""

import numpy as np
import pytest

from station.domain.core.types import Floats
from station.domain.noise import dwell_statistics, resolution


def dwells(x: Floats) -> dwell_statistics.DwellStatistics:
    v, n, _ = x.shape
    return dwell_statistics.measure(x.reshape(-1, 3), np.arange(v) * n, np.full(v, n), np.zeros(v, np.int64))


def test_the_step_is_found_in_the_data(rng: np.random.Generator) -> None:
    x = np.round(0.02 * rng.standard_normal((6, 80, 3)) / 0.0127) * 0.0127
    assert resolution.step_of(dwells(x), 0.0) == pytest.approx([0.0127] * 3)


def test_readings_of_full_precision_have_none(rng: np.random.Generator) -> None:
    assert resolution.step_of(dwells(rng.standard_normal((6, 80, 3))), 0.5).tolist() == [0, 0, 0]


def test_readings_that_never_change_take_the_sheets(rng: np.random.Generator) -> None:
    assert resolution.step_of(dwells(np.full((3, 20, 3), 0.0127)), 0.0127).tolist() == [0.0127] * 3


def test_steps_in_finer_frames_are_the_sheets(rng: np.random.Generator) -> None:
    """A converter of 12.7 mg in frames of 0.0625 mg: levels 203 or 204 of these apart, so that none is seen."""
    x = np.round(np.linspace(-1, 1, 6)[:, None, None] / 0.0127 + 0.3 * rng.standard_normal((6, 80, 3))) * 0.0127
    found = dwells(np.round(x / 6.25e-5) * 6.25e-5)
    seen = resolution.step_of(found, 0.0127)
    assert seen.tolist() == [0, 0, 0]
    assert resolution.stated_step(found, seen, 0.0127).tolist() == [0.0127] * 3
    assert resolution.stated_step(found, seen, 0.02).tolist() == [0, 0, 0], "readings changed by less"
    assert resolution.stated_step(dwells(rng.standard_normal((6, 80, 3))), seen, 0.0127).tolist() == [0, 0, 0]


def test_single_readings_show_a_step_only_on_a_grid(rng: np.random.Generator) -> None:
    """The nearest two of a list of poses are no step of its sensor."""
    poses = rng.standard_normal((40, 1, 3))
    assert resolution.step_of(dwells(poses), 0.0).tolist() == [0, 0, 0]
    assert resolution.step_of(dwells(np.round(poses / 0.03125) * 0.03125), 0.0) == pytest.approx([0.03125] * 3)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.2, 0.3, 0.5])
def test_what_rounding_leaves_in_a_mean(rng: np.random.Generator, share: float) -> None:
    """Against the definition: mean square error of rounded Gaussian readings over all places within a step."""
    place = np.linspace(0, 1, 401)[:-1]
    edge = np.arange(-6, 7) + 0.5
    from scipy.special import ndtr

    below = ndtr((edge[:, None] - place) / max(share, 1e-9))
    mean = 7 - below.sum(axis=0)
    expected = ((mean - place) ** 2).mean()
    found = resolution.rounding_variance(np.array(1.0), np.array(share))
    assert float(found) == pytest.approx(expected, rel=0.02, abs=1e-9)


def test_without_noise_a_twelfth_of_a_step_squared() -> None:
    assert float(resolution.rounding_variance(np.array(0.3), np.array(0.0))) == pytest.approx(0.09 / 12, rel=1e-9)
    assert float(resolution.rounding_variance(np.array(0.0), np.array(0.1))) == 0


def test_means_of_undithered_readings_are_covered(rng: np.random.Generator) -> None:
    """Noise of a tenth of a step cannot be averaged away: the rounding must stand in the uncertainty."""
    true = rng.uniform(0, 1, (2000, 1, 3))
    x = np.round(true + 0.1 * rng.standard_normal((2000, 60, 3)))
    found = dwells(x)
    noise = resolution.noise_under(np.ones(3), found.std)
    std = np.sqrt(found.variance + resolution.rounding_variance(np.ones(3), noise))
    off = np.abs(found.mean - true[:, 0])
    assert (off < 1.96 * std).mean() > 0.94
    assert (off < 1.96 * found.std / np.sqrt(60)).mean() < 0.5


def test_an_axis_whose_visits_lie_on_edges_is_not_taken_for_noisier(rng: np.random.Generator) -> None:
    """Noise of a tenth of a step everywhere; z lies within a tenth of an edge at every visit, x and y anywhere."""
    true = rng.uniform(0, 1, (18, 1, 3)) + 7
    true[..., 2] = 0.5 + 0.1 * rng.uniform(-1, 1, (18, 1))
    found = dwells(np.round(true + 0.1 * rng.standard_normal((18, 60, 3))))
    alone = resolution.noise_under(np.ones(3), np.repeat(found.std[:, 2:], 3, axis=1))[2]
    noise = resolution.noise_under(np.ones(3), found.std)
    assert alone > 0.25 and noise[2] == pytest.approx(1.2 * noise[:2].max()) and noise[2] < 0.2
    quiet = resolution.noise_under(np.ones(3), found.std * [0, 0, 1])
    assert quiet == pytest.approx([0, 0, alone]), "axes that never change say nothing of one that does"


def test_few_dwells_at_one_place_do_not_dither_the_others_away(rng: np.random.Generator) -> None:
    """Noise of a tenth of a step; of six dwells four lie at one place, two anywhere: square errors of these are as
    large as the rounding that is counted, in the mean. Dwell by dwell it is too small where the four lie on an edge.
    """
    counted, one_by_one = [], []
    for _ in range(400):
        true = rng.uniform(0, 1, (6, 1, 3)) + 7
        true[:4] = true[:1]
        found = dwells(np.round(true + 0.1 * rng.standard_normal((6, 60, 3))))
        square = (found.mean - true[:, 0])[4:] ** 2
        left = resolution.rounding_variance(np.ones(3), resolution.noise_under(np.ones(3), found.std))
        of_few = resolution.rounding_of_few(np.ones(3), found)
        counted.append(square / np.where(of_few > 0, of_few, left))
        one_by_one.append(square / left)
    assert 0.8 < np.mean(counted) < 1.5
    assert np.mean(one_by_one) > 1.9


def test_rounding_of_few_says_nothing_where_dwells_tell_all(rng: np.random.Generator) -> None:
    true = rng.uniform(0, 1, (6, 1, 3))
    still = dwells(np.round(true) + np.array([0.0, 0.0, 1.0]) * (np.arange(60) % 2)[:, None])
    assert resolution.rounding_of_few(np.ones(3), still)[:2].tolist() == [0, 0], "they keep what they have"
    assert resolution.rounding_of_few(np.zeros(3), still).tolist() == [0, 0, 0]
    assert not resolution.rounding_of_few(np.ones(3), dwells(rng.standard_normal((6, 60, 3)))).any()
