"""The alarm: what explains next to nothing raises none, and the threshold is the null's."""

import numpy as np
import pytest
from scipy import stats

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear.noise_floor import FittedFloor, fit
from station.diagnosis.linear.projection import DataColumns
from station.diagnosis.search.alarm import ALARMS_NATS, DRAWN_LEVEL, cache_key, fit_null, statistic
from station.diagnosis.search.bounded_floor import BoundedFloor, bound_sides
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.rank import variance_surprise
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import six_faces


def test_a_cause_that_says_the_same_whatever_is_read_alarms_nobody(rng: np.random.Generator) -> None:
    # Null sets are drawn in single precision: a constant comes out a little off the readings' own.
    constant = -0.18 + 1e-6 * rng.standard_normal(2048)
    null = fit_null({"cross-axis": constant, "cubic": rng.gumbel(-2.0, 1.0, 2048)})
    assert statistic(null, {"cross-axis": 0.0, "cubic": -2.0}) == 0.0


@pytest.mark.parametrize("name", ["cubic", "input"])
def test_what_explains_little_alarms_nobody_however_rare_it_is(name: str, rng: np.random.Generator) -> None:
    null = fit_null({name: 0.1 * rng.standard_normal(2048)})
    assert null.minus_log10_p(name, np.array([ALARMS_NATS - 0.5])) > 2 * null.threshold
    # It still casts doubt on what it is left beside.
    assert statistic(null, {name: ALARMS_NATS - 0.5}) == (null.threshold if name == "cubic" else 0.0)
    assert statistic(null, {name: ALARMS_NATS + 0.1}) > null.threshold


def test_the_threshold_is_passed_by_as_many_null_sets_as_are_drawn_for_it(rng: np.random.Generator) -> None:
    names = ("cubic", "input", "time")
    null = fit_null({name: rng.gumbel(0.0, 1.5, 4096) for name in names})
    fresh = null.surprise({name: rng.gumbel(0.0, 1.5, 20_000) for name in names})
    share = float(np.mean(fresh > null.threshold))
    # Four standard deviations of such a share in 4,096 and in 20,000 sets.
    assert abs(share - DRAWN_LEVEL) < 4 * np.sqrt(DRAWN_LEVEL * (1 / 4096 + 1 / 20_000))


@pytest.mark.parametrize("dof", [6, 40, 3000])
@pytest.mark.parametrize("gain", [4.2, 10.0, 100.0])
def test_a_free_variance_surprises_as_the_tail_of_its_ratio_says(gain: float, dof: int) -> None:
    tail = 0.5 * stats.f.sf(dof * np.expm1(2 * gain / dof), 1, dof)
    assert 0 <= -np.log10(tail) - variance_surprise(gain, dof) < 0.05


def test_no_gain_is_beyond_the_scale_of_surprise() -> None:
    assert np.isfinite(variance_surprise(1e6, 300))
    assert variance_surprise(4.0, 300) == 0.0


def test_chance_is_kept_for_the_positions_it_was_drawn_for_whatever_the_recipe_is_called() -> None:
    faces = six_faces("listed", "reversed")
    other = faces.model_copy(update={"positions": (faces.positions[1], faces.positions[0], *faces.positions[2:])})
    renamed = faces.model_copy(update={"name": "renamed", "version": 9})
    assert key_of(faces) != key_of(other)
    assert key_of(faces) == key_of(renamed)


def key_of(recipe: Recipe) -> str:
    table, _ = hide(recipe, None, 3, units=1, floor=WHITE)
    problem = initial_problem(reduce_samples(recipe, table), FloorAllowance.of(recipe, Model()))
    fitted = problem.fit()
    banks = CandidateBanks(problem.view).of(problem.view, ())
    return cache_key(problem, fitted, WalkMarginal(score_bank(problem, banks, fitted.floor), (), ()), 1)


def healthy(units: int, seed: int) -> ScoringProblem:
    """A problem of white noise on six faces."""
    faces = six_faces("listed")
    table, _ = hide(faces, None, seed, units=units, floor=WHITE)
    return initial_problem(reduce_samples(faces, table), FloorAllowance.of(faces, Model()))


@pytest.mark.parametrize("seed", range(3, 9))
def test_readings_would_be_fitted_where_they_are(seed: int) -> None:
    problem = healthy(2, seed)
    bounded = BoundedFloor.of(problem.fit(), problem.upper)
    assert bounded is not None
    assert bounded.holds(problem.setting.data.visit).all()


def test_sets_of_noise_that_are_drawn_for_a_floor_at_its_bounds_are_fitted_there(rng: np.random.Generator) -> None:
    problem = healthy(3, 6)
    fitted, data = problem.fit(), problem.setting.data.visit
    bounded = BoundedFloor.of(fitted, problem.upper)
    side = bound_sides(fitted, problem.upper)
    assert bounded is not None
    assert 0 not in side
    true = problem.structure.covariance(fitted.floor.variances * [1.0, 0.5, 0.5])
    sets = true.runs.coloured(rng.standard_normal((*data.shape[:3], 120)))
    there = [bound_sides(fit_of(problem, sets[..., [i]]), problem.upper) == side for i in range(sets.shape[3])]
    held = bounded.holds(sets)
    # A quarter of the sets is fitted there, of those that are drawn .75 +- .08.
    assert np.mean(there) < 0.4
    assert np.mean(np.array(there)[held]) > 0.5
    assert np.mean(np.array(there)[~held]) < 0.2


def fit_of(problem: ScoringProblem, readings: Floats) -> FittedFloor:
    """The floor of other readings."""
    count = problem.readings(moving=False)[1]
    return fit(problem.structure, problem.known, DataColumns(readings), count, problem.upper)
