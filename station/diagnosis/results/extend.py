"""The simulation extended by what was found: a model file that `simulate` and a second `diagnose` take."""

from collections.abc import Iterator

from station.diagnosis.data.faults import GrossFault
from station.diagnosis.results.diagnose import Cause, Diagnosis
from station.diagnosis.results.diagnosis_document import parameter_rows
from station.model.effect import Effect
from station.model.model_file import Model, ModelEffect, ModelParameter, measured_parameter


def extend_model(model: Model, d: Diagnosis) -> Model:
    """The model with every fault and every accepted cause, parameters with standard deviations. Causes whose gain on
    held-out data is within chance (2 SE) are left out, and so are formulas."""
    named = {effect.effect for effect in model.effects}
    faults = [_fault_effect(f) for f in d.faults if f.effect not in named]
    found = (effect for c in d.causes if c.gain.accepted for effect in _cause_effects(c, d))
    return model.model_copy(update={"effects": (*model.effects, *faults, *found, *_formula_effects(model, d))})


def _formula_effects(model: Model, d: Diagnosis) -> Iterator[ModelEffect]:
    """The terms of a proposed formula, numbered after those of the model."""
    if d.hypotheses is None:
        return
    from station.diagnosis.results.hypothesis_document import model_effects

    yield from model_effects(d.hypotheses, d.recipe.unit, [effect.effect for effect in model.effects])


def _fault_effect(f: GrossFault) -> ModelEffect:
    parameters = tuple(
        ModelParameter(name=n.name, axis=n.axis, of=n.of, value=n.value, std=n.std, unit=n.unit) for n in f.numbers
    )
    return ModelEffect(effect=f.effect, parameters=parameters)


def _cause_effects(c: Cause, d: Diagnosis) -> Iterator[ModelEffect]:
    """A cause, once for each of its shapes."""
    rows = [measured_parameter(row) for row in parameter_rows(c, d)]
    candidate = None if c.estimate is None else c.estimate.item.candidate
    if candidate is not None and candidate.effect is None:
        # One visit's own length is nothing that a simulation can have again.
        return
    if candidate is None or not candidate.own:
        effect = None if candidate is None else candidate.effect
        yield ModelEffect(effect=c.finding.name, parameters=tuple(rows), shape=_shape(effect))
        return
    for effect, groups in candidate.shapes.items():
        own = {name for name, at in zip(candidate.names, groups, strict=True) if at}
        if theirs := tuple(row for row in rows if row.of in own):
            yield ModelEffect(effect=c.finding.name, parameters=theirs, shape=_shape(effect))


def _shape(effect: Effect | None) -> dict[str, float]:
    return {} if effect is None else {p.field: float(getattr(effect, p.field)) for p in effect.forms}
