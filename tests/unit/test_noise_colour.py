"""Noise as sensors have it, not as a simulation draws it: differenced, slow, shared by axes, with a bumped stop."""

from dataclasses import replace

import numpy as np
import pytest

from station.diagnosis.data.contrast_noise import ContrastNoise, without_bumps
from station.diagnosis.data.reduce import ReducedScene, reduce_samples
from station.diagnosis.data.visit_noise import sample_noise, visit_differences
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search import hidden_state
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.domain.core.types import Floats, SampleTable
from station.model.model_file import Model
from tests.blind.bench import hide
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe, six_faces

RECIPE, UNITS = recipe(), 2
ALLOWED = FloorAllowance.of(RECIPE, Model())


def quiet() -> tuple[SampleTable, int, int]:
    """A table without a cause nearly without noise, its stops, and the samples of each."""
    made, _ = hide(RECIPE, None, 1, units=UNITS)
    stops = int(np.count_nonzero(np.diff(made.visit, prepend=-1)))
    return made, stops, len(made) // stops


def with_noise(noise: Floats) -> ReducedScene:
    """The table reduced, with noise (v, n, 3) ten times its own."""
    made, _, _ = quiet()
    return reduce_samples(RECIPE, replace(made, reading=made.reading + 1e-2 * noise.reshape(-1, 3)))


def beside_expected(found: ReducedScene) -> Floats:
    """Noise of each contrast beside the rms of all axes that it has in truth (B−1, 3), by the readings of many stops:
    next to no calibration is in a contrast."""
    return np.asarray(found.contrast_noise.noise * found.sigma / np.sqrt(np.mean(found.contrast**2, axis=0)))


def test_contrasts_of_white_noise_have_the_noise_of_a_sample(rng: np.random.Generator) -> None:
    _, stops, n = quiet()
    assert with_noise(rng.standard_normal((stops, n, 3))).contrast_noise.noise == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("colour", ["differenced", "slow", "one axis slow"])
def test_contrasts_have_the_noise_that_their_colour_gives_them(colour: str, rng: np.random.Generator) -> None:
    _, stops, n = quiet()
    white = rng.standard_normal((stops, n + 1, 3))
    slow = white[:, 1:] + 0.4 * np.cumsum(rng.standard_normal((stops, n, 3)), axis=1)
    noise = {
        "differenced": np.diff(white, axis=1),
        "slow": slow,
        "one axis slow": np.concatenate([white[:, 1:, :2], slow[..., 2:]], axis=2),
    }[colour]
    found = with_noise(noise)
    # Of 40 free stops an axis' noise is known to 1/√80 = 11 %, and it is drawn in by as much.
    assert beside_expected(found) == pytest.approx(1.0, abs=0.4)
    away = found.contrast_noise.noise[:, 2].max()
    assert away < 0.8 if colour == "differenced" else away > 1.4


def test_an_axis_that_is_slow_in_all_of_its_contrasts_shows_in_six_dwells(rng: np.random.Generator) -> None:
    faces = six_faces("listed")
    made, _ = hide(faces, None, 1, units=1)
    white = rng.standard_normal((6, len(made) // 6, 3))
    white[..., 2] += np.cumsum(rng.standard_normal(white.shape[:2]), axis=1)
    found = reduce_samples(faces, replace(made, reading=made.reading + 1e-2 * white.reshape(-1, 3))).contrast_noise
    # Beside the noise of its samples: of four free dwells no contrast tells by itself, the three of an axis do.
    beside = found.noise / found.noise[:, :2].mean(axis=1, keepdims=True)
    assert np.all(beside[:, 2] > 2.0)
    assert found.axis_error > 0.1


def test_contrasts_of_differenced_noise_have_nothing_in_common_once_scaled(rng: np.random.Generator) -> None:
    _, stops, n = quiet()
    found = with_noise(np.diff(rng.standard_normal((stops, n + 1, 3)), axis=1))
    view = initial_problem(found, ALLOWED).view
    raw, scaled = (
        np.abs(np.corrcoef(x.swapaxes(1, 2).reshape(-1, x.shape[1]).T) - np.eye(x.shape[1])).max()
        for x in (found.contrast, view.layout.scaled(found.contrast[..., None])[..., 0])
    )
    # Of 144 stops and axes a correlation is known to 1/12.
    assert raw > 0.4
    assert scaled < 0.25


def test_the_floor_of_differenced_noise_is_that_of_its_means(rng: np.random.Generator) -> None:
    _, stops, n = quiet()
    found = with_noise(np.diff(rng.standard_normal((stops, n + 1, 3)), axis=1))
    fitted = initial_problem(found, ALLOWED).fit()
    # The sum of differences is one difference: what the bound of the floor leaves is no more than it is.
    assert float(np.sum(fitted.space.residual**2)) / fitted.space.dof > 0.3


def test_null_sets_hold_what_is_not_known_of_the_contrasts_noise(rng: np.random.Generator) -> None:
    known = ContrastNoise(np.ones((3, 3)), None, 0.2, 0.1, 0.15)
    white = rng.standard_normal((2000, 40, 3, 3))
    drawn = known.of_truth(white, rng)
    logs, own = np.log(drawn.std(axis=1)), np.log(white.std(axis=1))
    shared = np.mean(drawn[:, :, 0] * drawn[:, :, 1], axis=(1, 2)) - np.mean(
        white[:, :, 0] * white[:, :, 1], axis=(1, 2)
    )
    # 2,000 sets know a deviation to 1/√4000 of itself.
    assert (logs - own).std(axis=0) == pytest.approx(np.full((3, 3), np.hypot(0.2, 0.1)), rel=0.15)
    assert shared.std() == pytest.approx(0.15, rel=0.2)
    assert ContrastNoise(np.ones((3, 3))).of_truth(white, rng) is white


@pytest.mark.parametrize("cause", ["settling", "filter-lag", "lever-arm"])
def test_what_every_arrival_leaves_is_no_noise(cause: str) -> None:
    loud, _ = hide(RECIPE, KNOWN[cause], 3, units=UNITS, d=60.0)
    assert np.max(np.abs(reduce_samples(RECIPE, loud).contrast_noise.noise - 1)) < 0.3


def test_axes_that_share_noise_are_told_apart_and_others_left_alone(rng: np.random.Generator) -> None:
    _, stops, n = quiet()
    shared = rng.standard_normal((stops, n, 3))
    shared[..., 1] = 0.6 * shared[..., 0] + 0.8 * shared[..., 1]
    view = initial_problem(with_noise(shared), ALLOWED).view
    assert view.reduced.axis_correlation[0, 1] == pytest.approx(0.6, abs=5 / np.sqrt(stops * n))
    rest = np.einsum("vki,vi->vk", view.keep, view.reduced.mean - view.simulated()[0])
    # 44 of 48 stops are free: four standard errors of a correlation of two axes that share nothing.
    assert abs(np.asarray(np.corrcoef(rest.T))[0, 1]) < 4 / np.sqrt(44)
    inside = view.layout.scaled(view.reduced.contrast[..., None])[..., 0].reshape(-1, 3)
    assert abs(np.asarray(np.corrcoef(inside.T))[0, 1]) < 4 / np.sqrt(len(inside))
    alone = initial_problem(with_noise(rng.standard_normal((stops, n, 3))), ALLOWED).view
    assert alone.keeps_axes
    assert alone.keep is alone.own


def test_noise_that_axes_share_from_sample_to_sample_alone_leaves_the_means_apart(rng: np.random.Generator) -> None:
    """A hum that both axes feel averages out: the means say whether they share anything."""
    _, stops, n = quiet()
    both = (-1.0) ** np.arange(n)[:, None] * rng.standard_normal((stops, 1, 1)) * [1.0, 1.0, 0.0]
    reduced = with_noise(rng.standard_normal((stops, n, 3)) + both)
    assert reduced.axis_correlation[0, 1] > 0.3
    assert initial_problem(reduced, ALLOWED).view.keeps_axes


def test_two_axes_of_which_one_is_a_copy_share_nothing_that_could_be_taken_off(rng: np.random.Generator) -> None:
    reading, visit = np.repeat(rng.standard_normal((400, 1)), 3, axis=1), np.repeat(np.arange(20), 20)
    differences = visit_differences(reading, visit, sample_noise(reading, visit))
    assert np.array_equal(differences.correlation(), np.eye(3))


def test_a_sensor_whose_axes_scatter_apart_is_in_no_hidden_state(rng: np.random.Generator) -> None:
    _, stops, n = quiet()
    # Noise of a stop's mean that no sample shows, as large as two of its samples' on one axis.
    drift = 0.5 * rng.standard_normal((stops, 1, 3)) * [1.0, 0.0, 0.0]
    problem = initial_problem(with_noise(rng.standard_normal((stops, n, 3)) + drift), ALLOWED)
    floor = problem.fit().floor
    assert isinstance(floor, NoiseFloor)
    assert not any(found.surprise for found in hidden_state.find_states(problem, floor).values())


def test_one_bumped_stop_is_drawn_in_and_what_many_show_is_not(rng: np.random.Generator) -> None:
    contrast = rng.standard_normal((40, 3, 3))
    contrast[7, 0, 2] = 60.0
    calm = without_bumps(contrast, np.ones(3))
    assert np.abs(calm).max() < 6.0
    assert np.array_equal(np.delete(calm, 7, axis=0), np.delete(contrast, 7, axis=0))
    contrast[::4, 0, 2] = 60.0
    assert without_bumps(contrast, np.ones(3)) is contrast
