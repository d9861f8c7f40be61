"""The order of least moving time: exact on small sets, near it beyond, and what the recipe forbids is never done."""

from itertools import permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe import directions, moves, ordering, plan
from station.domain.recipe.ordering import FORBIDDEN_S, MoveTimes
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

FACES = {"z-up": "+z", "z-down": "-z", "x-up": "+x", "x-down": "-x", "y-up": "+y", "y-down": "-y"}


def recipe(positions: list[dict[str, Any]] | None = None, *runs: dict[str, Any]) -> Recipe:
    """Six faces, or other positions; one run in the fastest order, or other runs."""
    faces = [{"name": name, "up": up} for name, up in FACES.items()]
    return tumble.recipe("n-point", positions=positions or faces, runs=list(runs) or [{"order": "fastest"}])


def random_moves(seed: int, n: int, *, even: bool = False) -> MoveTimes:
    """Moving times that differ both ways, or those of points on a sphere."""
    rng = np.random.default_rng(seed)
    if even:
        x = rng.standard_normal((n, 3))
        x /= np.linalg.norm(x, axis=1)[:, None]
        between = moves.turn_s(np.rad2deg(np.arccos(np.clip(x @ x.T, -1, 1))))
        return MoveTimes(between, between[0].copy(), np.zeros(n))
    return MoveTimes(rng.uniform(0, 1, (n, n)), rng.uniform(0, 1, n), rng.uniform(0, 1, n))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 6))
def test_exact_is_the_best_of_all_orders(seed: int, n: int) -> None:
    requested = random_moves(seed, n)
    least = min(requested.of(np.array(order)) for order in permutations(range(n)))
    assert requested.of(ordering.exact(requested)) == pytest.approx(least, abs=1e-12)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(7, 11), st.booleans())
def test_the_search_comes_near_the_optimum(seed: int, n: int, even: bool) -> None:
    requested = random_moves(seed, n, even=even)
    found = ordering.search(requested)
    assert sorted(found.tolist()) == list(range(n))
    assert requested.of(found) <= requested.of(ordering.exact(requested)) * (1.02 if even else 1.10)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 20))
def test_an_order_holds_every_position_once_and_is_never_slower_than_listed(seed: int, n: int) -> None:
    requested = random_moves(seed, n)
    found = ordering.fastest(requested)
    assert sorted(found.tolist()) == list(range(n))
    assert requested.of(found) <= requested.of(np.arange(n))
    assert np.array_equal(found, ordering.fastest(requested))


def test_what_is_alike_stays_as_listed() -> None:
    assert ordering.fastest(MoveTimes(np.ones((20, 20)), np.ones(20), np.ones(20))).tolist() == list(range(20))


def test_a_turn_is_a_trapezium_of_speed() -> None:
    """180 deg at 90 deg/s: 2 s and half a second of ramps; 45 deg are where full speed is just reached."""
    assert moves.turn_s(np.array([0.0, 45.0, 180.0])) == pytest.approx([0.0, 1.0, 2.5])


def test_no_order_of_six_faces_is_faster() -> None:
    requested = recipe()
    least = min(moving_s(requested, order) for order in permutations(requested.positions))
    assert moving_s(requested, plan.order_of(requested, 0)) == pytest.approx(least)
    assert least < 0.8 * moving_s(requested, requested.positions)


def moving_s(requested: Recipe, order: Any) -> float:
    """Moves of one run from the parking place and back."""
    names = [p.name for p in requested.positions]
    return moves.bench_move_times(requested.positions, np.eye(3), np.eye(3)).of(
        np.array([names.index(p.name) for p in order])
    )


def test_ends_that_the_recipe_fixes_are_kept() -> None:
    order = plan.order_of(recipe(None, {"order": "fastest", "first": "y-up", "last": "z-down"}), 0)
    assert (order[0].name, order[-1].name) == ("y-up", "z-down")


def test_a_pose_returned_to_is_left_in_between() -> None:
    """z-up and again are one pose: next to each other they would tell nothing of coming back."""
    positions = [{"name": n, "up": up} for n, up in (*FACES.items(), ("again", "+z"))]
    names = [p.name for p in plan.order_of(recipe(positions), 0)]
    assert abs(names.index("z-up") - names.index("again")) > 1


def test_a_run_starts_where_the_one_before_ended() -> None:
    requested = recipe(None, {"order": "fastest", "last": "y-down"}, {"order": "fastest"})
    assert plan.order_of(requested, 1)[0].name == "y-down"


def test_it_ends_near_the_verification() -> None:
    requested = recipe().model_dump(by_alias=True) | {"verify": {"positions": [{"name": "v", "up": "-y"}]}}
    assert plan.order_of(Recipe.model_validate(requested), 0)[-1].name == "y-down"


def test_a_rate_table_that_does_not_tilt_keeps_the_listed_order() -> None:
    table = tumble.recipe("n-point", "gyroscope", runs=[{"order": "fastest"}])
    assert plan.order_of(table, 0) == table.positions


def test_many_positions_take_two_thirds_of_the_time() -> None:
    ups = directions.SOLIDS[24]
    listed = np.random.default_rng(4).permutation(24)
    requested = recipe([tumble.position(f"p{i:02d}", ups[i]) for i in listed])
    assert moving_s(requested, plan.order_of(requested, 0)) < 0.67 * moving_s(requested, requested.positions)


def test_forbidden_moves_are_not_made_where_others_are_open() -> None:
    requested = random_moves(5, 16)
    walls = np.triu(np.ones((16, 16), bool), 3)
    blocked = MoveTimes(np.where(walls, FORBIDDEN_S, requested.between), requested.start, requested.end)
    assert blocked.of(ordering.search(blocked)) < FORBIDDEN_S


@pytest.mark.parametrize(
    ("run", "printed"),
    [
        ({"order": "listed", "first": "z-up"}, "first needs order: fastest"),
        ({"order": "fastest", "first": "z-up", "last": "z-up"}, "a run visits a position once"),
        ({"order": "fastest", "last": "zup"}, "the nearest is 'z-up'"),
    ],
)
def test_ends_that_cannot_be_kept_are_refused(run: dict[str, str], printed: str) -> None:
    with pytest.raises(ValidationError, match=printed):
        recipe(None, run)


def test_angles_are_those_of_the_shortest_turn() -> None:
    about_x = np.stack([rotation.about(np.array([1.0, 0, 0]), a) for a in (0.0, 90.0, 350.0)])
    expected: Floats = np.array([[0.0, 90, 10], [90, 0, 100], [10, 100, 0]])
    assert moves.angles_deg(about_x, about_x) == pytest.approx(expected, abs=1e-6)
