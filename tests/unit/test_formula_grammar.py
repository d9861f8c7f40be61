"""The grammar of formulas: every term has a unit, nothing inconsistent can be built, and all notations agree."""

from fractions import Fraction
from itertools import product
from xml.etree import ElementTree

import numpy as np
import pytest

from station.diagnosis.discovery.price import family_price
from station.errors import InputError
from station.model.campaign import scene_of_plan
from station.model.formula.dimension import DEGREE, NUMBER, READING, SECOND
from station.model.formula.expression import Call, Expression, Number, Sum, Variable, evaluate, size
from station.model.formula.grammar import CONSTANTS, INPUTS, MODULATORS, columns_of
from station.model.formula.term import Term
from station.model.formula.term_effect import effect_of, term_of
from station.model.formula.text import formula_mathml, formula_text
from station.model.forward import ActiveEffect, BaseResponse, forward, sensor_signal
from station.model.scene import Scene
from tests.blind.recipes import recipe


def term(input_: str, modulator: str, of: str = "unit") -> Term:
    """A term of every axis, its constants as usual."""
    factors = INPUTS[input_], MODULATORS[modulator]
    axes = tuple(c.label for c in columns_of(*factors))
    bare = object.__new__(Term)
    for name, value in (("input", input_), ("modulator", modulator)):
        object.__setattr__(bare, name, value)
    return Term(input_, modulator, axes, of, tuple((f, CONSTANTS[f].typical) for f in bare.fields))


ALL = [term(i, m) for i, m in product(INPUTS, MODULATORS) if not INPUTS[i].frame or m == "constant"]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_of_plan(recipe(), ("A",), seed=1)


def test_every_term_has_a_unit_a_text_and_a_drawing() -> None:
    for t in ALL:
        for tree in (f.tree for f in t.factors):
            assert tree.dimension.times(NUMBER) == tree.dimension
        assert ElementTree.fromstring(f"<math>{formula_mathml(t)}</math>") is not None
        assert "c" in formula_text(t) or t.is_turn


@pytest.mark.parametrize(
    ("input_", "modulator", "unit"),
    [
        ("own-squared", "temperature", "1/(u·degC)"),
        ("one", "root-time", "u/√s"),
        ("own", "temperature-rate", "s/degC"),
        ("all-three", "motor", "1/u²"),
        ("one", "decay", "u"),
        ("harmonic-2", "constant", "u"),
    ],
)
def test_the_unit_of_the_coefficient_follows_from_the_tree(input_: str, modulator: str, unit: str) -> None:
    assert term(input_, modulator).unit.text() == unit


def test_what_does_not_fit_cannot_be_built() -> None:
    with pytest.raises(InputError, match="one unit, not of s and degC"):
        Sum((Variable("t"), Variable("T")))
    with pytest.raises(InputError, match="exp takes a pure number, not one in s"):
        Call("exp", Variable("t"))
    with pytest.raises(InputError, match="no variable 'os'"):
        Variable("os")
    with pytest.raises(InputError, match="no function 'eval'"):
        Call("eval", Number(Fraction(1)))


@pytest.mark.parametrize("tree", [Variable("T"), Call("sign", Variable("motor"))])
def test_a_positive_part_is_as_long_as_what_it_stands_for(tree: Expression) -> None:
    whole = Sum((tree, Call("abs", tree)))
    values = {("T", ""): np.array([-2.0, 0.0, 3.0]), ("motor", ""): np.array([0.5, -1.0, 0.0])}
    part = Call("positive", tree)
    assert np.array_equal(evaluate(part, values, {}), evaluate(whole, values, {}) / 2)
    assert size(part) == size(whole)


def test_a_corner_is_dearer_than_a_square_and_both_than_a_line() -> None:
    line, square, corner = (family_price("own", f"temperature{form}", 1) for form in ("", "-squared", "-kink"))
    assert line < square < corner


@pytest.mark.parametrize(
    ("input_", "modulator", "axes", "constants", "says"),
    [
        ("own-quartic", "constant", ("x",), (), "input 'own-quartic' is not in the grammar"),
        ("own", "__import__('os')", ("x",), (), "modulator \"__import__('os')\" is not in the grammar"),
        ("own", "constant", ("w",), (), "axes w are not those of this formula"),
        ("own", "decay", ("x",), (), "constants are time_constant_s, not none"),
        ("own", "decay", ("x",), (("time_constant_s", -1.0),), "Constant time_constant_s is -1; write a number from"),
        ("own-saturation", "motor", ("x",), (("bend_u", 0.0),), "Constant bend_u is 0; write a number from 1e-09 to"),
        ("own-dead-band", "motor", ("x",), (("bend_u", -0.5),), "Constant bend_u is -0.5; write a number from 1e-09"),
        ("own", "decay", ("x",), (("time_constant_s", float("nan")),), "Constant time_constant_s is nan"),
        ("turn-nest", "time", ("x",), (), "cannot be modulated"),
    ],
)
def test_a_term_outside_the_grammar_is_refused(
    input_: str, modulator: str, axes: tuple[str, ...], constants: tuple[tuple[str, float], ...], says: str
) -> None:
    with pytest.raises(InputError) as found:
        Term(input_, modulator, axes, "unit", constants)
    assert says in str(found.value)


def test_a_term_is_worth_what_its_formula_says(scene: Scene) -> None:
    """Against numpy written by hand, for a term of each kind."""
    signal = sensor_signal(scene)
    a, t = signal.true, scene.time_s
    T = scene.require("temperature_degC")
    by_hand = {
        ("own-squared", "temperature", "z"): a[:, 2] ** 2 * (T - 25),
        ("own-other", "root-time", "x:y"): a[:, 0] * a[:, 1] * np.sqrt(t),
        ("others", "motor", "y"): a[:, 2] * a[:, 0] * scene.require("motor"),
        ("own-size", "decay", "x"): np.abs(a[:, 0]) * np.exp(-t / 20),
        ("own-kink", "constant", "z"): np.maximum(a[:, 2] - 0.5, 0),
        ("own-dead-band", "constant", "z"): np.sign(a[:, 2]) * np.maximum(np.abs(a[:, 2]) - 0.5, 0),
        ("other", "wave", "x:z:sin"): a[:, 2] * np.sin(2 * np.pi * 0.05 * t),
        ("step", "decay-since-arrival", "y"): signal.step[:, 1] * np.exp(-scene.require("since_arrival_s") / 20),
        ("one", "creep-since-clamp", "x"): np.log1p(scene.require("since_clamp_s") / 20),
    }
    for (input_, modulator, label), expected in by_hand.items():
        whole = term(input_, modulator)
        column = next(c for c in whole.columns if c.label == label)
        np.testing.assert_allclose(whole.column(column, signal), expected, atol=2e-5)


def test_a_term_is_an_effect_that_adds_and_knows_itself(scene: Scene) -> None:
    base = BaseResponse.ideal(1)
    for t in ALL[::7]:
        effect = effect_of(t, "found", 1e-3)
        assert term_of(effect) == t
        c = np.full((1, len(effect.axes)), 1e-3)
        one = forward(scene, base, {"found": ActiveEffect(effect, c, "unit")}) - forward(scene, base)
        two = forward(scene, base, {"found": ActiveEffect(effect, 2 * c, "unit")}) - forward(scene, base)
        np.testing.assert_allclose(two, 2 * one, atol=0.01 * max(float(np.abs(one).max()), 1e-9))


def test_dimensions_multiply() -> None:
    assert READING.times(SECOND.power(Fraction(-1))).text() == "u/s"
    assert DEGREE.power(Fraction(2)).text() == "degC²"
    assert NUMBER.text() == "1"
