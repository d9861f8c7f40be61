"""Whether a model file says of each cause what the cause has: its names, axes, levels and units, each once, and numbers
that something real may have. What it is read as is `model_file`'s."""

from collections.abc import Iterator, Sequence

import numpy as np

from station import plugins
from station.domain.recipe import readings
from station.errors import InputError
from station.messages import Message
from station.model.effect import Coefficient, Effect, Parameter, unit_in
from station.model.formula.effect_file import NAME
from station.model.formula.model_term import ModelTerm
from station.model.formula.term import Term
from station.model.formula.term_effect import effect_of
from station.model.model_file import EFFECTS, Model, ModelEffect, ModelParameter

#: Where in a file a mistake is, and the sentence.
Mistake = tuple[tuple[str | int, ...], Message]

#: No coefficient is larger in any unit, and no parameter of a form further from its usual range, as a factor.
MOST_SIZE, FORM_FACTOR = 1e6, 1e3
#: Who may share a coefficient, as `Scene.group` has it.
LEVELS = (
    "common", "unit", "run", "power-on", "visit", "run-of-recipe", "nest", "position", "station", "lot", "operator",
)  # fmt: skip
#: What the station writes of a cause beside its parameters, for a person: nothing is simulated with it.
REMARKS = {"gold-drift": ("at", "rate")}


def model_mistakes(model: Model, unit: str | None) -> Iterator[Mistake]:
    """Everything in a model that no cause has. unit: of the recipe that it is for; None: of any sensor."""
    units = ("u", unit) if unit else ("u", *readings.known_units())
    for block, numbers in (("noise", model.noise), ("spread", model.spread)):
        for key, value in numbers:
            if value is not None and value > MOST_SIZE:
                yield (block, key), Message("value-above", limit=MOST_SIZE, given=value)
    named: set[str] = set()
    for i, effect in enumerate(model.effects):
        at = ("effects", i)
        if effect.term is None:
            yield from _of_library(effect, at, units)
            continue
        if not NAME.fullmatch(effect.effect):
            yield (*at, "effect"), Message("hypothesis-name", name=effect.effect[:40])
        elif effect.effect in plugins.names(EFFECTS):
            yield (*at, "effect"), Message("hypothesis-name-taken", name=effect.effect)
        elif effect.effect in named:
            yield (*at, "effect"), Message("model-formula-twice", name=effect.effect)
        named.add(effect.effect)
        yield from _of_formula(effect.effect, effect.term, effect.parameters, at, units)
        yield from _shape_of_formula(effect, effect.term.term(), at)
        for k, rival in enumerate(effect.equivalent):
            yield from _of_formula(effect.effect, rival.term, rival.parameters, (*at, "equivalent", k), units)


def _of_library(listed: ModelEffect, at: tuple[str | int, ...], units: Sequence[str]) -> Iterator[Mistake]:
    try:
        kind: type[Effect] = plugins.load(EFFECTS, listed.effect)
    except InputError as exc:
        yield (*at, "effect"), exc.message
        return
    wrong = list(_forms(kind, listed, at))
    yield from wrong
    if wrong:
        return
    try:
        effect = listed.build()
    except InputError as exc:
        yield (*at, "shape"), exc.message
        return
    yield from _parameters(effect, listed.parameters, at, units, LEVELS)


def _forms(kind: type[Effect], listed: ModelEffect, at: tuple[str | int, ...]) -> Iterator[Mistake]:
    """Parameters of a form that are no number, or far beyond what is usual."""
    given: list[tuple[tuple[str | int, ...], str, float | str]] = [
        *(((*at, "parameters", k, "value"), p.name, p.value) for k, p in enumerate(listed.parameters)),
        *(((*at, "shape", f.field), f.name, listed.shape[f.field]) for f in kind.forms if f.field in listed.shape),
    ]
    forms = {form.name: form for form in kind.forms}
    for place, name, value in given:
        if name not in forms:
            continue
        low, high = _range(forms[name])
        if isinstance(value, str) or not low <= value <= high:
            yield (
                place,
                Message("effect-form-value", name=name, effect=kind.id, text=f"{value}"[:40], low=low, high=high),
            )


def _of_formula(
    name: str, tree: ModelTerm, parameters: Sequence[ModelParameter], at: tuple[str | int, ...], units: Sequence[str]
) -> Iterator[Mistake]:
    term = tree.term()
    effect = effect_of(term, name[:40], 1.0)
    needed = effect.parameter.unit
    fitting = [u for u in units if unit_in(needed, u) == tree.unit]
    if not fitting:
        yield (*at, "term", "unit"), Message("formula-unit", unit=tree.unit[:40], needed=unit_in(needed, units[-1]))
    if not any(p.name == effect.parameter.name for p in parameters):
        yield (*at, "parameters"), Message("model-without-coefficient", name=effect.parameter.name)
    yield from _parameters(effect, parameters, at, fitting or units, tuple({term.of: 0, "common": 0}))
    for k, p in enumerate(parameters):
        for form in effect.forms:
            value = float(getattr(effect, form.field))
            if p.name == form.name and not (isinstance(p.value, float) and np.isclose(p.value, value, 1e-4)):
                place = (*at, "parameters", k, "value")
                yield place, Message("model-constant-differs", name=p.name, value=str(p.value)[:40], term=f"{value:g}")


def _shape_of_formula(listed: ModelEffect, term: Term, at: tuple[str | int, ...]) -> Iterator[Mistake]:
    """A formula's constants stand in its term: beside it they may only say the same."""
    constants = dict(term.constants)
    for field, value in listed.shape.items():
        if field not in constants:
            yield (
                (*at, "shape"),
                Message("model-shape", effect=listed.effect[:40], name=field[:40], names=term.fields or ("none",)),
            )
        elif not np.isclose(value, constants[field], 1e-4):
            differs = Message("model-constant-differs", name=field, value=f"{value:g}", term=f"{constants[field]:g}")
            yield (*at, "shape", field), differs


def _parameters(
    effect: Effect,
    parameters: Sequence[ModelParameter],
    at: tuple[str | int, ...],
    units: Sequence[str],
    levels: Sequence[str],
) -> Iterator[Mistake]:
    """What is wrong with the parameters of a cause that acts at some levels."""
    forms = {form.name: form for form in effect.forms}
    remarks = REMARKS.get(effect.id, ())
    names = tuple(dict.fromkeys([*(c.name for c in effect.columns), *forms, *remarks]))
    taken: set[tuple[str, str, str | None]] = set()
    for k, p in enumerate(parameters):
        place = (*at, "parameters", k)
        if p.name not in names:
            yield (*place, "name"), Message("model-parameter", effect=effect.id, name=p.name[:40], names=names)
            continue
        if (key := (p.name, p.of, p.axis)) in taken:
            yield place, Message("model-parameter-twice", effect=effect.id, name=p.name)
        taken.add(key)
        level, colon, group = p.of.partition(":")
        if level not in levels or (colon and (level == "common" or not group.strip())):
            yield (*place, "of"), Message("model-level", of=p.of[:40], effect=effect.id, levels=tuple(levels))
        if p.std is not None and not 0 <= p.std <= MOST_SIZE:
            yield (*place, "std"), Message("model-std", value=p.std, high=MOST_SIZE)
        columns = [c for c in effect.columns if c.name == p.name]
        if columns:
            yield from _coefficient(effect, p, columns, place, units)
        elif p.name in forms:
            yield from _form_unit(p, forms[p.name], place, units)


def _coefficient(
    effect: Effect,
    p: ModelParameter,
    columns: Sequence[Coefficient],
    place: tuple[str | int, ...],
    units: Sequence[str],
) -> Iterator[Mistake]:
    axes = tuple(c.axis for c in columns)
    if p.axis is not None and p.axis not in axes:
        yield (*place, "axis"), Message("model-axis", effect=effect.id, axis=p.axis[:40], axes=axes)
    needed = [unit_in(columns[0].unit, u) for u in units]
    if p.unit and p.unit not in needed:
        yield (*place, "unit"), Message("model-unit", unit=p.unit[:40], name=p.name, needed=needed[-1])
    try:
        size = effect.read_size(p.value) if isinstance(p.value, str) else p.value
    except InputError as exc:
        yield (*place, "value"), exc.message
        return
    if not abs(size) <= MOST_SIZE:
        yield (*place, "value"), Message("model-size", name=p.name, value=size, high=MOST_SIZE)


def _form_unit(
    p: ModelParameter, form: Parameter, place: tuple[str | int, ...], units: Sequence[str]
) -> Iterator[Mistake]:
    needed = [form.unit_in(u) for u in units]
    if p.unit and p.unit not in needed:
        yield (*place, "unit"), Message("model-unit", unit=p.unit[:40], name=p.name, needed=needed[-1])


def _range(form: Parameter) -> tuple[float, float]:
    """Between which numbers a parameter of a form makes sense: far beyond what is usual, above zero where all of that
    is."""
    low = form.low / FORM_FACTOR if form.low > 0 else -FORM_FACTOR * max(-form.low, form.high)
    return low, FORM_FACTOR * form.high
