"""What a cause that nobody has written down may look like: what the axis feels × how it is modulated × who shares it.

An input says which axes it speaks of: i is the axis of the reading; j and k are the others, i → j → k → i where no
other axis is named. A column of a term is one coefficient: "z" on z; "z:x" on z, of x; ":sin" the sine of a wave.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Literal, NamedTuple

from station.model.formula.dimension import DEGREE, HERTZ, READING, SECOND, Dimension
from station.model.formula.expression import (
    PI,
    Call,
    Constant,
    Expression,
    Multiplication,
    Number,
    Power,
    Sum,
    Variable,
)

Layout = Literal["own", "pair", "any"]
XYZ = ("x", "y", "z")


class ConstantKind(NamedTuple):
    """A free constant: name and unit as `Parameter` has them, its dimension, and the range that makes sense."""

    name: str
    unit: str
    dimension: Dimension
    typical: float
    low: float
    high: float


#: Free constants by the field that holds them.
CONSTANTS: Mapping[str, ConstantKind] = {
    "about_degC": ConstantKind("about", "degC", DEGREE, 25.0, -300.0, 400.0),
    "kink_degC": ConstantKind("kink", "degC", DEGREE, 25.0, -300.0, 400.0),
    "time_constant_s": ConstantKind("time_constant", "s", SECOND, 20.0, 1e-3, 1e6),
    "start_s": ConstantKind("start", "s", SECOND, 20.0, 0.0, 1e7),
    "cycles_hz": ConstantKind("cycles", "Hz", HERTZ, 0.05, 1e-7, 1e4),
    "bend_u": ConstantKind("bend", "u", READING, 0.5, -1e6, 1e6),
}

#: Inputs that bend alike to both sides: at a size, which is no less than this.
BENT_ALIKE, LEAST_BEND_U = frozenset({"own-dead-band", "own-saturation"}), 1e-9


@dataclass(frozen=True, slots=True)
class Factor:
    """An input or a modulator. forms: the tree of each phase, "" where it has but one; frame: of a turn, which is no
    tree; needs: covariates as `Effect.needs` has them."""

    name: str
    forms: tuple[tuple[str, Expression], ...]
    layout: Layout = "own"
    needs: tuple[str, ...] = ()
    frame: str = ""

    @property
    def tree(self) -> Expression:
        """The tree of the first phase."""
        return self.forms[0][1]


def _constant(field: str) -> Constant:
    return Constant(field, CONSTANTS[field].dimension)


def _over(top: Expression, below: Expression) -> Expression:
    return Multiplication((top, Power(below, Fraction(-1))))


def _less(one: Expression, other: Expression) -> Expression:
    return Sum((one, Multiplication((Number(Fraction(-1)), other))))


ONE = Number(Fraction(1))
A, B, C = (Variable("a", place) for place in "ijk")
STEP, STEP_J, PREVIOUS = Variable("step", "i"), Variable("step", "j"), Variable("previous", "i")
BEND = _constant("bend_u")


def _squared(tree: Expression) -> Expression:
    return Power(tree, Fraction(2))


def _cubed(tree: Expression) -> Expression:
    return Power(tree, Fraction(3))


def _plain(name: str, tree: Expression, layout: Layout = "own", needs: tuple[str, ...] = ()) -> Factor:
    return Factor(name, (("", tree),), layout, needs)


def _harmonic(m: int) -> Factor:
    angle = Multiplication((Number(Fraction(m)), Variable("angle", "j")))
    return Factor(f"harmonic-{m}", (("cos", Call("cos", angle)), ("sin", Call("sin", angle))), "any")


#: What the axis feels.
INPUTS: Mapping[str, Factor] = {
    f.name: f
    for f in (
        _plain("one", ONE),
        _plain("own", A),
        _plain("other", B, "pair"),
        _plain("own-squared", _squared(A)),
        _plain("own-other", Multiplication((A, B)), "pair"),
        _plain("other-squared", _squared(B), "pair"),
        _plain("others", Multiplication((B, C))),
        _plain("own-cubed", _cubed(A)),
        _plain("own-squared-other", Multiplication((_squared(A), B)), "pair"),
        _plain("own-other-squared", Multiplication((A, _squared(B))), "pair"),
        _plain("all-three", Multiplication((A, B, C))),
        _plain("other-cubed", _cubed(B), "pair"),
        _plain("other-squared-third", Multiplication((_squared(B), C)), "pair"),
        _plain("own-size", Call("abs", A)),
        _plain("other-size", Call("abs", B), "pair"),
        _plain("own-signed-square", Multiplication((A, Call("abs", A)))),
        _plain("step", STEP),
        _plain("step-size", Call("abs", STEP)),
        _plain("step-other", STEP_J, "pair"),
        _plain("step-squared", _squared(STEP)),
        _plain("previous", PREVIOUS),
        _plain("previous-squared", _squared(PREVIOUS)),
        _harmonic(1),
        _harmonic(2),
        _harmonic(3),
        _harmonic(4),
        _plain("own-kink", Call("positive", _less(A, BEND))),
        _plain(
            "own-dead-band", Multiplication((Call("sign", A), Call("positive", _less(Call("abs", A), BEND))))
        ),
        _plain("own-saturation", Multiplication((BEND, Call("tanh", _over(A, BEND))))),
        Factor("turn-device", (("", ONE),), "own", (), "device"),
        Factor("turn-nest", (("", ONE),), "own", (), "nest"),
        Factor("turn-station", (("", ONE),), "own", (), "station"),
    )
}  # fmt: skip


def _decay(clock: str) -> Expression:
    minus = Multiplication((Number(Fraction(-1)), _over(Variable(clock), _constant("time_constant_s"))))
    return Call("exp", minus)


def _creep(clock: str) -> Expression:
    return Call("log1p", _over(Variable(clock), _constant("time_constant_s")))


WARMER = _less(Variable("T"), _constant("about_degC"))
WAVE = Multiplication((Number(Fraction(2)), Number(PI), _constant("cycles_hz"), Variable("t")))
POWERED, CLAMPED, ARRIVED = ("since_power_s",), ("since_clamp_s",), ("since_arrival_s",)

#: How it is modulated.
MODULATORS: Mapping[str, Factor] = {
    f.name: f
    for f in (
        _plain("constant", ONE),
        _plain("temperature", WARMER, needs=("temperature_degC",)),
        _plain("temperature-squared", _squared(WARMER), needs=("temperature_degC",)),
        _plain("temperature-cubed", _cubed(WARMER), needs=("temperature_degC",)),
        _plain(
            "temperature-kink",
            Call("positive", _less(Variable("T"), _constant("kink_degC"))),
            needs=("temperature_degC",),
        ),
        _plain("temperature-rate", Variable("T_rate"), needs=("temperature_rate",)),
        _plain("time", Variable("t")),
        _plain("time-squared", _squared(Variable("t"))),
        _plain("root-time", Power(Variable("t"), Fraction(1, 2))),
        _plain("decay", _decay("t")),
        _plain("after", Call("sign", Call("positive", _less(Variable("t"), _constant("start_s"))))),
        _plain("decay-since-power", _decay("t_power"), needs=POWERED),
        _plain("creep-since-power", _creep("t_power"), needs=POWERED),
        _plain("decay-since-clamp", _decay("t_clamp"), needs=CLAMPED),
        _plain("creep-since-clamp", _creep("t_clamp"), needs=CLAMPED),
        _plain("decay-since-arrival", _decay("t_arrival"), needs=ARRIVED),
        _plain("motor", Variable("motor"), needs=("motor",)),
        _plain("motor-squared", _squared(Variable("motor")), needs=("motor",)),
        Factor("wave", (("cos", Call("cos", WAVE)), ("sin", Call("sin", WAVE)))),
    )
}

#: The groups of a rig that may share a coefficient, and everybody who may.
GROUP_LEVELS = ("nest", "station", "lot", "operator", "position", "run", "power-on")
SHARED_BY = ("unit", "common", *GROUP_LEVELS)


class FormulaColumn(NamedTuple):
    """One coefficient of a term: its label, the axis of the reading, the axis of j, the phases of input and
    modulator."""

    label: str
    i: int
    j: int
    phase: str
    wave: str


def columns_of(input_: Factor, modulator: Factor) -> tuple[FormulaColumn, ...]:
    """Every coefficient that a product may have."""
    return _columns_of(input_.name, modulator.name)


@cache
def _columns_of(input_name: str, modulator_name: str) -> tuple[FormulaColumn, ...]:
    input_, modulator = INPUTS[input_name], MODULATORS[modulator_name]
    found = []
    for i in range(3):
        axes = {"own": ((i + 1) % 3,), "pair": tuple(j for j in range(3) if j != i), "any": (0, 1, 2)}[input_.layout]
        for j in axes:
            place = XYZ[i] if input_.layout == "own" else f"{XYZ[i]}:{XYZ[j]}"
            for phase, _ in input_.forms:
                for wave, _ in modulator.forms:
                    label = ":".join(part for part in (place, phase, wave) if part)
                    found.append(FormulaColumn(label, i, j, phase, wave))
    return tuple(found)
