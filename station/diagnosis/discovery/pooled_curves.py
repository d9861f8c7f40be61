"""One other curve in place of a term: its sizes as found, its form any smooth one.

Where a law has another form than the term that follows it, the residual is large where the term is. One curve for all
units and axes, scaled by each size, therefore shows with a few numbers what separate curves of each unit need hundreds
for (Neyman's smooth test). The residual is free of the errors of the sizes, so its chance is easily computed. Where a
law has one covariate more than the term, the size of the term varies with it.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.polynomial import legendre

from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats
from station.model.formula.grammar import FormulaColumn
from station.model.formula.term import Term, axis_places
from station.model.scene import Signal

#: Degree of a curve, and of the course of a wave's two sizes.
DEGREE, COURSE_DEGREE = 6, 3
#: By how much a constant is moved, as a share of it.
STEP = 1e-3
#: Overtones of a wave of another form: edges have the third in phase, a saw the second out of phase.
OVERTONES = ((3, np.cos), (2, np.sin), (2, np.cos), (3, np.sin), (5, np.cos), (5, np.sin))

#: A column of a term with its sizes (v), what the axis feels (v) and how it is modulated (v).
Part = tuple[FormulaColumn, Floats, Floats, Floats]


def pooled_curves(
    problem: ScoringProblem, item: AcceptedCause, term: Term, covariates: Iterable[str]
) -> Iterator[Floats]:
    """Columns (v, 3, c) of one curve in place of a term's own, the coarsest first: along what modulates it, along what
    it feels, and its size along each other covariate that was recorded."""
    if term.is_turn or "since_arrival_s" in term.needs:
        return
    scene = problem.view.scene
    signal = problem.view.signal
    sizes = np.where(item.hit[:, None], item.coefficient, 0.0)[item.candidate.code]
    parts = [(c, sizes[:, at], *term.factor_values(c, signal)) for at, c in enumerate(term.columns)]
    along = next(iter(term.needs), "time_s") if term.modulator != "constant" else ""
    if term.modulator == "wave":
        yield from _about_wave(parts, dict(term.constants)["cycles_hz"], scene.time_s)
    elif along:
        curve = _curve(scene.require(along))
        yield _on_axes((c, (size * felt)[:, None] * curve) for c, size, felt, _ in parts)
    if term.input != "one":
        yield from _along_felt(parts, signal)
    for x in (scene.require(name) for name in covariates if name != along and scene.is_recorded(name)):
        other = (x - x.mean())[:, None]
        yield _on_axes((c, (size * felt * by)[:, None] * other) for c, size, felt, by in parts)


def constant_columns(problem: ScoringProblem, item: AcceptedCause, term: Term) -> Floats:
    """Columns (v, 3, constants) of what a small step of each free constant does: that the constants are at their best
    already leaves nothing along these."""
    signal = problem.view.signal
    sizes = np.where(item.hit[:, None], item.coefficient, 0.0)[item.candidate.code]
    found = np.zeros((len(sizes), 3, len(term.constants)))
    for n, (field, value) in enumerate(term.constants):
        (least, most), step = term.range_of(field), STEP * max(abs(value), STEP)
        ends = [min(max(value + sign * step, least), most) for sign in (-1, 1)]
        for at, c in enumerate(term.columns):
            low, high = (term.with_constants(**{field: end}).column(c, signal) for end in ends)
            found[:, c.i, n] += sizes[:, at] * (high - low) / (ends[1] - ends[0])
    return found


def _along_felt(parts: list[Part], signal: Signal) -> Iterator[Floats]:
    """A curve in place of the input: along the axis of the reading, the other one that it names, and the third."""
    curves = [_curve(felt) for felt in signal.true.T]
    for place in "ijk":
        yield _on_axes((c, (size * by)[:, None] * curves[axis_places(c.i, c.j)[place]]) for c, size, _, by in parts)


def _curve(x: Floats) -> Floats:
    """Legendre's polynomials (v, c) over the range of a covariate."""
    low, high = float(x.min()), float(x.max())
    return np.asarray(legendre.legvander(2 * (x - low) / max(high - low, 1e-300) - 1, DEGREE), float)


def _about_wave(parts: list[Part], cycles_hz: float, time_s: Floats) -> Iterator[Floats]:
    """The overtones of a wave, by the phase of each size's own, and the courses of its sizes in phase and out of it."""
    angle = 2 * np.pi * cycles_hz * time_s
    waves: dict[tuple[int, int, str], dict[str, Part]] = {}
    for part in parts:
        waves.setdefault((part[0].i, part[0].j, part[0].phase), {})[part[0].wave] = part
    courses = _curve(time_s)[:, 1 : COURSE_DEGREE + 1].T
    overtones, changing = [], []
    for of in waves.values():
        column, _, felt, _ = next(iter(of.values()))
        cosine, sine = (of[wave][1] if wave in of else np.zeros(len(angle)) for wave in ("cos", "sin"))
        phase = angle - np.arctan2(sine, cosine)
        size = (np.hypot(cosine, sine) * felt)[:, None]
        overtones.append((column, size * np.stack([form(n * phase) for n, form in OVERTONES], axis=1)))
        course = [form(phase) * course for course in courses for form in (np.cos, np.sin)]
        changing.append((column, size * np.stack(course, axis=1)))
    yield _on_axes(overtones)
    yield _on_axes(changing)


def _on_axes(parts: Iterable[tuple[FormulaColumn, Floats]]) -> Floats:
    """Curves (v, c), each on its axis."""
    some = list(parts)
    found = np.zeros((some[0][1].shape[0], 3, some[0][1].shape[1]))
    for column, curve in some:
        found[:, column.i] += curve
    return found
