"""From a proposed formula to the curve that the report draws of it."""

from collections.abc import Sequence

import numpy as np

from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.results.hypotheses import Hypotheses, HypothesisTerm
from station.diagnosis.results.line_impact import cause_contribution
from station.domain.core.types import Floats
from station.model.formula.expression import Expression, evaluate, places_of, variables
from station.model.formula.grammar import ONE, FormulaColumn
from station.model.formula.term import COVARIATE_OF, Term, variable_values
from station.model.formula.text import SIGNS, TextWriter, named_places
from station.model.forward import sensor_signal
from station.model.scene import Signal
from station.reporting.diagnosis.data import FormulaCurve
from station.reporting.diagnosis.plot_axis import AXIS_LABELS

AXES = ("x", "y", "z")
#: Points of a drawn curve.
POINTS = 241


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
    moved = np.einsum("vki,vi->vk", view.own, mean)
    rest = np.einsum("vki,vi->vk", view.own, view.reduced.mean - view.simulated()[0])
    i = int(np.argmax(np.sum(moved**2, axis=0)))
    signal = sensor_signal(view.scene, view.active)
    code, names = view.scene.group(term.of)
    group = int(np.argmax(np.bincount(code, moved[:, i] ** 2)))
    rows, size = code == group, problem.accepted[index].coefficient[group]
    columns = _strongest(term, i, size, signal)
    at, label, level, what = _covariate(term, columns[0][0], signal)
    formula = moved[:, i]
    if view.grid.k == len(AXES) and "since_arrival_s" not in term.needs:
        # Of an axis that feels two others, what the stronger one makes. What dies away within a dwell is its mean's.
        formula = np.sum([c * term.column(column, signal) for column, c in columns], axis=0)
    else:
        columns = []
    return FormulaCurve(
        AXES[i],
        label,
        what,
        at[rows],
        level[rows],
        (rest[:, i] + formula)[rows],
        formula[rows],
        _course(term, columns, at[rows]),
        names[group] if len(names) > 1 else "",
    )


def _strongest(term: Term, i: int, size: Floats, signal: Signal) -> list[tuple[FormulaColumn, float]]:
    """Coefficients of a term on an axis that are of the same other axis, the one that moves most."""
    every = [(column, float(c)) for column, c in zip(term.columns, size, strict=True) if column.i == i]
    every = every or [(term.columns[0], float(size[0]))]
    sets = [[pair for pair in every if pair[0].j == j] for j in dict.fromkeys(column.j for column, _ in every)]

    def moved(some: list[tuple[FormulaColumn, float]]) -> float:
        return float(np.sum(np.sum([c * term.column(column, signal) for column, c in some], axis=0) ** 2))

    return max(sets, key=moved)


def _course(term: Term, columns: Sequence[tuple[FormulaColumn, float]], at: Floats) -> Floats | None:
    """Covariate and term (2, n) at level 1, None where the covariate alone does not give it."""
    trees = [term.tree(column) for column, _ in columns]
    modulated = any(variables(two) for _, two in trees)
    parts = [two if modulated else one for one, two in trees]
    known = {key for tree in parts for key in variables(tree)}
    if len(known) != 1 or (modulated and len({one for one, _ in trees}) > 1):
        return None
    (name,) = known
    x = np.linspace(float(at.min()), float(at.max()), POINTS)
    values = {(name, place): x for place in ("", "i", "j", "k")}
    if not modulated and not _is_of_one_axis(parts):
        return None
    y = [c * evaluate(tree, values, dict(term.constants)) for tree, (_, c) in zip(parts, columns, strict=True)]
    return np.stack([x, np.sum(y, axis=0)])


def _is_of_one_axis(trees: Sequence[Expression]) -> bool:
    """Whether trees speak of one place alone: a product of two axes is no curve over one."""
    return len({place for tree in trees for place in places_of(tree)}) == 1


def _covariate(term: Term, column: FormulaColumn, signal: Signal) -> tuple[Floats, str, Floats, str]:
    """What the curve is drawn over, and the level of the other factor: the modulator's covariate and the input; or what
    the axis feels alone where nothing modulates it."""
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
