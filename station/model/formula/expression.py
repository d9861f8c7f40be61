"""Formulas as trees whose every node has a unit: what does not fit cannot be built.

Expression
├── Number      a pure number
├── Variable    what the axis feels, a temperature, a clock; `place` says whose axis: i, j or k
├── Constant    a free number of the formula, with its unit: a time constant, a bend
├── Sum         of one unit
├── Multiplication
├── Power       of a fixed exponent
└── Call        a function; of a pure number where it asks for one
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import assert_never

import numpy as np

from station.domain.core.types import Array, Floats
from station.errors import InputError
from station.model.formula.dimension import DEGREE, DEGREE_RATE, NUMBER, READING, SECOND, Dimension

#: What a formula may speak of, with its unit. a: what the axis feels; step: how much more it felt at the visit before;
#: previous: what it felt there; angle: of the turn about the axis.
VARIABLES: Mapping[str, Dimension] = {
    "a": READING,
    "step": READING,
    "previous": READING,
    "angle": NUMBER,
    "T": DEGREE,
    "T_rate": DEGREE_RATE,
    "t": SECOND,
    "t_power": SECOND,
    "t_clamp": SECOND,
    "t_arrival": SECOND,
    "motor": NUMBER,
}
#: Stands for π in a tree, whose numbers are ratios: that of Zu Chongzhi.
PI = Fraction(355, 113)
#: Functions: whether they ask for a pure number, and whether they give one.
FUNCTIONS: Mapping[str, tuple[bool, bool]] = {
    "exp": (True, True),
    "log1p": (True, True),
    "sin": (True, True),
    "cos": (True, True),
    "tanh": (True, True),
    "abs": (False, False),
    "positive": (False, False),
    "sign": (False, True),
}


@dataclass(frozen=True, slots=True)
class Number:
    """A pure number."""

    value: Fraction

    @property
    def dimension(self) -> Dimension:
        """None."""
        return NUMBER


@dataclass(frozen=True, slots=True)
class Variable:
    """What was measured or is known. InputError where the grammar has no such."""

    name: str
    place: str = ""

    def __post_init__(self) -> None:
        if self.name not in VARIABLES:
            raise InputError("formula-variable", name=self.name, names=tuple(VARIABLES))

    @property
    def dimension(self) -> Dimension:
        """Its unit."""
        return VARIABLES[self.name]


@dataclass(frozen=True, slots=True)
class Constant:
    """A free number, by the name of the field that holds it."""

    field: str
    dimension: Dimension


@dataclass(frozen=True, slots=True)
class Sum:
    """Terms of one unit; InputError where they differ."""

    terms: tuple["Expression", ...]

    def __post_init__(self) -> None:
        units = [t.dimension.text() for t in self.terms]
        if len(set(units)) > 1:
            raise InputError("formula-sum-units", units=tuple(units))

    @property
    def dimension(self) -> Dimension:
        """That of each."""
        return self.terms[0].dimension


@dataclass(frozen=True, slots=True)
class Multiplication:
    """Factors of any unit."""

    factors: tuple["Expression", ...]

    @property
    def dimension(self) -> Dimension:
        """The product's."""
        return reduce(Dimension.times, (f.dimension for f in self.factors), NUMBER)


@dataclass(frozen=True, slots=True)
class Power:
    """A fixed power."""

    base: "Expression"
    exponent: Fraction

    @property
    def dimension(self) -> Dimension:
        """The power's."""
        return self.base.dimension.power(self.exponent)


@dataclass(frozen=True, slots=True)
class Call:
    """A function; InputError where it asks for a pure number and is given another, or is none of the grammar's."""

    function: str
    argument: "Expression"

    def __post_init__(self) -> None:
        if self.function not in FUNCTIONS:
            raise InputError("formula-function", name=self.function, names=tuple(FUNCTIONS))
        if FUNCTIONS[self.function][0] and not self.argument.dimension.is_number:
            raise InputError("formula-argument-unit", name=self.function, unit=self.argument.dimension.text())

    @property
    def dimension(self) -> Dimension:
        """A pure number, or that of the argument."""
        return NUMBER if FUNCTIONS[self.function][1] else self.argument.dimension


Expression = Number | Variable | Constant | Sum | Multiplication | Power | Call


def evaluate(tree: Expression, values: Mapping[tuple[str, str], Array], constants: Mapping[str, float]) -> Floats:
    """The value (n) of a tree. values: of each variable by name and place; constants: by field."""
    match tree:
        case Number() | Variable() | Constant():
            return _leaf(tree, values, constants)
        case Sum(terms):
            return np.asarray(reduce(np.add, (evaluate(t, values, constants) for t in terms)))
        case Multiplication(factors):
            return np.asarray(reduce(np.multiply, (evaluate(f, values, constants) for f in factors)))
        case Power(base, exponent):
            return _raised(evaluate(base, values, constants), exponent)
        case Call(function, argument):
            return _called(function, evaluate(argument, values, constants))
    assert_never(tree)


def _leaf(
    tree: Number | Variable | Constant, values: Mapping[tuple[str, str], Array], constants: Mapping[str, float]
) -> Floats:
    if isinstance(tree, Number):
        return np.asarray(np.pi if tree.value == PI else float(tree.value))
    return np.asarray(constants[tree.field] if isinstance(tree, Constant) else values[tree.name, tree.place])


def _raised(x: Floats, exponent: Fraction) -> Floats:
    return np.asarray(np.sqrt(np.maximum(x, 0.0)) if exponent == Fraction(1, 2) else x ** float(exponent))


def _called(function: str, x: Floats) -> Floats:
    return np.asarray(np.maximum(x, 0.0) if function == "positive" else getattr(np, function)(x))


def variables(tree: Expression) -> frozenset[str]:
    """Names of the variables in a tree."""
    return frozenset(variable.name for variable in _variables_in(tree))


def places_of(tree: Expression) -> frozenset[str]:
    """Places of the variables in a tree."""
    return frozenset(variable.place for variable in _variables_in(tree))


def _variables_in(tree: Expression) -> Iterator[Variable]:
    match tree:
        case Variable():
            yield tree
        case Sum(parts) | Multiplication(parts):
            for part in parts:
                yield from _variables_in(part)
        case Power(part, _) | Call(_, part):
            yield from _variables_in(part)


def constants(tree: Expression) -> tuple[str, ...]:
    """Fields of the constants in a tree, each once, in the order of the text."""
    match tree:
        case Constant(field):
            return (field,)
        case Sum(parts) | Multiplication(parts):
            return tuple(dict.fromkeys(c for p in parts for c in constants(p)))
        case Power(part, _) | Call(_, part):
            return constants(part)
    return ()


def size(tree: Expression) -> int:
    """How many nodes a tree has: what it takes to write it down. A product and a minus sign are not counted; a positive
    part is (x + |x|)/2, so that what has a corner or a jump says its argument twice."""
    match tree:
        case Sum(parts):
            return sum(size(p) for p in parts)
        case Multiplication(parts):
            return sum(size(p) for p in parts if not isinstance(p, Number))
        case Power(part, exponent):
            # A cube is two products.
            return size(part) + (0 if exponent < 0 else max(1, int(exponent) - 1))
        case Call(function, part):
            return 1 + (2 if function == "positive" else 1) * size(part)
        case Number():
            return 0
    return 1
