"""Two causes that together are one law of no library."""

import numpy as np
import pytest

from station.diagnosis.candidates.bank import build_bank, candidates, cause_library
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.form_check import LAW_NATS
from station.diagnosis.search.one_law import laws_of_two
from station.diagnosis.search.problem import FloorAllowance, initial_problem, refined
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.domain.core.types import Array
from station.model.model_file import Model
from tests.blind.bench import Hidden, World, hide
from tests.blind.recipes import recipe


def with_both(hidden: Hidden, one: str, two: str, *, d: float = 30.0) -> ScoringProblem:
    """A problem of one unit in which two causes of the library are known, at the shape that fits best."""
    table, _ = hide(recipe(1), hidden, 7, units=1, d=d)
    problem = initial_problem(reduce_samples(recipe(1), table), FloorAllowance.of(recipe(1), Model()))
    for name in (one, two):
        (effect,) = (e for e in cause_library(recipe(1)) if e.id == name)
        shapes = [c for c in candidates(effect, problem.view) if c.of == "unit"]
        now = score_bank(
            problem, [build_bank(shapes, problem.view.layout, moving=shapes[0].moving)], problem.fit().floor
        )
        best = now.candidates[int(now.readings().evidence[0].argmax())]
        problem = refined(problem.with_accepted((*problem.accepted, now.accept(best, problem.view))))
    return problem


def _of(one: Array, two: Array, forms: tuple[Array, Array]) -> Array:
    return np.asarray(1e-3 * (one * forms[0] + two * forms[1]))


def _one_law_of_input(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
    c = np.array([1.0, -0.6, 0.8])
    return w.a, _of(c, 0.9 * c, (w.a**2, w.a**3))


def _two_of_their_own(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
    return w.a, _of(np.array([1.0, -0.6, 0.8]), np.array([0.7, 1.0, -0.9]), (w.a**2, w.a**3))


def _climbing(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
    """What comes on within the dwells in proportion to the step before them."""
    return w.a, 1e-3 * np.array([1.0, -0.6, 0.8]) * (w.before - w.a) * (1 - np.exp(-w.away / 0.08))[:, None]


@pytest.mark.parametrize(
    ("hidden", "names", "words"),
    [
        (_one_law_of_input, ("quadratic", "cubic"), ("input",)),
        (_climbing, ("hysteresis", "filter-lag"), ("order", "dwell-phase")),
    ],
)
def test_two_causes_in_one_ratio_on_every_axis_are_one_law(
    hidden: Hidden, names: tuple[str, str], words: tuple[str, ...]
) -> None:
    (law,) = laws_of_two(with_both(hidden, *names), (0, 1))
    assert law.places == (0, 1)
    assert law.words == words
    # No more than what half of the numbers cost: neither name is certain beside it.
    assert 0.0 < law.lead < 4 * LAW_NATS


def test_two_causes_of_their_own_sizes_are_no_law() -> None:
    (law,) = laws_of_two(with_both(_two_of_their_own, "quadratic", "cubic"), (0, 1))
    assert law.lead < -2 * LAW_NATS


def test_causes_of_other_covariates_are_no_law() -> None:
    def both(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
        c = np.array([1.0, -0.6, 0.8])
        return w.a, _of(c, c, (w.a**2, np.repeat((w.T - w.T.mean())[:, None], 3, axis=1)))

    assert not list(laws_of_two(with_both(both, "quadratic", "offset-temperature"), (0, 1)))
