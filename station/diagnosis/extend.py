"""The simulation extended by what was found: a model file that `simulate` and a second `diagnose` take."""

from station.diagnosis.diagnose import Cause, Diagnosis
from station.diagnosis.document import parameters
from station.diagnosis.faults import Fault
from station.model.model_file import Model, ModelEffect, ModelParameter


def extended(model: Model, d: Diagnosis) -> Model:
    """The model with every fault and every accepted cause, parameters with standard deviations.

    A cause whose gain on held-out data is within chance (2 SE) stays out.
    """
    named = {effect.effect for effect in model.effects}
    faults = [_of_fault(f) for f in d.faults if f.effect not in named]
    return model.model_copy(
        update={"effects": (*model.effects, *faults, *(_of_cause(c, d) for c in d.causes if c.gain.accepted))}
    )


def _of_fault(f: Fault) -> ModelEffect:
    told = tuple(
        ModelParameter(name=n.name, axis=n.axis, of=n.of, value=n.value, std=n.std, unit=n.unit) for n in f.numbers
    )
    return ModelEffect(effect=f.effect, parameters=told)


def _of_cause(c: Cause, d: Diagnosis) -> ModelEffect:
    rows = parameters(c, d)
    effect = None if c.estimate is None else c.estimate.item.candidate.effect
    shape = {} if effect is None else {p.field: float(getattr(effect, p.field)) for p in effect.forms}
    return ModelEffect(effect=c.finding.name, parameters=tuple(ModelParameter(**row) for row in rows), shape=shape)
