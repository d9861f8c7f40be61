"""From a proposed formula to the curve that the report draws of it."""

import numpy as np

from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.results.hypotheses import Hypotheses, HypothesisTerm
from station.diagnosis.results.line_impact import cause_contribution
from station.domain.core.types import Floats
from station.model.formula.expression import evaluate, variables
from station.model.formula.grammar import ONE
from station.model.formula.term import COVARIATE_OF, Term, variable_values
from station.model.formula.text import SIGNS, TextWriter, named_places
from station.model.forward import sensor_signal
from station.model.scene import Signal
from station.reporting.diagnosis.data import FormulaCurve
from station.reporting.diagnosis.plot_axis import AXIS_LABELS

AXES = ("x", "y", "z")


def formula_curves(d: Diagnosis) -> tuple[FormulaCurve, ...]:
    """One for each term that is a product; a turn has no covariate of its own."""
    h = d.hypotheses
    if h is None:
        return ()
    return tuple(_curve(h, t) for t in h.terms if not t.found.fit.term.is_turn)


def _curve(h: Hypotheses, t: HypothesisTerm) -> FormulaCurve:
    problem, term = h.problem, t.found.fit.term
    index = next(i for i, item in enumerate(problem.accepted) if item.candidate.name == t.found.name)
    mean, _ = cause_contribution(problem, index)
    view = problem.view
    moved = np.einsum("vki,vi->vk", view.keep, mean)
    rest = np.einsum("vki,vi->vk", view.keep, view.reduced.mean - view.simulated()[0])
    i = int(np.argmax(np.sum(moved**2, axis=0)))
    signal = sensor_signal(view.scene, view.active)
    at, label, level, what = _covariate(term, i, signal)
    return FormulaCurve(AXES[i], label, what, at, level, rest[:, i] + moved[:, i], moved[:, i])


def _covariate(term: Term, i: int, signal: Signal) -> tuple[Floats, str, Floats, str]:
    """What the curve is drawn over, and the level of the other factor: the modulator's covariate and the input; or what
    the axis feels alone where nothing modulates it."""
    column = next((c for c in term.columns if c.i == i), term.columns[0])
    input_, modulator = term.tree(column)
    used = variables(modulator) or variables(input_)
    values = variable_values(signal, column.i, column.j, variables(input_) | variables(modulator))
    name, place = next((key for key in values if key[0] in used and key[1] in ("", "i", "j")), ("", ""))
    places = named_places(column)
    felt = np.broadcast_to(evaluate(input_, values, dict(term.constants)), len(signal.scene))
    if not name:
        return felt, "1", np.ones(len(felt)), ""
    sign = SIGNS[name] + (f"_{places[place]}" if place else "")
    label = AXIS_LABELS.get(COVARIATE_OF.get(name, ""), sign)
    at = np.asarray(values[name, place], float)
    if not variables(modulator) or input_ == ONE:
        return at, label, np.ones(len(at)), ""
    return at, label, felt, TextWriter(places).write(input_)
