"""A bent response is seen where it is, and denied where it is not."""

import numpy as np
import pytest

from station.domain.core.types import Floats
from station.domain.evaluation import model_comparison
from tests.fakes import tumble


def bent(
    rng: np.random.Generator, method: str, quadratic: float, cubic: float
) -> dict[str, model_comparison.LargerModel]:
    recipe = tumble.recipe(method, ups={**{f"v{i}": v for i, v in enumerate(tumble.VERTICES)}, **corners()})
    true = tumble.truths(recipe)
    theta = tumble.units(rng, 1)
    mean = tumble.readings(theta, true + quadratic * true**2 + cubic * true**3)
    found = tumble.calibrate_unit(recipe, tumble.table(recipe, mean, 1e-3, 60, rng), tumble.TODAY)
    return {one.terms: one for one in model_comparison.of_unit(recipe, found)}


def corners() -> dict[str, list[int]]:
    signs = [(a, b, c) for a in (1, -1) for b in (1, -1) for c in (1, -1)]
    faces = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)]
    return {f"c{i}": list(s) for i, s in enumerate([*signs, *faces])}


@pytest.mark.parametrize("method", ["n-point", "norm"])
def test_a_straight_response_needs_no_bend(rng: np.random.Generator, method: str) -> None:
    found = bent(rng, method, 0.0, 0.0)
    assert not found["quadratic"].pays and not found["cubic"].pays
    assert min(one.p for one in found.values()) > model_comparison.LEVEL


@pytest.mark.parametrize("method", ["n-point", "norm"])
def test_a_bend_is_seen(rng: np.random.Generator, method: str) -> None:
    assert bent(rng, method, 0.01, 0.0)["quadratic"].pays
    assert bent(rng, method, 0.0, 0.01)["cubic"].pays


def test_what_the_poses_cannot_tell_is_said(rng: np.random.Generator) -> None:
    recipe = tumble.recipe(
        "n-point", ups={n: tumble.truths(tumble.recipe("six-point"))[i] for i, n in enumerate(tumble.FACES)}
    )
    table = tumble.table(recipe, tumble.truths(recipe)[None], 1e-3, 40, rng)
    found = {
        one.terms: one for one in model_comparison.of_unit(recipe, tumble.calibrate_unit(recipe, table, tumble.TODAY))
    }
    assert np.isnan(found["cubic"].p) and not found["cubic"].pays
    assert np.isfinite(found["quadratic"].p)


def test_methods_with_positions_to_match_are_not_asked(rng: np.random.Generator) -> None:
    recipe = tumble.recipe("six-point")
    table = tumble.table(recipe, tumble.truths(recipe)[None], 1e-3, 40, rng)
    assert model_comparison.of_unit(recipe, tumble.calibrate_unit(recipe, table, tumble.TODAY)) == ()


def test_leaving_a_group_out_is_a_fit_without_it(rng: np.random.Generator) -> None:
    """The leverages' shortcut against really fitting without the group."""
    X, y = rng.standard_normal((20, 4)), rng.standard_normal(20)
    group = np.repeat(np.arange(5), 4)
    (one,) = model_comparison.compare(X, {"more": rng.standard_normal((20, 1))}, y, group)
    out: list[Floats] = []
    for g in range(5):
        b = np.linalg.lstsq(X[group != g], y[group != g], rcond=None)[0]
        out.append(y[group == g] - X[group == g] @ b)
    assert one.rms_left_out == pytest.approx(np.sqrt(np.mean(np.square(out))))
