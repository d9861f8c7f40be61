"""What a station's own results teach of its process and its reproducibility, and how risks use it."""

import json

import numpy as np
import pytest
from scipy.stats import norm

from station.domain.core.types import Floats
from station.domain.line_quality import history
from station.domain.line_quality.history import MIN_REPEATS, MIN_UNITS, NOTHING, PastResult
from station.domain.methods import coefficients, risk
from station.domain.methods.coverage import ErrorDistribution
from station.domain.recipe.blocks import Process
from station.errors import LogError
from tests.fakes import tumble

FREE = np.ones(12, bool)
GOLDEN = [f"U{i}" for i in range(100)]
NOISE = np.where(coefficients.OFFSETS, 2e-4, 3e-4)


def result(
    serial: str, off: Floats, *, nest: str = "A", day: int = 1, passed: bool = True, tilt: float = 0.0
) -> PastResult:
    parts = {"noise": NOISE, "nest tilt": np.full(12, tilt), "magnitude": np.full(12, 1e-3)}
    return PastResult(serial, f"S/{nest}", f"2026-11-{day:02d}", passed, coefficients.NOMINAL + off, parts)


def test_a_process_is_learnt_from_different_units_each_once(rng: np.random.Generator) -> None:
    """Mean and spread of each coefficient; a unit measured ten times counts once, with its newest result."""
    offs = 0.01 * rng.standard_normal((MIN_UNITS, 12)) + 0.002
    often = [result("U0", np.full(12, 1.0)) for _ in range(9)]
    golden = [result("G", np.full(12, 1.0))]
    found = history.learn_history(
        [*often, *(result(f"U{i}", off) for i, off in enumerate(offs)), *golden], FREE, ("G",)
    )
    assert found.units == MIN_UNITS and found.process is not None and found.process.each is not None
    mean, std = np.array(found.process.each, float).T
    assert mean == pytest.approx(offs.mean(axis=0))
    assert std == pytest.approx(offs.std(axis=0, ddof=1) * np.sqrt(1 + 1 / MIN_UNITS))


def test_too_few_units_or_repeats_teach_nothing(rng: np.random.Generator) -> None:
    few = [result(f"U{i}", 0.01 * rng.standard_normal(12)) for i in range(MIN_UNITS - 1)]
    assert history.learn_history(few, FREE, ()) == NOTHING
    again = [result("G", 0.01 * rng.standard_normal(12)) for _ in range(MIN_REPEATS)]
    assert history.learn_history(again, FREE, ("G",)).reproducibility is None
    assert history.learn_history(10 * again, FREE, ()).reproducibility is None, (
        "other units come again because something was wrong"
    )
    failed = [result("G", np.zeros(12), passed=False) for _ in range(9)]
    assert history.learn_history([*again, *failed], FREE, ("G",)).reproducibility is None, (
        "what failed may have been seated wrongly"
    )


def test_reproducibility_is_what_repeats_scatter_by_beyond_the_noise(rng: np.random.Generator) -> None:
    """Units with offsets of their own, measured 40 times each with noise and a day's error of 5e-4."""
    units = [result(f"U{i}", 0.02 * rng.standard_normal(12)) for i in range(20)]
    results = [
        result(
            u.serial, u.theta - coefficients.NOMINAL + np.hypot(NOISE, 5e-4) * rng.standard_normal(12), day=1 + k % 9
        )
        for u in units
        for k in range(40)
    ]
    found = history.learn_history(results, FREE, GOLDEN)
    again = found.reproducibility
    assert again is not None and (found.repeats, found.golden, found.days) == (800, 20, 9)
    assert again.dof == 780
    assert [again.offset, again.gain, again.cross_axis] == pytest.approx([5e-4] * 3, rel=0.05)


def test_what_the_budget_holds_already_is_not_counted_twice(rng: np.random.Generator) -> None:
    """Nests tilted by as much as the budget says: nothing is left where a unit goes through all nests."""
    tilt = 2e-3
    nests = {name: tilt * rng.standard_normal(12) for name in (f"N{i}" for i in range(400))}
    results = [
        result(f"U{i}", nests[f"N{4 * i + k}"] + NOISE * rng.standard_normal(12), nest=f"N{4 * i + k}", tilt=tilt)
        for i in range(100)
        for k in range(4)
    ]
    again = history.learn_history(results, FREE, GOLDEN).reproducibility
    assert again is not None
    # Of 300 degrees of freedom an axis, the variance is known to √(2/900) for three axes: 3 of that.
    assert max(again.offset, again.gain, again.cross_axis) < tilt * (3 * (2 / 900) ** 0.5) ** 0.5


def test_what_a_recipe_states_stands(rng: np.random.Generator) -> None:
    results = [result(f"U{i % 99}", 0.01 * rng.standard_normal(12)) for i in range(200)]
    found = history.learn_history(results, FREE, GOLDEN[:9])
    stated = tumble.recipe("six-point", limits={"process": {"offset": [0, 0.1]}}, reproducibility={"dof": 9})
    assert found.applied(stated) == stated
    open_ = found.applied(tumble.recipe("six-point"))
    assert open_.limits.process == found.process and open_.reproducibility == found.reproducibility
    assert NOTHING.applied(stated) is stated


def test_a_record_gives_back_the_same_bits(rng: np.random.Generator) -> None:
    found = history.learn_history(
        [result(f"U{i % 29}", 0.01 * rng.standard_normal(12)) for i in range(60)], FREE, GOLDEN[:9]
    )
    assert found.process is not None and found.reproducibility is not None
    assert history.of_document(json.loads(json.dumps(found.document()))) == found
    assert history.of_document(None) == NOTHING
    with pytest.raises(LogError, match="damaged"):
        history.of_document({"process": None})


def test_a_process_of_results_says_nothing_of_what_all_results_share() -> None:
    """Random u 3e-4, shared 1e-3, process 1e-4: the posterior cannot be narrower than what is shared."""
    random, shared, spread = 3e-4, 1e-3, 1e-4
    one = np.ones((1, 1))
    prior = risk.Prior(0 * one, spread * one, shared * one, 0 * one, shared * one)
    error = ErrorDistribution.plain(np.hypot(random, shared) * one, 1e9 * one)
    found = risk.Measured(5e-4 * one, error, np.eye(1)[None], prior)
    share = spread**2 / (spread**2 + random**2)
    mean, std = (float(v[0, 0]) for v in (found.believed()[0], found.believed()[1].std))
    assert mean == pytest.approx(share * 5e-4) and std == pytest.approx(np.hypot(shared, share**0.5 * random))
    again = float(found.believed(again=True)[1].std[0, 0])
    assert again == pytest.approx(np.hypot(random, share**0.5 * random)), "a second result shares the shared error"
    limit = np.array([[2e-3]])
    assert risk.beyond(found, limit) == pytest.approx(
        [norm.cdf((mean - 2e-3) / std) + norm.cdf((-mean - 2e-3) / std)], rel=1e-4
    )


def test_each_coefficient_may_have_a_process_of_its_own() -> None:
    each = [[0.001, 0.01], *[None] * 11]
    assert Process.model_validate({"each": each}).each == ((0.001, 0.01), *[None] * 11)
