"""What the mean of results says of the error that they share, against draws by plain Monte Carlo."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from station.domain.core.types import Floats
from station.domain.methods import coefficients, decision_rule, risk
from station.domain.methods.common_error import FAR, common_error
from station.domain.methods.coverage import ErrorDistribution
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.blocks import Limits

#: Standard deviations of units, of gravity, of a result's own error; results, axes.
PROCESS, GRAVITY, NOISE = 0.01, 0.003, 0.0016
RESULTS, AXES = 40, 3
MEAN_STD = float(np.hypot(PROCESS, NOISE)) / RESULTS**0.5
SHARED = GRAVITY**2 * np.ones((1, AXES, AXES))


def drawn(rng: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Process means (count, 3) of the five kinds, each as often, and errors (count)."""
    kind = rng.integers(5, size=count)
    alone, alike = rng.standard_normal((count, AXES)), rng.standard_normal((count, 1))
    far = np.r_[0.0, FAR, FAR][kind][:, None]
    return PROCESS * far * np.where(kind[:, None] <= len(FAR), alone, alike), GRAVITY * rng.standard_normal(count)


def found_in(results: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation (u, 3) of the error by means of results (u, 3)."""
    full = np.ones_like(results)
    return common_error(results, MEAN_STD * full, PROCESS * full, np.repeat(SHARED, len(results), axis=0))


@pytest.mark.parametrize("mean", [(0.002, 0.002, 0.002), (0.006, 0.0055, 0.006), (0.012, -0.004, 0.001), (0.012,) * 3])
def test_mean_and_spread_are_those_of_weighted_draws(mean: tuple[float, ...], rng: np.random.Generator) -> None:
    """Draws of means and errors, each weighed by how likely it makes these results."""
    m, s = drawn(rng, 400_000)
    weight = norm.pdf((np.array(mean) - m - s[:, None]) / MEAN_STD).prod(axis=1)
    weight /= weight.sum()
    value = float(weight @ s)
    std = float(np.sqrt(weight @ (s - value) ** 2))
    found, left = (float(part[0, 0]) for part in found_in(np.array([mean])))
    # Four standard deviations of such an estimate: σ over the root of the effective number of draws.
    tolerance = 4 * std * float((weight**2).sum()) ** 0.5
    assert found == pytest.approx(value, abs=tolerance) and left == pytest.approx(std, abs=tolerance)


@pytest.mark.parametrize("far", [0.0, 1.0, 2.0])
def test_stated_risks_are_the_true_ones_wherever_process_means_lie(far: float, rng: np.random.Generator) -> None:
    """Of stations whose process means lie as far out as stated, units that pass: stated over true risk."""
    stations, limit = 20_000, 0.015
    m = far * PROCESS * rng.standard_normal((stations, AXES))
    shared = GRAVITY * rng.standard_normal((stations, 1))
    results = m + shared + MEAN_STD * rng.standard_normal((stations, AXES))
    true = m + PROCESS * rng.standard_normal((stations, AXES))
    measured = true + shared + NOISE * rng.standard_normal((stations, AXES))
    full = np.ones_like(results)
    prior = risk.Prior(results, PROCESS * full, GRAVITY * full, *found_in(results))
    error = ErrorDistribution.plain(np.hypot(NOISE, GRAVITY) * full, 1e9 * full)
    known = risk.Measured(measured, error, np.eye(3)[None] * full[..., None], prior)
    passed = np.abs(measured[:, 0]) <= limit
    stated = float(risk.beyond(known.of_coefficient(0).of_units(passed), np.full((passed.sum(), 1), limit)).sum())
    wrong = float((np.abs(true[passed, 0]) > limit).sum())
    # Three standard deviations of a count beside the goal, .8 to 1.25.
    room = 3 / wrong**0.5
    assert 0.8 * (1 - room) <= stated / wrong <= 1.25 * (1 + room)


def budget(**parts: float) -> Budget:
    """Gains uncertain by causes, gravity alike in all three."""
    alike = np.outer(coefficients.GAINS, coefficients.GAINS).astype(float)
    of = {cause: std**2 * (alike if cause == "gravity" else np.diag(np.diag(alike))) for cause, std in parts.items()}
    return Budget(of, np.asarray(sum(of.values())), np.full(12, 1e6), 0.0, {})


def prior_of(results: float, process: dict[str, Any], **parts: float) -> risk.Prior:
    limits = Limits.model_validate({"process": {"gain": [results, PROCESS], "of_results": True, **process}})
    return decision_rule.prior_of(limits, [budget(**parts)]).take(np.flatnonzero(coefficients.GAINS))


def test_only_what_every_result_shares_is_learnt() -> None:
    """Scatter, nest and base may be others for the next unit: nothing is said of them, and they stay whole."""
    stays = prior_of(0.002, {"units": RESULTS}, scatter=GRAVITY)
    assert not stays.error.any() and stays.error_std == pytest.approx(GRAVITY)
    both = prior_of(0.002, {"units": RESULTS}, gravity=GRAVITY, **{"nest tilt": 0.001})
    assert (both.error > 0).all() and (both.error_std > 0.001).all() and (both.error_std < both.shared).all()


def test_fewer_results_say_less_and_a_record_without_their_number_nothing() -> None:
    left = [float(prior_of(0.002, {"units": n}, gravity=GRAVITY).error_std[0, 0]) for n in (20, 40, 300)]
    assert left == sorted(left, reverse=True) and left[0] < GRAVITY
    before = prior_of(0.002, {}, gravity=GRAVITY)
    assert not before.error.any() and before.error_std == pytest.approx(GRAVITY)
