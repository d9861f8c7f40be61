"""One other curve for all that a term of a formula does: its sizes as found, its form any smooth one.

Where a law has another form than the term that follows it, what is left is large where the term is. One curve for all
units and axes, each times its size, therefore shows with a few numbers what curves of each unit's own need hundreds
for (Neyman's smooth test). The rest is free of the errors of the sizes, so that what noise makes of it is a χ².
"""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.polynomial import legendre

from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats
from station.model.formula.grammar import FormulaColumn
from station.model.formula.term import Term
from station.model.forward import sensor_signal

#: Degree of a curve, and the harmonics of a wave of another form: edges have the third, one bent to a side the second.
DEGREE, HARMONICS = 4, (2, 3)

#: A column of a term with its sizes (v), what the axis feels (v) and how it is modulated (v).
Part = tuple[FormulaColumn, Floats, Floats, Floats]


def pooled_curves(problem: ScoringProblem, item: AcceptedCause, term: Term) -> Iterator[Floats]:
    """Columns (v, 3, c) of one curve in place of a term's own: along what modulates it, and along what it feels."""
    if term.is_turn or "since_arrival_s" in term.needs:
        return
    scene = problem.view.scene
    signal = sensor_signal(scene, problem.view.active)
    sizes = np.where(item.hit[:, None], item.coefficient, 0.0)[item.candidate.code]
    parts = [(c, sizes[:, at], *term.factor_values(c, signal)) for at, c in enumerate(term.columns)]
    if term.modulator == "wave":
        yield _about_wave(parts, 2 * np.pi * dict(term.constants)["cycles_hz"] * scene.time_s)
    elif term.modulator != "constant":
        curve = _curve(scene.require(next(iter(term.needs), "time_s")))
        yield _on_axes((c, (size * felt)[:, None] * curve) for c, size, felt, _ in parts)
    if term.input != "one":
        felt_on = ((c, signal.true[:, c.j if ":" in c.label else c.i]) for c in term.columns)
        curves = {c.label: _curve(felt) for c, felt in felt_on}
        yield _on_axes((c, (size * by)[:, None] * curves[c.label]) for c, size, _, by in parts)


def _curve(x: Floats) -> Floats:
    """Legendre's polynomials (v, c) over the range of a covariate."""
    low, high = float(x.min()), float(x.max())
    return np.asarray(legendre.legvander(2 * (x - low) / max(high - low, 1e-300) - 1, DEGREE), float)


def _about_wave(parts: list[Part], angle: Floats) -> Floats:
    """The overtones of a wave, by the phase of each size's own."""
    waves: dict[tuple[int, int, str], dict[str, Part]] = {}
    for part in parts:
        waves.setdefault((part[0].i, part[0].j, part[0].phase), {})[part[0].wave] = part
    found = []
    for of in waves.values():
        column, _, felt, _ = next(iter(of.values()))
        cosine, sine = (of[wave][1] if wave in of else np.zeros(len(angle)) for wave in ("cos", "sin"))
        phase = np.outer(angle - np.arctan2(sine, cosine), HARMONICS)
        overtones = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
        found.append((column, (np.hypot(cosine, sine) * felt)[:, None] * overtones))
    return _on_axes(found)


def _on_axes(parts: Iterable[tuple[FormulaColumn, Floats]]) -> Floats:
    """Curves (v, c), each on its axis."""
    some = list(parts)
    found = np.zeros((some[0][1].shape[0], 3, some[0][1].shape[1]))
    for column, curve in some:
        found[:, column.i] += curve
    return found
