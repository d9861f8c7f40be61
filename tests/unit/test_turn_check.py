"""Whether a fixture was turned, from readings with an unknown offset; and the words for where to turn it."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.config.recipes import load_recipe
from station.domain.capture import turn_check
from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.messages import render

COMPASS, ANGLES = load_recipe("magnetometer-n-point"), load_recipe("inclinometer-n-point")
unit_float = st.floats(-1.0, 1.0)


def truths(recipe: Recipe) -> list[Floats]:
    return [recipe.true_vector(p) for p in recipe.positions]


@given(st.data())
def test_any_offset_and_gains_of_a_tenth_show_the_wanted_position_and_no_unturned_one(data: Any) -> None:
    for recipe, offset_scale in ((COMPASS, 200.0), (ANGLES, 10.0)):
        last, true = (data.draw(st.sampled_from(truths(recipe))) for _ in range(2))
        offset = np.array([data.draw(unit_float) for _ in range(3)]) * offset_scale
        matrix = np.eye(3) + 0.1 * np.array([[data.draw(unit_float) for _ in range(3)] for _ in range(3)]) / np.sqrt(3)
        before, now = matrix @ last + offset, matrix @ true + offset
        assert turn_check.shows(now, true, (before, last), recipe)
        near = turn_check.NEAR_DEG if recipe.converts else turn_check.NEAR_SHARE * float(np.linalg.norm(true))
        if np.linalg.norm(true - last) * (1 - turn_check.GAIN_SHARE) > near * 1.001:
            assert not turn_check.shows(before, true, (before, last), recipe), "nobody has turned it"


def test_an_angle_tells_the_first_position_by_itself_and_goes_round() -> None:
    level, turned = np.zeros(3), np.array([30.0, 0, 0])
    assert turn_check.shows(np.array([3.0, -2, 0]), level, None, ANGLES)
    assert not turn_check.shows(turned, level, None, ANGLES)
    assert turn_check.shows(np.array([-179.5, 0, 0]), np.array([180.0, 0, 0]), None, ANGLES)


def test_a_calibrated_reading_must_be_the_position_itself() -> None:
    true = truths(COMPASS)[0]
    assert turn_check.shows_calibrated(true * 1.1, true, COMPASS)
    assert not turn_check.shows_calibrated(truths(COMPASS)[1], true, COMPASS)


@pytest.mark.parametrize(
    ("true", "words"),
    [
        ((0, 0, -1), "Bring position 'p' up (-z of the unit) and let go."),
        ((0, 0.1, 1), "Bring position 'p' up (+z of the unit) and let go."),
        ((0, -0.5, 0.8), "Bring position 'p' up (32° from +z towards -y of the unit) and let go."),
        ((1, 1, 1), "Bring position 'p' up (55° from +x towards +y, +z of the unit) and let go."),
    ],
)
def test_a_tilt_is_named_by_its_angle_and_where_it_leans(true: tuple[float, ...], words: str) -> None:
    assert render(turn_check.instruction("p", np.array(true, float), COMPASS)) == words


def test_angles_are_asked_for_as_the_unit_reads_them() -> None:
    shown = render(turn_check.instruction("p", np.array([30.0, -0.5, 0]), ANGLES))
    assert shown == "Bring the unit to position 'p', where it reads x +30.0°, y -0.5°, and let go."
