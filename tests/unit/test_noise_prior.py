"""What earlier units tell of the next one's noise: what is learnt, how much it is worth, and who is not fooled."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

from station.domain.core.types import Floats
from station.domain.noise import noise, noise_document, noise_prior
from station.domain.noise.dwell_statistics import measure
from station.domain.noise.noise_prior import (
    AXIS_SPREAD,
    MAX_LENGTH_RATIO,
    UNIT_SPREAD,
    NoiseLikelihood,
    NoisePrior,
    general_log_weights,
    learn_prior,
)
from station.domain.noise.running_noise import DwellNoise, dwell_noise, family_length, likelihoods, noise_curve
from station.errors import LogError

LONGEST, STOPS = 64, 6


def shown(density: Floats, rng: np.random.Generator, phi: float = 0.0, count: int = LONGEST) -> list[DwellNoise]:
    """Dwells of units whose axes have so much long-run variance (u, 3), first-order noise."""
    e = rng.standard_normal((STOPS, len(density), 100 + count, 3))
    x = lfilter([1 - phi], [1, -phi], e, axis=2)[:, :, 100:] * np.sqrt(density)[:, None]
    return [dwell_noise(stop, LONGEST) for stop in x]


def population(
    units: int, rng: np.random.Generator, spread: float = 0.5, own: float = 0.0, phi: float = 0.0
) -> list[NoiseLikelihood]:
    """What ln-normal units have told, with spreads of ln variance between units and between a unit's axes."""
    ln = spread * rng.standard_normal((units, 1)) + own * rng.standard_normal((units, 3))
    return likelihoods(shown(np.exp(ln), rng, phi), LONGEST)


def prior_of(units: int, rng: np.random.Generator, **kind: float) -> NoisePrior:
    found = learn_prior(population(units, rng, **kind), LONGEST)
    assert found is not None
    return found


def test_without_units_there_is_no_prior() -> None:
    assert learn_prior([], LONGEST) is None


def test_units_told_by_another_family_are_passed_over(rng: np.random.Generator) -> None:
    assert learn_prior(population(3, rng), 2 * LONGEST) is None


def test_units_whose_readings_never_change_tell_nothing() -> None:
    still = [dwell_noise(np.zeros((2, LONGEST, 3)), LONGEST) for _ in range(STOPS)]
    assert learn_prior(likelihoods(still, LONGEST), LONGEST) is None


def test_the_spread_of_a_population_is_found(rng: np.random.Generator) -> None:
    """50 units: a variance of ln-normal levels is known to √(2/49) = 20 %; within four of those, and the general
    spread, which counts as 3 of 52 units. Axes' own spread tells apart from the common one."""
    for spread, own in ((0.5, 0.0), (0.1, 0.0), (0.5, 0.5)):
        found = prior_of(50, rng, spread=spread, own=own).covariance * 52 / 51 / 1.02
        general_share = 3 * (UNIT_SPREAD**2 + AXIS_SPREAD**2) / 52
        expected = spread**2 + own**2
        assert np.diag(found).mean() == pytest.approx(
            expected + general_share, abs=4 * expected * np.sqrt(2 / 49) + 0.01
        )
        apart = (np.diag(found).mean() - found[~np.eye(3, dtype=bool)].mean()) - 3 * AXIS_SPREAD**2 / 52
        # Between axes: 100 dof, and what 378 readings do not know of each level, 2/378.
        assert apart == pytest.approx(own**2, abs=4 * (own**2 + 2 / 378) * np.sqrt(2 / 100))


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_the_shape_of_a_kind_is_found(rng: np.random.Generator, phi: float) -> None:
    """30 units of 1134 readings know phi well; the long-run variance on average over the weights is right within a
    step of their grid (12 %), before anything is known it is far off, and the weights are a distribution."""
    found = prior_of(30, rng, phi=phi)
    long_run = noise.family(LONGEST, 1, found.reach).mean_variance * LONGEST
    k = np.arange(1, LONGEST)
    exact = 1 + 2 * ((1 - k / LONGEST) * phi**k).sum()
    assert abs(np.exp(found.log_weight) @ np.log(long_run / exact)) < 0.12
    assert abs(np.exp(general_log_weights(LONGEST)) @ np.log(long_run / exact)) > 0.4
    assert np.exp(found.log_weight).sum() == pytest.approx(1.0, abs=2e-3)


def test_a_prior_worth_nothing_leaves_what_the_unit_tells(rng: np.random.Generator) -> None:
    """With a spread without end and the general weights the posterior is the one without a prior."""
    dwells = shown(np.ones((5, 3)), rng)
    vague = NoisePrior(LONGEST, 10**9, general_log_weights(LONGEST), np.zeros(3), 1e9 * np.eye(3))
    with_it, without = noise_curve(dwells, LONGEST, vague), noise_curve(dwells, LONGEST)
    # A prior of variance 1e9 counts as one reading (dof 1 + 2/∞) of the level expected.
    assert with_it.by_count == pytest.approx(without.by_count, rel=0.02)


def test_a_homogeneous_kind_settles_what_one_short_dwell_leaves_open(rng: np.random.Generator) -> None:
    """The first 16 readings of each of 300 units of one level: ln density scatters by less than a third of what it
    does without a prior."""
    prior = prior_of(50, rng, spread=0.0, phi=0.8)
    first = shown(np.ones((300, 3)), rng, phi=0.8, count=16)[:1]
    known, unknown = (np.log(noise_curve(first, LONGEST, p).at(np.full((300, 1), 64.0))[0]) for p in (prior, None))
    assert known.std() < unknown.std() / 3
    assert np.median(known) == pytest.approx(np.log(1.0), abs=0.15)


def test_the_other_axes_tell_of_an_axis(rng: np.random.Generator) -> None:
    """Three axes that go together are known to √(2/(3·15)) by 16 readings each, not to √(2/15)."""
    prior = prior_of(50, rng, spread=1.0)
    level = np.exp(rng.standard_normal((2000, 1))) * np.ones(3)
    first = shown(level, rng, count=16)[:1]
    known, unknown = (
        np.log(noise_curve(first, LONGEST, p).at(np.full((2000, 1), 16.0))[0][:, 0] / level) for p in (prior, None)
    )
    assert known.std() == pytest.approx(np.sqrt(2 / 45), rel=0.3)
    assert known.std() < 0.75 * unknown.std()


def test_an_outlier_is_known_by_its_own_readings(rng: np.random.Generator) -> None:
    """A hundred times the variance of a homogeneous kind, after a whole calibration: t widens the common variance of
    ln levels to ln²100/53 = 0.4 at least (six dof, among 378), so a tenth of the level is more than it can take."""
    prior = prior_of(50, rng, spread=0.0)
    found = noise_curve(shown(np.full((50, 3), 100.0), rng), LONGEST, prior)
    assert np.median(found.at(np.full((50, 1), 64.0))[0]) == pytest.approx(100.0, rel=0.1)


def test_an_odd_shape_is_seen_for_what_it_is(rng: np.random.Generator) -> None:
    """A unit of phi 0.8 among white ones: its long-run variance is not taken for that of its neighbours' shape."""
    prior = prior_of(50, rng)
    found = noise_curve(shown(np.full((50, 3), 1.0), rng, phi=0.8), LONGEST, prior)
    white = (1 - 0.8) ** 2 / (1 - 0.8**2)
    assert np.median(found.at(np.full((50, 1), 64.0))[0]) > 0.7 > 3 * white


def test_intervals_with_a_prior_cover_over_its_population(rng: np.random.Generator) -> None:
    """2000 units × 3 axes of 3 dwells of 16 readings: a share of 0.95 is known to ± 4 · 0.0028, and shapes are
    matched, not exact: ± 0.01."""
    prior = prior_of(50, rng, phi=0.5)
    ln = 0.5 * rng.standard_normal((2000, 1)) * np.ones(3)
    e = rng.standard_normal((2000, 3, 116, 3)) * np.exp(ln / 2)[:, None, None]
    x = lfilter([0.5], [1, -0.5], e, axis=2)[:, :, 100:]
    d = measure(x.reshape(-1, 3), np.arange(6000) * 16, np.full(6000, 16), np.repeat(np.arange(2000), 3), prior)
    inside = np.abs(d.mean) <= 1.96 * np.sqrt(d.variance)
    assert inside.mean() == pytest.approx(0.95, abs=4 * 0.0028 + 0.01)


def test_one_unit_gives_the_same_bits_alone_as_among_others(rng: np.random.Generator) -> None:
    prior = prior_of(10, rng)
    x = rng.standard_normal((4, 3, 40, 3))
    args = (np.arange(12) * 40, np.full(12, 40), np.repeat(np.arange(4), 3))
    many = measure(x.reshape(-1, 3), *args, prior)
    one = measure(x[2].reshape(-1, 3), args[0][:3], args[1][:3], args[2][:3], prior)
    assert np.array_equal(many.variance[6:9], one.variance)


def test_a_unit_that_dwells_far_longer_goes_by_itself(rng: np.random.Generator) -> None:
    prior = prior_of(10, rng)
    n = MAX_LENGTH_RATIO * LONGEST + 1
    x = rng.standard_normal((3 * n, 3))
    args = (np.arange(3) * n, np.full(3, n), np.zeros(3, np.int64))
    assert np.array_equal(measure(x, *args, prior).variance, measure(x, *args).variance)
    assert family_length(n, prior) == family_length(n)
    assert family_length(n - 1, prior) == LONGEST


def test_what_the_log_keeps_gives_the_same_prior_bit_for_bit(rng: np.random.Generator) -> None:
    prior = prior_of(5, rng)
    stored = json.loads(json.dumps({"prior": noise_document.of_prior(prior)}))
    again = noise_document.to_prior(stored)
    assert again is not None
    assert (again.longest, again.units) == (prior.longest, prior.units)
    for name in ("log_weight", "mean", "covariance"):
        assert getattr(again, name).tobytes() == getattr(prior, name).tobytes()
    assert noise_document.to_prior({"prior": None}) is None
    assert noise_document.to_prior(None) is None


def test_what_the_log_keeps_of_a_unit_tells_the_same(rng: np.random.Generator) -> None:
    """Likelihoods are rounded to 0.01, levels to 1e-4; shapes left out are e⁻¹² as likely as the likeliest."""
    units = population(8, rng, phi=0.5)
    stored = [json.loads(json.dumps({"noise": noise_document.of_likelihood(u)})) for u in units]
    before, after = (
        learn_prior(units, LONGEST),
        learn_prior(noise_document.all_likelihoods([{"dwell_s": []}, *stored]), LONGEST),
    )
    assert before is not None
    assert after is not None
    assert np.exp(after.log_weight) == pytest.approx(np.exp(before.log_weight), abs=0.02)
    assert after.mean == pytest.approx(before.mean, abs=2e-3)
    assert after.covariance == pytest.approx(before.covariance, abs=2e-3)


def test_shapes_of_another_version_are_passed_over_and_never_taken_for_these(rng: np.random.Generator) -> None:
    stored = noise_document.of_likelihood(population(1, rng)[0])
    assert noise_document.all_likelihoods([{"noise": stored | {"family": stored["family"] + 1}}]) == []
    prior = noise_document.of_prior(prior_of(2, rng))
    with pytest.raises(LogError, match="other shapes than this version"):
        noise_document.to_prior({"prior": prior | {"log_weight": prior["log_weight"][:-1]}})
    with pytest.raises(LogError, match="cannot be read"):
        noise_document.to_prior({"prior": {"longest": 64}})


def test_a_prior_expects_levels_as_a_normal_would() -> None:
    """Levels of a unit with readings without end in two axes: the third as normal theory says; its own says nothing."""
    covariance = np.array([[1.0, 0.5, 0.5], [0.5, 1.0, 0.5], [0.5, 0.5, 1.0]])
    prior = NoisePrior(LONGEST, 10**9, general_log_weights(LONGEST), np.zeros(3), covariance)
    mean, spread = np.array([[0.0, 0.9, 0.9]]), np.array([[1e9, 1e-12, 1e-12]])
    expected, dof = prior._expected_variance(mean, spread)
    # E = ½/1.5 · (0.9 + 0.9) = 0.6, variance 1 − 2 · ½ · ⅓ = ⅔, so dof 1 + 2/⅔ = 4.
    assert dof[0, 0] == pytest.approx(4.0)
    assert np.log(expected[0, 0]) == pytest.approx(0.6 - noise_prior._log_bias(np.array(4.0)))


def test_an_axis_whose_readings_never_change_spoils_nothing(rng: np.random.Generator) -> None:
    """Its neighbours are as variable as they are, to four times what their degrees of freedom say. Of itself the prior
    says about one reading's worth (t, so far off) among 189."""
    prior = prior_of(20, rng)
    x = rng.standard_normal((3, LONGEST, 3))
    x[:, :, 0] = 0.0
    args = (np.arange(3) * LONGEST, np.full(3, LONGEST), np.zeros(3, np.int64))
    found = measure(x.reshape(-1, 3), *args, prior)
    n_variance = LONGEST * found.variance / noise.widening(found.dof)
    assert (n_variance[:, 0] < 0.2).all()
    assert (np.abs(np.log(n_variance)) < 4 * np.sqrt(2 / found.dof))[:, 1:].all()
