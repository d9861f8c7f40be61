"""Whether another form explains as much as a term: edges, other laws of the temperature's rate, or free numbers.

A smooth alternative differs from a term in the first few orders of a curve. Edges (a step of a covariate or of what is
felt, a square wave, a sawtooth) differ slightly in many orders, and where a wave has few visits a period in none that
can be seen. They are therefore tried as laws of their own. They are far from any other curve, so chance hardly ever
puts them ahead.

The grammar holds the rate of a temperature only as a straight line. Its magnitude and square, a lagging temperature and
one that returns on another branch follow nearly the same course, and the thermometer blurs the difference: these must
be clearly behind.

Where each position, nest or run has its own coefficients, too few numbers may be left to show their course: a wave of
each position through three runs has two numbers for three readings. There the alternative is a law without a form: one
number for each occasion, shared by all units.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import scipy

from station.diagnosis.candidates.law_forms import BRANCHES, LAGS, THERMAL_PLAYS
from station.diagnosis.candidates.temperature_memory import TemperatureMemory
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.discovery.edged_waves import best_edged_wave
from station.diagnosis.discovery.rest import MOST_FREE_GROUPS, visit_noise
from station.diagnosis.discovery.term_fit import TermFit, TermSpace, TermSpaces, fit_in_place, fit_term
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats
from station.model.formula.grammar import GROUP_LEVELS, FormulaColumn
from station.model.formula.term import Term, axis_places
from station.model.scene import Scene

#: Levels between which a covariate steps, at most.
MOST_LEVELS = 12
#: What differs by less than this share of the range is one level.
SAME_LEVEL = 1e-3
#: How far behind another law of a rate must be, nats, as the thermometer's errors are in both: chance puts a wrong one
#: further ahead once in 740 campaigns (Φ(−√(2x)), as of `LAW_NATS`).
RATE_NATS = 4.5
#: Curves that are further apart than this, in white data, are two.
BEYOND_NOISE = 3.3
#: Units that are asked, at most.
MOST_UNITS = 12


def another_form_says_as_much(problem: ScoringProblem, terms: Sequence[Term]) -> bool:
    """Whether another form in place of any of the terms, which were accepted last, explains as much."""
    first, floor = len(problem.accepted) - len(terms), visit_noise(problem)
    if floor.noise <= 0:  # single readings show no noise of their own: what all of them together leave stands for it
        floor = problem.fit().floor
    for i, term in enumerate(terms, first):
        if term.is_turn or "since_arrival_s" in term.needs:
            continue
        at = TermSpaces(problem.without(i), floor, MOST_UNITS).of(term)
        own = fit_term(term, at)
        least = _nats(own, at)
        if any(_nats(fit_in_place(term, columns, at), at) > least for columns in edge_columns(term, at.view)):
            return True
        if term.modulator == "wave" and _best_with_edges(term, at) > least:
            return True
        others = [fit_in_place(term, columns, at) for columns in rate_columns(term, at.view)]
        if any(_nats(f, at) > least - RATE_NATS and _is_another_curve(f, own) for f in others):
            return True
        if term.of in GROUP_LEVELS and _no_form_says_as_much(own, at):
            return True
    return False


def _is_another_curve(one: TermFit, two: TermFit) -> bool:
    """Whether two fits are further apart than noise shows: a rate that is never negative equals its magnitude."""
    return bool(np.sum((one.signal - two.signal) ** 2) > BEYOND_NOISE**2)


def _no_form_says_as_much(own: TermFit, at: TermSpace) -> bool:
    """Whether a free number for each occasion is as likely as a term of groups, its price included."""
    columns = _each_occasion(own.term, at.view)
    if columns.shape[2] > MOST_FREE_GROUPS:
        return False
    return fit_in_place(replace(own.term, of="common"), columns, at).evidence > own.score


def _nats(fit: TermFit, at: TermSpace) -> float:
    """Log-likelihood that a fit gains, less one for each of its numbers (Akaike)."""
    return 0.5 * fit.share * at.space.rest - fit.coefficients


def _best_with_edges(wave: Term, at: TermSpace) -> float:
    """What the best wave with edges is worth in place of a smooth one."""
    signal = at.view.signal
    felt = {(c.i, c.j, c.phase): (c, wave.factor_values(c, signal)[0]) for c in wave.columns}.values()

    def worth(values: Floats) -> float:
        return _nats(fit_in_place(wave, _on_axes([(c, x * values) for c, x in felt]), at), at)

    return best_edged_wave(dict(wave.constants)["cycles_hz"], at.view, worth)


def edge_columns(term: Term, view: ResidualView) -> Iterator[Floats]:
    """Columns (v, 3, K) of each law with steps that a term may be taken for."""
    signal = view.signal
    parts = [(c, *term.factor_values(c, signal)) for c in term.columns]
    for covariate in (n for n in term.needs if not n.startswith("since")):
        for step in _steps(signal.scene.require(covariate)):
            yield _on_axes([(c, felt * step) for c, felt, _ in parts])
    if term.input != "one" and not term.input.startswith(("step", "previous")):
        steps = [list(_steps(felt)) for felt in signal.true.T]
        for place in "ijk":
            axes = [axis_places(c.i, c.j)[place] for c in term.columns]
            for n in range(min(len(steps[axis]) for axis in axes)):
                yield _on_axes([(c, steps[axis][n] * by) for (c, _, by), axis in zip(parts, axes, strict=True)])


def rate_columns(term: Term, view: ResidualView) -> Iterator[Floats]:
    """The same of each other law of the temperature's rate, where a term goes with that."""
    if "temperature_rate" in term.needs:
        signal = view.signal
        parts = [(c, term.factor_values(c, signal)[0]) for c in term.columns]
        for form in _forms_of_rate(view.scene):
            yield _on_axes([(c, felt * form) for c, felt in parts])


def _forms_of_rate(scene: Scene) -> Iterator[Floats]:
    """Other laws (v) of whether, and how fast, a temperature changes, and edges of the temperature itself."""
    rate, runs = scene.require("temperature_rate"), tuple(scene.visits.run_slices())
    # The rate is that of a smooth course: by the thermometer's own, every other law would bear its noise alone.
    integral = scipy.integrate.cumulative_trapezoid
    course = np.concatenate([integral(rate[rows], scene.time_s[rows], initial=0.0) for rows in runs])
    memory = TemperatureMemory(course, scene.time_s, runs)
    yield from (np.abs(rate), rate**2)
    if memory.range_degC > 0:
        yield from (memory.branch(play, start) for play, start in product(THERMAL_PLAYS, BRANCHES))
    yield from (memory.temperature_degC - memory.lagged(lag) for lag in LAGS)
    yield from _steps(scene.require("temperature_degC"))


def _each_occasion(term: Term, view: ResidualView) -> Floats:
    """Columns (v, 3, K), a number for each visit of each run on each axis of a term, the same for all units."""
    scene = view.scene
    of_run = np.stack([scene.codes("run-of-recipe"), scene.visits.visit])
    occasion = np.unique(of_run, axis=1, return_inverse=True)[1].ravel()
    there = (occasion[:, None] == np.arange(occasion.max() + 1)).astype(float)
    axes = sorted({c.i for c in term.columns})
    found = np.zeros((len(there), 3, len(axes), there.shape[1]))
    for at, axis in enumerate(axes):
        found[:, axis, at] = there
    return found.reshape(len(there), 3, -1)


def _steps(x: Floats) -> Iterator[Floats]:
    """Steps (v) between the levels of something, zero on either side of the step or on none."""
    width = max(SAME_LEVEL * float(np.ptp(x)), 1e-300)
    levels = np.unique(np.round(x / width)) * width
    between = (levels[1:] + levels[:-1]) / 2
    if len(between) > MOST_LEVELS:
        between = np.quantile(levels, np.arange(1, MOST_LEVELS) / MOST_LEVELS)
    for edge in between:
        above = np.where(x > edge, 1.0, 0.0)
        yield from (above, above - 1, 2 * above - 1)


def _on_axes(parts: Sequence[tuple[FormulaColumn, Floats]]) -> Floats:
    found = np.zeros((len(parts[0][1]), 3, len(parts)))
    for at, (column, values) in enumerate(parts):
        found[:, column.i, at] = values
    return found
