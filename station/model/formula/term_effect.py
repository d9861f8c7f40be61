"""A term as an effect of the simulation, like those of the effect files but made of its tree."""

from dataclasses import field, make_dataclass
from functools import lru_cache
from typing import Any, ClassVar, get_args

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import DrawnOver, Effect, Parameter, PoseEffect, SensorEffect
from station.model.formula.grammar import CONSTANTS, INPUTS, XYZ
from station.model.formula.term import Term
from station.model.formula.text import formula_text
from station.model.scene import Signal

#: Levels of the rig, not of the device.
RIG_LEVELS = ("nest", "station", "lot", "operator", "position")
#: No size is too large for a hypothesis: its data have shown it.
ANY_SIZE = 1e12


class FormulaEffect(SensorEffect):
    """A term that adds to the reading."""

    term: ClassVar[Term]

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """Σ c · input · modulator, each on its axis."""
        term = self.term.with_constants(**{f: float(getattr(self, f)) for f in self.term.fields})
        added = np.zeros((len(c), 3))
        # A derivative asks for one coefficient at a time: what has none is not worked out.
        acting = np.any(c, axis=0)
        for at, column in enumerate(term.columns):
            if acting[at]:
                added[:, column.i] += c[:, at] * term.column(column, signal)
        return added


class TurnEffect(PoseEffect):
    """A term that turns a part."""

    term: ClassVar[Term]


def term_of(effect: Effect) -> Term | None:
    """The term that an effect is made of, with its constants; None of an effect file's."""
    if not isinstance(effect, FormulaEffect | TurnEffect):
        return None
    return effect.term.with_constants(**{f: float(getattr(effect, f)) for f in effect.term.fields})


def effect_of(term: Term, name: str, typical: float, source: str = "") -> Effect:
    """The effect that a term is. typical: rms of its coefficients, in the recipe's unit."""
    kind = effect_class(term, name, abs(typical) or 1.0, source)
    found: Effect = kind(abs(typical) or 1.0, *(value for _, value in term.constants))
    return found


@lru_cache(maxsize=1024)
def effect_class(term: Term, name: str, typical: float, source: str) -> Any:
    """The class of that effect."""
    parameter = parameter_of(term, typical, source)
    forms = tuple(_form(f, value, source) for f, value in term.constants)
    turn = term.is_turn
    namespace: dict[str, Any] = {
        "__module__": __name__,
        "__doc__": formula_text(term),
        "term": term,
        "physics": f"Found in data, not yet explained: {formula_text(term)}.",
        "remedy": "find what makes it, with the covariates of the formula as a guide",
        "shown_by": shown_by(term),
        "drawn_over": drawn_over(term),
        "level": "rig" if term.of in RIG_LEVELS else "device",
        "of": (term.of,),
        "axes": term.axes,
        "parameter": parameter,
        "forms": forms,
        "needs": term.needs,
        "pose_free": not turn,
    }
    if turn:
        namespace["frame"] = INPUTS[term.input].frame
    fields: list[tuple[str, Any, Any]] = [("size", float, field(default=typical))]
    fields += [(f, float, field(default=value)) for f, value in term.constants]
    base = TurnEffect if turn else FormulaEffect
    made = make_dataclass("Hypothesis", fields, bases=(base,), namespace=namespace, frozen=True)
    made.id = name  # type: ignore[attr-defined]
    return made


def parameter_of(term: Term, typical: float, source: str) -> Parameter:
    """The coefficient of a term."""
    unit = "rad" if term.is_turn else term.unit.text()
    return Parameter("angle" if term.is_turn else "coefficient", unit, typical, 0.0, ANY_SIZE, source)


def _form(field_: str, value: float, source: str) -> Parameter:
    kind = CONSTANTS[field_]
    return Parameter(kind.name, kind.unit, value, kind.low, kind.high, source)


def drawn_over(term: Term) -> str:
    """What its residual is drawn against."""
    over = {
        "temperature_degC": "temperature-input" if term.input != "one" else "temperature",
        "temperature_rate": "temperature-rate",
        "since_power_s": "since-power",
        "since_clamp_s": "since-clamp",
        "since_arrival_s": "dwell",
        "motor": "motor",
    }
    found = next((over[n] for n in term.needs), "")
    if not found and term.modulator != "constant":
        found = "time"
    if not found:
        found = {"one": "group", "other": "other-axis", "own-other": "input-product"}.get(term.input, "input")
        found = "step" if term.input.startswith("step") else found
        found = "position" if term.is_turn or term.of == "position" else found
    assert found in get_args(DrawnOver)
    return found


def shown_by(term: Term) -> str:
    """The change of a recipe that shows it where another hides it."""
    changes = {
        "temperature_degC": "add a run 10 °C warmer",
        "temperature_rate": "let the temperature rise and fall within a run",
        "since_power_s": "add a run with the units powered long before",
        "since_clamp_s": "add a run without opening the clamp",
        "since_arrival_s": "set `settle.time_s` to 0, so that the dwell begins during the move's last swing",
        "motor": "add a run with the motors off (`motors: off`)",
    }
    found = next((changes[n] for n in term.needs), "")
    if not found and term.modulator != "constant":
        found = "add a run in another order, and a slow one"
    return found or "add positions between those of the recipe"


__all__ = ["XYZ", "FormulaEffect", "TurnEffect", "drawn_over", "effect_of", "shown_by", "term_of"]
