"""A term as model files have it, checked before anything is made of it: words of the grammar and numbers, no text that
is ever evaluated."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field, model_validator

from station.domain.recipe import readings
from station.domain.recipe.fields import Number, StrictModel
from station.errors import InputError, InvalidValue
from station.model.effect import unit_in
from station.model.formula.expression import constants
from station.model.formula.grammar import INPUTS, MODULATORS
from station.model.formula.term import Term
from station.model.formula.text import formula_text


class ModelTerm(StrictModel):
    """A term. formula: as people read it, which must be that of the tree; source: where it was found."""

    input: str
    modulator: str = "constant"
    axes: tuple[str, ...]
    of: str = "unit"
    constants: Mapping[str, Number] = Field(default_factory=dict)
    unit: str
    formula: str = ""
    source: Annotated[str, Field(pattern=r"^[A-Za-z0-9 .,;:%()=+-]{0,100}$")] = ""

    @model_validator(mode="after")
    def _is_of_the_grammar(self) -> "ModelTerm":
        try:
            term = self.term()
        except InvalidValue:
            raise
        except InputError as exc:
            raise InvalidValue(exc.message) from None
        unit = "rad" if term.is_turn else term.unit.text()
        if not any(unit_in(unit, u) == self.unit for u in ("u", *readings.known_units())):
            raise InvalidValue("formula-unit", unit=self.unit[:40], needed=unit)
        if self.formula and self.formula != formula_text(term):
            raise InvalidValue("formula-text", text=self.formula[:80], tree=formula_text(term))
        return self

    def term(self) -> Term:
        """The term. Errors: InputError."""
        ordered = tuple(sorted(self.constants.items()))
        return Term(self.input, self.modulator, self.axes, self.of, _in_order(self.input, self.modulator, ordered))


def _in_order(input_: str, modulator: str, pairs: tuple[tuple[str, float], ...]) -> tuple[tuple[str, float], ...]:
    """Constants in the order of the tree; what the tree does not know comes last."""
    trees = [f.tree for f in (INPUTS.get(input_), MODULATORS.get(modulator)) if f is not None]
    order = [c for tree in trees for c in constants(tree)]
    return tuple(sorted(pairs, key=lambda pair: order.index(pair[0]) if pair[0] in order else len(order)))
