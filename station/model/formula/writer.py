"""A tree walked and written down, in whatever notation: text, MathML, Python."""

from abc import ABC, abstractmethod
from fractions import Fraction
from typing import assert_never

from station.model.formula.expression import Call, Constant, Expression, Multiplication, Number, Power, Sum, Variable

MINUS_ONE, HALF = Number(Fraction(-1)), Fraction(1, 2)


class Writer(ABC):
    """One notation."""

    def write(self, tree: Expression) -> str:
        """A tree in this notation."""
        match tree:
            case Number() | Variable() | Constant():
                return self.leaf(tree)
            case Sum(terms):
                return self.sum(terms)
            case Multiplication(factors):
                return self.product(factors)
            case Power(base, exponent):
                return self.power(base, exponent)
            case Call(function, argument):
                return self.call(function, argument)
        assert_never(tree)

    @abstractmethod
    def leaf(self, tree: Number | Variable | Constant) -> str:
        """A number, a variable or a constant."""

    @abstractmethod
    def sum(self, terms: tuple[Expression, ...]) -> str:
        """A sum, in brackets."""

    @abstractmethod
    def product(self, factors: tuple[Expression, ...]) -> str:
        """A product; factors of power −1 go below."""

    @abstractmethod
    def power(self, base: Expression, exponent: Fraction) -> str:
        """A power."""

    @abstractmethod
    def call(self, function: str, argument: Expression) -> str:
        """A function's value."""


def split_product(factors: tuple[Expression, ...]) -> tuple[bool, list[Expression], list[Expression]]:
    """Whether a product has a minus sign, what stands above and what below."""
    above = [f for f in factors if f != MINUS_ONE and not (isinstance(f, Power) and f.exponent == -1)]
    below = [f.base for f in factors if isinstance(f, Power) and f.exponent == -1]
    return MINUS_ONE in factors, above, below


def without_minus(tree: Expression) -> tuple[bool, Expression]:
    """Whether a term of a sum is taken off, and the term without its sign."""
    if isinstance(tree, Multiplication) and MINUS_ONE in tree.factors:
        left = tuple(f for f in tree.factors if f != MINUS_ONE)
        return True, left[0] if len(left) == 1 else Multiplication(left)
    return False, tree
