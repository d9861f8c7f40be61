"""A model file edited by hand: what no cause has is refused with its place; what the station writes never is."""

from pathlib import Path

import pytest

from station import plugins
from station.config.models import load_model
from station.domain.core.types import Floats
from station.errors import InputError
from station.model.effect import Effect
from station.model.model_check import model_mistakes
from station.model.model_file import EFFECTS, Model, measured_parameter

MODEL = """schema: station.model/1
noise: {density: 1.0e-4}
effects:
- effect: cross-axis
  parameters: [{name: coefficient, axis: xy, of: common, value: 0.001, std: 1.0e-5, unit: '1'}]
- effect: warm-up
  parameters: [{name: amplitude, axis: x, of: 'unit:SN1', value: 0.002, unit: g}, {name: time_constant, value: 100.0}]
- effect: formula-1
  parameters:
  - {name: coefficient, axis: z, of: common, value: 2.0e-05, std: 1.6e-06, unit: 1/(g·degC)}
  - {name: about, of: common, value: 25.0, unit: degC}
  term: {input: own-squared, modulator: temperature, axes: [z], of: common, constants: {about_degC: 25.0},
    unit: 1/(g·degC)}
  equivalent:
  - parameters: [{name: coefficient, axis: z, of: common, value: 2.0e-05, unit: 1/degC}]
    term: {input: own-size, modulator: temperature, axes: [z], of: common, constants: {about_degC: 25.0}, unit: 1/degC}
"""
FORMULA = MODEL.index("- effect: formula-1")


def load(text: str, folder: Path, unit: str | None = "g") -> Model:
    path = folder / "model.yaml"
    path.write_text(text, encoding="utf-8")
    return load_model(path, unit)


@pytest.mark.parametrize(
    ("old", "new", "key", "says"),
    [
        ("effect: cross-axis", "effect: os.system", "effects.0.effect", "no 'os.system' among the effects"),
        ("effect: cross-axis", "effect: __init__", "effects.0.effect", "no '__init__' among the effects"),
        ("{name: coefficient, axis: xy", "{name: slope, axis: xy", "effects.0.parameters.0.name", "it has coefficient"),
        ("axis: xy", "axis: xq", "effects.0.parameters.0.axis", "no axis 'xq'; it has xy, xz, yz"),
        ("common, value: 0.001", "galaxy, value: 0.001", "effects.0.parameters.0.of", "not shared by 'galaxy'"),
        ("common, value: 0.001", "'nest:', value: 0.001", "effects.0.parameters.0.of", "not shared by 'nest:'"),
        ("value: 0.001", "value: .nan", "effects.0.parameters.0.value", "coefficient is nan; write a number from"),
        ("value: 0.001", "value: -.inf", "effects.0.parameters.0.value", "coefficient is -inf"),
        ("value: 0.001", "value: 1e7", "effects.0.parameters.0.value", "coefficient is 1e+07"),
        ("value: 0.001", "value: much", "effects.0.parameters.0.value", "'much' of cross-axis is not a number"),
        ("value: 0.001", "value: [1, 2]", "effects.0.parameters.0.value", "must be a number, not [1, 2]"),
        ("value: 0.001", "value: true", "effects.0.parameters.0.value", "must be a number, not true"),
        ("std: 1.0e-5", "std: .nan", "effects.0.parameters.0.std", "write a number from 0 to"),
        ("std: 1.0e-5", "std: -1", "effects.0.parameters.0.std", "A standard deviation is -1"),
        ("unit: '1'", "unit: parsec", "effects.0.parameters.0.unit", "'parsec' is not that of coefficient"),
        ("value: 100.0", "value: 0", "effects.1.parameters.1.value", "time_constant of warm-up is '0.0'"),
        ("value: 100.0", "value: -5", "effects.1.parameters.1.value", "write a number from 0.01 to"),
        ("value: 100.0", "value: long", "effects.1.parameters.1.value", "time_constant of warm-up is 'long'"),
        ("- effect: warm-up", "- effect: warm-up\n  shape: {time_constant_s: -1}", "effects.1.shape", "is '-1.0'"),
        ("- effect: warm-up", "- effect: warm-up\n  shape: {__class__: 1}", "effects.1.shape", "'__class__'"),
        ("effect: formula-1", "effect: 'a\"; import os'", "effects.2.effect", "is no name of an effect"),
        ("effect: formula-1", "effect: formula-1\n  shape: {about_degC: 9}", "effects.2.shape.about_degC", "but 25 in"),
        ("effect: formula-1", "effect: formula-1\n  shape: {tau_s: 5}", "effects.2.shape", "'tau_s'"),
        ("effect: formula-1", "effect: cubic", "effects.2.effect", "There is an effect cubic already"),
        ("value: 25.0", "value: 99", "effects.2.parameters.1.value", "about is 99.0 here, but 25 in the term"),
        ("{about_degC: 25.0},\n", "{about_degC: true},\n", "effects.2.term.constants.about_degC", "a number, not true"),
        ("    unit: 1/(g·degC)}", "    unit: 1/(uT·degC)}", "effects.2.term.unit", "is in 1/(g·degC)"),
        ("unit: 1/degC}]", "unit: 1/g}]", "effects.2.equivalent.0.parameters.0.unit", "Unit '1/g' is not"),
        ("density: 1.0e-4", "density: 1e200", "noise.density", "must be at most"),
    ],
)  # fmt: skip
def test_what_no_cause_has_is_one_sentence_with_its_place(
    old: str, new: str, key: str, says: str, tmp_path: Path
) -> None:
    assert old in MODEL
    with pytest.raises(InputError) as found:
        load(MODEL.replace(old, new, 1), tmp_path)
    said = str(found.value)
    assert f"key `{key}" in said and says in said and said.count("line ") == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (MODEL + MODEL[FORMULA:], "Two formulas are called formula-1"),
        (MODEL.replace("name: coefficient, axis: z", "name: about, axis: z", 1), "The formula has no coefficient"),
        (MODEL.replace("z, of: common, value: 2.0e-05, s", "z, of: 'nest:A', value: 1, s"), "write one of common"),
        (MODEL.replace("  - {name: about", MODEL.splitlines()[9] + "\n  - {name: about"), "stands twice"),
    ],
)  # fmt: skip
def test_what_is_there_twice_or_not_at_all_is_said(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says):
        load(text, tmp_path)


def test_a_model_is_of_its_recipes_unit(tmp_path: Path) -> None:
    assert len(load(MODEL, tmp_path).effects) == len(load(MODEL, tmp_path, None).effects) == 3
    with pytest.raises(InputError, match=r"'g' is not that of amplitude, which is in uT"):
        load(MODEL, tmp_path, "uT")


@pytest.mark.parametrize("unit", ["g", "deg"])
def test_a_formula_of_any_sensor_is_read(unit: str, tmp_path: Path) -> None:
    assert load("effects:\n" + MODEL[FORMULA:].replace("(g·", f"({unit}·"), tmp_path, unit).effects


def test_a_deviation_that_the_data_do_not_tell_is_left_out() -> None:
    row = {"name": "coefficient", "axis": "xy", "of": "common", "value": 0.1, "unit": "1"}
    assert [measured_parameter({**row, "std": std}).std for std in (float("inf"), float("nan"), None, 0.2)] == [
        None
    ] * 3 + [0.2]


@pytest.mark.parametrize("name", plugins.names(EFFECTS))
def test_what_the_station_writes_of_a_cause_is_read(name: str) -> None:
    kind: type[Effect] = plugins.load(EFFECTS, name)
    effect = kind.example()
    names = ("common",) if effect.of[0] == "common" else (f"{effect.of[0]}:one", f"{effect.of[0]}:two")
    coefficients: Floats = effect.coefficients(names, seed=1)
    rows = effect.parameter_rows(names, coefficients, "deg/s")
    shape = {form.field: getattr(effect, form.field) for form in effect.forms}
    listed = [{"effect": name, "parameters": rows}, {"effect": name, "parameters": rows, "shape": shape}]
    assert list(model_mistakes(Model.model_validate({"effects": listed}), "deg/s")) == []
