"""What a recipe can determine before anything moves: rank, refusal, efficiency, proposals."""

from typing import Any

import numpy as np
import pytest
import yaml

from station.domain.evaluation.pipeline import NO_ROUNDING
from station.domain.methods import rank
from station.domain.methods.calibrate import _ellipsoid
from station.domain.planning import design, optimal
from station.domain.planning.forecast import forecast
from station.domain.recipe import directions
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from tests.fakes import tumble

#: sd of offset, scale and cross-axis of the norm fit for noise 1 (published figures of the designs, three decimals).
NORM = {
    12: (0.50, 0.71, 1.12),
    14: (0.46, 0.64, 1.06),
    18: (0.41, 0.53, 1.00),
    20: (0.39, 0.55, 0.87),
    24: (0.35, 0.52, 0.77),
}


def on(solid: int, method: str, **more: Any) -> Recipe:
    ups = {f"p{i:02d}": d for i, d in enumerate(directions.SOLIDS[solid])}
    return tumble.recipe(method, ups=ups, **more)


@pytest.mark.parametrize(("solid", "expected"), [(4, 4), (6, 6), (8, 7), (12, 9), (18, 9)])
def test_rank_of_the_norm_fit_on_known_designs(solid: int, expected: int) -> None:
    assert rank.of(_ellipsoid.design(directions.SOLIDS[solid])) == expected


@pytest.mark.parametrize("solid", [n for n in directions.SOLIDS if n > 8])
def test_predicted_spread_of_the_norm_fit_is_the_published_one(solid: int) -> None:
    X = _ellipsoid.design(directions.SOLIDS[solid])
    std = np.sqrt(np.diagonal(np.linalg.inv(X.T @ X)))
    offset, scale, cross = std[:3].mean(), np.sqrt((std[[3, 6, 8]] ** 2).mean()), np.sqrt((std[[4, 5, 7]] ** 2).mean())
    if solid in NORM:
        assert (offset, scale) == pytest.approx(NORM[solid][:2], abs=0.02)
        assert cross == pytest.approx(NORM[solid][2], abs=0.02)


@pytest.mark.parametrize("solid", [6, 8, 12, 20, 24])
def test_a_2_design_gives_the_textbook_spread(solid: int) -> None:
    """Offset 1/√N and gain √(3/N) for noise 1 a stop."""
    recipe = on(solid, "n-point", device={"rate_hz": 100, "noise_density": 0.1}, dwell={"time_s": 1.0})
    std = forecast(recipe, NO_ROUNDING).budget.std("noise")
    one = 0.1 * np.sqrt(50) / 10
    assert std[:3] == pytest.approx(np.full(3, one / np.sqrt(solid)), rel=1e-5)
    assert std[3:] == pytest.approx(np.full(9, one * np.sqrt(3 / solid)), rel=1e-5)


def test_norm_on_six_faces_is_refused_by_name_with_the_positions_to_add() -> None:
    with pytest.raises(RecipeError) as caught:
        design.check(on(6, "norm"))
    printed = caught.value.sentence
    assert "cross-axis xy, cross-axis xz, cross-axis yz undetermined (rank 6 of 9)" in printed
    assert "offset" not in printed
    assert "add 3 positions, best first" in printed


def test_repeating_six_faces_four_times_does_not_help() -> None:
    runs = [{"order": "listed"}] * 4
    with pytest.raises(RecipeError, match="rank 6 of 9"):
        design.check(on(6, "norm", runs=runs))


def test_the_proposed_positions_complete_the_recipe() -> None:
    incomplete = on(6, "norm")
    more = [yaml.safe_load(text) for text in design.missing(incomplete)]
    positions = [p.model_dump(exclude_none=True) for p in incomplete.positions] + more
    design.check(tumble.recipe("norm", positions=positions))


@pytest.mark.parametrize(
    ("ups", "shown"), [({"z": [0, 0, 1], "mz": [0, 0, -1]}, "gain x"), ({"a": [1, 1, 0]}, "offset")]
)
def test_what_a_poor_n_point_recipe_leaves_open_is_named(ups: dict[str, list[float]], shown: str) -> None:
    with pytest.raises(RecipeError, match=shown):
        design.check(tumble.recipe("n-point", ups=ups))


@pytest.mark.parametrize("method", ["n-point", "norm"])
@pytest.mark.parametrize("count", [9, 12, 13, 18])
def test_a_proposed_design_is_complete_and_no_worse_than_an_even_spread(method: str, count: int) -> None:
    recipe = on(12, method)
    found = optimal.search(recipe, count)
    assert found.shape == (count, 3)
    assert np.linalg.norm(found, axis=1) == pytest.approx(np.ones(count))
    assert optimal.log_det(found, recipe) >= optimal.log_det(directions.spread(count), recipe) - 1e-9


def test_twelve_positions_are_an_icosahedron() -> None:
    """D-optimal for linear and quadratic models on the sphere: nothing found by search may beat it."""
    for method in ("n-point", "norm"):
        recipe = on(12, method)
        found = optimal.search(recipe, 12)
        solid = optimal.log_det(directions.ICOSAHEDRON, recipe)
        assert optimal.log_det(found, recipe) == pytest.approx(solid, abs=1e-6)
        assert design.efficiency(recipe) == pytest.approx(1.0)


def test_a_lopsided_recipe_is_less_efficient() -> None:
    ups = {f"p{i}": d for i, d in enumerate(directions.SOLIDS[12] + np.array([0, 0, 1.5]))}
    assert design.efficiency(tumble.recipe("n-point", ups=ups)) < 0.8


def test_the_next_position_is_where_the_recipe_looks_least() -> None:
    ups = {"a": [1, 0, 0], "b": [0, 1, 0], "c": [-1, 0, 0], "d": [0, -1, 0], "e": [0, 0, 1]}
    assert yaml.safe_load(design.next_position(tumble.recipe("n-point", ups=ups)))["up"] == "-z"


@pytest.mark.parametrize("solid", list(directions.SOLIDS))
def test_solids_are_directions_all_different(solid: int) -> None:
    points = directions.SOLIDS[solid]
    assert points.shape == (solid, 3)
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.ones(solid))
    apart = points @ points.T - 2 * np.eye(solid)
    assert apart.max() < 0.99


@pytest.mark.parametrize("field", [[0.0, 0.0, 48.0], [0.0, 21.0, -43.0]])
def test_a_position_as_yaml_makes_the_truth_it_was_asked_for(field: list[float]) -> None:
    recipe = tumble.recipe("n-point", "magnetometer", reference={"source": "field", "vector": field})
    size = float(np.linalg.norm(field))
    for wanted in directions.CANDIDATES[:60]:
        text = optimal.as_yaml("p", wanted * size, recipe)
        made = tumble.recipe(
            "n-point", "magnetometer", positions=[yaml.safe_load(text)], reference=recipe.reference.model_dump()
        )
        assert made.true_vector(made.positions[0]) == pytest.approx(wanted * size, abs=2e-3)


def test_columns_of_rounding_errors_are_columns_of_zeros() -> None:
    rows = np.eye(3)
    rows[:, 2] *= 1e-17
    assert rank.undetermined(rows, ("a", "b", "c")) == ("c",)
    assert rank.condition(np.eye(3)) == 1


def test_limits_that_cannot_be_decided_are_named() -> None:
    recipe = on(6, "six-point", device={"rate_hz": 100, "noise_density": 0.01}, limits={"offset": 1e-4, "gain": 1.0})
    found = {d.kind: d.verdict for d in forecast(recipe, NO_ROUNDING).decisions}
    assert found == {"offset": "impossible", "gain": "comfortable"}
