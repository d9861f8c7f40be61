"""Which causes belong into a calibration: those of the device that an offset and a matrix hold whatever the pose."""

import pytest

from station import plugins
from station.config.recipes import load_recipe
from station.errors import RecipeError
from station.model.compensated import compensate, in_matrix
from station.model.effect import Effect
from station.model.model_file import EFFECTS, Model


def model(*effects: str) -> Model:
    return Model.model_validate({"schema": "station.model/1", "effects": [{"effect": e} for e in effects]})


@pytest.mark.parametrize("name", ["offset-gain", "magnetometer-n-point", "gyroscope-n-point"])
def test_of_the_device_only_angles_are_of_offset_and_matrix(name: str) -> None:
    recipe = load_recipe(name)
    kinds: dict[str, type[Effect]] = {e: plugins.load(EFFECTS, e) for e in plugins.names(EFFECTS)}
    device = {e: k.example() for e, k in kinds.items() if k.level == "device" and k.acts_on(recipe)}
    assert {e for e, made in device.items() if in_matrix(made, recipe)} == {"cross-axis", "package-rotation"}


def test_the_recipe_then_fits_the_matrix_and_says_what_stays() -> None:
    found = compensate(load_recipe("offset-gain"), model("cross-axis", "quadratic", "nest-tilt"), gains_only=False)
    assert (found.recipe.model, found.causes) == ("matrix", ("cross-axis",))
    assert found.uncompensated == (
        "quadratic is no part of offset and matrix, which is all that the device keeps; it stays in the device's "
        "output",
        "nest-tilt is of the rig and not of the device, so no calibration takes it in; have it put right",
    )


def test_nothing_changes_where_nothing_can_be_taken_in() -> None:
    recipe = load_recipe("offset-gain")
    found = compensate(recipe, model("quadratic"), gains_only=False)
    assert found.recipe is recipe
    assert not found.causes


def test_a_product_of_gains_alone_and_a_method_of_gains_alone_keep_it_out() -> None:
    gains = compensate(load_recipe("offset-gain"), model("cross-axis"), gains_only=True)
    three = compensate(load_recipe("three-point"), model("cross-axis"), gains_only=False)
    assert not gains.causes
    assert "keeps offsets and gains only" in gains.uncompensated[0]
    assert not three.causes
    assert "method three-point does not determine; use method: n-point" in three.uncompensated[0]


def test_positions_that_do_not_show_it_are_refused_with_those_to_add() -> None:
    recipe = load_recipe("offset-gain")
    flat = recipe.model_copy(update={"positions": recipe.positions[:5]})
    short = flat.model_copy(update={"positions": tuple(p for p in flat.positions if p.name != "x-up")[:3]})
    with pytest.raises(RecipeError, match=r"Compensating cross-axis is not possible: .* undetermined .*add") as refused:
        compensate(short, model("cross-axis"), gains_only=False)
    assert "\n" not in refused.value.sentence
