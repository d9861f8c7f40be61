"""Whether edges say as much as a curve: a step of a covariate or of what is felt, a square wave, a saw.

Smooth forms differ from a term by what the first few orders of a curve show. Edges differ by a little in many orders,
and where a wave has few visits a round by none that is seen: so they stand as laws of their own beside the term. They
are far from any curve that is not theirs, so that chance hardly ever puts them ahead.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.discovery.rest import visit_noise
from station.diagnosis.discovery.term_fit import TermFit, TermSpace, TermSpaces, fit_in_place, fit_term
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats
from station.model.formula.grammar import FormulaColumn
from station.model.formula.term import Term, axis_places
from station.model.forward import sensor_signal

#: Levels between which a covariate steps, at most, phases of a wave with edges, and how much of a round a pulse lasts.
MOST_LEVELS, PHASES, PULSE = 12, 24, 0.3
#: Rounds by which a wave with edges may be ahead at the end of the longest run: another frequency fits it best.
DRIFTS = (-0.6, -0.3, 0.0, 0.3, 0.6)
#: What differs by less than this share of the range is one level.
SAME_LEVEL = 1e-3
#: Units that are asked, at most.
MOST_UNITS = 12


def edges_say_as_much(problem: ScoringProblem, terms: Sequence[Term]) -> bool:
    """Whether edges in place of any of some terms, which are what was accepted last, explain as much as it does."""
    first, floor = len(problem.accepted) - len(terms), visit_noise(problem)
    if floor.noise <= 0:  # single readings show no noise of their own: what all of them together leave stands for it
        floor = problem.fit().floor
    for i, term in enumerate(terms, first):
        if term.is_turn or "since_arrival_s" in term.needs:
            continue
        at = TermSpaces(problem.without(i), floor, MOST_UNITS).of(term)
        least = _nats(fit_term(term, at), at)
        if any(_nats(fit_in_place(term, columns, at), at) > least for columns in edge_columns(term, at.view)):
            return True
    return False


def _nats(fit: TermFit, at: TermSpace) -> float:
    """Log-likelihood that a fit gains, less one for each of its numbers (Akaike)."""
    return 0.5 * fit.share * at.space.rest - fit.coefficients


def edge_columns(term: Term, view: ResidualView) -> Iterator[Floats]:
    """Columns (v, 3, K) of each law with edges that a term may be taken for."""
    signal = sensor_signal(view.scene, view.active)
    parts = [(c, *term.factor_values(c, signal)) for c in term.columns]
    if term.modulator == "wave":
        pairs = {(c.i, c.j, c.phase): (c, felt) for c, felt, _ in parts}.values()
        for wave in _edged_waves(dict(term.constants)["cycles_hz"], view):
            yield _on_axes([(c, felt * wave) for c, felt in pairs])
    for covariate in (n for n in term.needs if not n.startswith("since")):
        for step in _steps(signal.scene.require(covariate)):
            yield _on_axes([(c, felt * step) for c, felt, _ in parts])
    if term.input != "one" and not term.input.startswith(("step", "previous")):
        steps = [list(_steps(felt)) for felt in signal.true.T]
        for place in "ijk":
            axes = [axis_places(c.i, c.j)[place] for c in term.columns]
            for n in range(min(len(steps[axis]) for axis in axes)):
                yield _on_axes([(c, steps[axis][n] * by) for (c, _, by), axis in zip(parts, axes, strict=True)])


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


def _edged_waves(cycles_hz: float, view: ResidualView) -> Iterator[Floats]:
    """Square waves, saws and pulses (v) at every phase and at frequencies nearby: the mean of each over its visit, in
    which an edge may lie."""
    time = view.reduced.fine.time_s
    phases = np.arange(PHASES) / PHASES
    for drift in DRIFTS:
        part = ((cycles_hz + drift / max(float(time.max()), 1e-300)) * time[:, None] + phases) % 1
        squares = np.where(part[:, phases < 0.5] < 0.5, 1.0, -1.0)
        waves = np.concatenate([part - 0.5, np.where(part < PULSE, 1.0, 0.0), squares], axis=1)
        yield from view.reduced.reduce_fine(waves)[0].T


def _on_axes(parts: Sequence[tuple[FormulaColumn, Floats]]) -> Floats:
    found = np.zeros((len(parts[0][1]), 3, len(parts)))
    for at, (column, values) in enumerate(parts):
        found[:, column.i, at] = values
    return found
