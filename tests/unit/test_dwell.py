"""Means of dwells, their standard errors: honest for white and correlated noise, robust, the same alone as together."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.signal import lfilter

from station.domain.core.types import Floats
from station.domain.noise import dwell_statistics, noise
from station.domain.noise.dwell_statistics import DwellStatistics


def measured(x: Floats) -> DwellStatistics:
    """Dwells of readings (units, visits, n, 3)."""
    u, v, n, _ = x.shape
    at = np.arange(u * v) * n
    return dwell_statistics.measure(x.reshape(-1, 3), at, np.full(u * v, n), np.repeat(np.arange(u), v))


def first_order(rng: np.random.Generator, phi: float, shape: tuple[int, ...]) -> Floats:
    e = rng.standard_normal((*shape[:2], shape[2] + 100, 3))
    return np.asarray(lfilter([np.sqrt(1 - phi**2)], [1, -phi], e, axis=2)[:, :, 100:])


def boxcar(rng: np.random.Generator, width: int, shape: tuple[int, ...]) -> Floats:
    e = rng.standard_normal((*shape[:2], shape[2] + width, 3))
    return np.asarray(lfilter(np.ones(width) / np.sqrt(width), [1], e, axis=2)[:, :, width:])


@pytest.mark.parametrize("phi", [0.0, 0.3, 0.6, 0.9])
@pytest.mark.parametrize(("visits", "n"), [(6, 100), (12, 60), (6, 300)])
def test_95_percent_of_means_lie_within_196_standard_errors(
    rng: np.random.Generator, phi: float, visits: int, n: int
) -> None:
    x = first_order(rng, phi, (400, visits, n))
    found = measured(x)
    share = (np.abs(found.mean) < 1.96 * np.sqrt(found.variance)).mean()
    # Dwells of a unit share one estimate; 0.94–0.96 ± 3 standard errors of 1,200 independent ones.
    assert 0.94 - 0.019 < share < 0.96 + 0.019


def test_a_filter_that_averages_neighbours_is_seen(rng: np.random.Generator) -> None:
    found = measured(boxcar(rng, 4, (300, 6, 120)))
    share = (np.abs(found.mean) < 1.96 * np.sqrt(found.variance)).mean()
    assert 0.92 < share < 0.98


def test_sigma_over_root_n_would_have_been_wrong(rng: np.random.Generator) -> None:
    found = measured(first_order(rng, 0.9, (200, 6, 100)))
    naive = found.std / np.sqrt(100)
    assert (np.abs(found.mean) < 1.96 * naive).mean() < 0.6


def test_alone_or_together_the_same_bits(rng: np.random.Generator) -> None:
    x = first_order(rng, 0.5, (7, 5, 40))
    together = measured(x)
    for u in range(7):
        alone = measured(x[u : u + 1])
        rows = slice(5 * u, 5 * u + 5)
        for name in ("mean", "std", "variance", "dof", "correlation", "drift_z"):
            assert np.array_equal(getattr(alone, name), getattr(together, name)[rows]), name


def test_portions_of_dwells_give_the_same_bits(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    x = first_order(rng, 0.5, (7, 5, 300))
    whole = measured(x)
    for together in (1, 700, 1 << 20):
        monkeypatch.setattr(dwell_statistics, "CHUNK_READINGS", together)
        found = measured(x)
        for field in fields(whole):
            assert np.array_equal(getattr(found, field.name), getattr(whole, field.name)), field.name


def test_dwells_of_different_length_in_one_unit(rng: np.random.Generator) -> None:
    lengths = np.tile([20, 100, 400, 100], 40)
    x = rng.standard_normal((int(lengths.sum()), 3))
    found = dwell_statistics.measure(x, np.r_[0, np.cumsum(lengths)[:-1]], lengths, np.repeat(np.arange(40), 4))
    by_length = np.median((found.variance * lengths[:, None]).reshape(40, 4, 3), axis=(0, 2))
    # 1, and the widening for being an estimate.
    assert by_length == pytest.approx(np.full(4, 1.07), rel=0.15)


def test_spikes_are_left_out_and_counted(rng: np.random.Generator) -> None:
    x = rng.standard_normal((1, 6, 100, 3))
    clean = measured(x)
    x[0, 2, 10:14, 1] += 1000.0
    found = measured(x)
    assert found.rejected.tolist() == [0, 0, 4, 0, 0, 0]
    assert np.abs(found.mean[2] - clean.mean[2]).max() < 4 * 3 / 96


def test_gaussian_readings_are_hardly_ever_left_out(rng: np.random.Generator) -> None:
    assert measured(rng.standard_normal((200, 6, 100, 3))).rejected.sum() <= 3


@pytest.mark.parametrize("noise_steps", [0.2, 0.35, 0.5, 0.6, 0.74, 1.0])
def test_coarse_readings_are_left_out_no_more_than_fine_ones(rng: np.random.Generator, noise_steps: float) -> None:
    """Half of them may read the same, so that their median deviation is nothing; a spike of twenty steps still is one,
    in dwells that have another step to tell it by."""
    lsb = 1e-3
    x = rng.uniform(-1, 1, (200, 6, 1, 3)) + noise_steps * lsb * rng.standard_normal((200, 6, 100, 3))
    x = lsb * np.round(x / lsb)
    clean = measured(x)
    assert not clean.rejected.any()
    x[:, :, 50, 1] += 20 * lsb
    assert (measured(x).rejected == 1)[clean.std[:, 1] > 0.15 * lsb].all()


def test_a_noisier_dwell_has_a_variance_of_its_own(rng: np.random.Generator) -> None:
    x = rng.standard_normal((40, 8, 100, 3))
    x[:, 3] *= 10
    variance = np.median(measured(x).variance.reshape(40, 8, 3), axis=(0, 2))
    # The widening adds some percent, more where a dwell is judged alone.
    assert variance == pytest.approx(np.where(np.arange(8) == 3, 1.1, 0.0105), rel=0.15)


def test_a_drift_shows_in_its_sign_and_size(rng: np.random.Generator) -> None:
    x = 0.1 * rng.standard_normal((1, 6, 100, 3))
    x[0, 4, :, 2] += np.linspace(0, 2, 100)
    found = measured(x)
    assert found.drift[4, 2] == pytest.approx(-1.0, abs=0.1)
    assert found.drift_z[4, 2] < -6
    assert np.abs(np.delete(found.drift_z, 4, axis=0)).max() < 5


def test_readings_that_never_change_have_no_noise() -> None:
    found = measured(np.full((1, 3, 50, 3), 0.25))
    assert (found.variance < 1e-200).all()
    assert np.isinf(found.step).all()
    assert np.array_equal(found.mean, np.full((3, 3), 0.25))


def test_a_single_reading_is_a_dwell_too() -> None:
    found = measured(np.arange(6.0).reshape(1, 2, 1, 3))
    assert np.array_equal(found.mean, np.arange(6.0).reshape(2, 3))
    assert np.isfinite(found.variance).all()


def test_correlated_axes_are_seen_and_independent_ones_are_not(rng: np.random.Generator) -> None:
    x = rng.standard_normal((1, 6, 200, 3))
    x[..., 1] = 0.8 * x[..., 0] + 0.6 * x[..., 1]
    found = measured(x).correlation[0]
    assert found[0, 1] == pytest.approx(0.8, abs=0.05)
    assert found[0, 2] == 0 and found[2, 2] == 1


def test_the_whole_family_has_positive_spectra() -> None:
    for blocks, width, reach in ((3, 1, 8), (100, 1, 128), (128, 8, 1024)):
        found = noise.family(blocks, width, reach)
        assert (found.inverse[1:] > 0).all()
        assert (found.mean_variance > 0).all()
        assert np.exp(found.log_prior).sum() == pytest.approx(
            1 + noise.MIXED + noise.FLICKER + noise.TWO_POLE + noise.BOXCAR
        )


def test_expected_squares_are_those_of_the_transform(rng: np.random.Generator) -> None:
    """White noise of variance 1 has expected squares of 1 for every coefficient, its mean a variance of 1/n."""
    found = noise.family(64, 1, 64)
    white = int(np.argmin(np.abs(found.mean_variance * 64 - 1)))
    assert 1 / found.inverse[1:, white] == pytest.approx(np.ones(63), abs=0.05)
    assert found.transform @ found.transform.T == pytest.approx(np.eye(64), abs=1e-12)


def test_widening_is_the_ratio_of_quantiles() -> None:
    assert noise.widening(np.array([5.0])) == pytest.approx([(2.5705818 / 1.9599640) ** 2], rel=1e-6)
    assert noise.widening(np.array([1e7])) == pytest.approx([1.0], rel=1e-5)
