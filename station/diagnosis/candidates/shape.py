"""The form of a cause (a time constant, a frequency), fitted between the values that the bank scans."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from station.diagnosis.candidates.bank import (
    MAX_JUMP_TIMES,
    Candidate,
    build_bank,
    candidate_jump_times,
    jump_times_between,
)
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.projected_bank import project_bank
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.projection import ResidualSpace
from station.domain.core.types import Floats
from station.model.effect import Effect, Parameter

#: Nats by which a form is not worth improving further.
MIN_IMPROVEMENT_NATS = 0.02
#: Rounds in which one parameter of a form is tuned after the other, and nats below which one more is not worth it.
MAX_ROUNDS, ROUND_NATS = 12, 0.2


@dataclass(frozen=True, slots=True)
class FormEstimate:
    """A form parameter: its field, best value, and standard deviation from the curvature of the evidence."""

    field: str
    value: float
    std: float


#: Frequencies tried where a cause may ring, Hz, beyond which a block of samples holds whole waves.
RINGING_HZ = (*(2.0 + 0.5 * i for i in range(13)), 8.7, 9.4, 10.2, 11.0, 12.0)
#: Share of the greatest evidence from which another frequency may be the right one: its peak lies between those tried.
LIKELY_SHARE = 0.5


def tunable_parameters(effect: Effect | None) -> tuple[Parameter, ...]:
    """The parameters of a form that are scanned on a grid, and the frequency of one that rings."""
    return () if effect is None else tuple(p for p in effect.forms if p.grid or _has_frequency(effect, p))


def _has_frequency(effect: Effect, p: Parameter) -> bool:
    return p.name == "frequency" and getattr(effect, p.field) > 0


def may_ring(effect: Effect | None) -> bool:
    """Whether a cause has a frequency that was not searched yet."""
    return effect is not None and any(p.name == "frequency" and not _has_frequency(effect, p) for p in effect.forms)


def with_ringing(candidate: Candidate, view: ResidualView, space: ResidualSpace) -> Candidate:
    """The candidate with the frequency and the time constant that explain most."""
    return _best([tune_form(start, view, space)[0] for start in likely_ringings(candidate, view, space)], view, space)


def likely_ringings(candidate: Candidate, view: ResidualView, space: ResidualSpace) -> list[Candidate]:
    """The candidate at each frequency, of those that are tried, that explains more than both its neighbours and nearly
    as much as any, at the time constant that suits it."""
    tried = _ringings(candidate, view)
    nats = evidences_of(tried, view, space).reshape(len(RINGING_HZ), -1)
    best = nats.max(axis=1)
    beside = np.maximum(np.append(best[1:], -np.inf), np.append(-np.inf, best[:-1]))
    top = float(best.max())
    likely = np.flatnonzero((best >= beside) & (best >= min(LIKELY_SHARE * top, top)))
    return [tried[i * nats.shape[1] + int(nats[i].argmax())] for i in likely]


def _ringings(candidate: Candidate, view: ResidualView) -> list[Candidate]:
    """The candidate at all frequencies that are tried, each with all time constants."""
    assert candidate.effect is not None
    field = next(p.field for p in candidate.effect.forms if p.name == "frequency")
    # Of waves that die away within a few periods, peaks are narrow in both: between the values of the bank, one more.
    others = [(p.field, v) for p in candidate.effect.forms for v in _densified(p.grid)] or [(field, 0.0)]
    return [
        with_form(candidate, replace(candidate.effect, **{other: v, field: hz}), view)
        for hz in RINGING_HZ
        for other, v in others
    ]


def _densified(grid: tuple[float, ...]) -> tuple[float, ...]:
    """A logarithmic grid with its middles."""
    return tuple(sorted((*grid, *(float(np.sqrt(a * b)) for a, b in pairwise(grid)))))


def evidence_of(candidate: Candidate, view: ResidualView, space: ResidualSpace) -> float:
    """Log evidence of one candidate."""
    return float(evidences_of([candidate], view, space)[0])


def evidences_of(candidates: Sequence[Candidate], view: ResidualView, space: ResidualSpace) -> Floats:
    """Log evidence (candidates) of shapes of one cause."""
    bank = build_bank(candidates, view.layout, moving=candidates[0].moving)
    return project_bank(bank, view.layout, [space])[0].evidence


def _best(candidates: Sequence[Candidate], view: ResidualView, space: ResidualSpace) -> Candidate:
    """The shape of the greatest evidence."""
    return candidates[int(evidences_of(candidates, view, space).argmax())]


def with_form_value(candidate: Candidate, field: str, value: float, view: ResidualView) -> Candidate:
    """The candidate with another value of a form parameter."""
    assert candidate.effect is not None
    return with_form(candidate, replace(candidate.effect, **{field: value}), view)


def with_form(candidate: Candidate, effect: Effect, view: ResidualView) -> Candidate:
    """The candidate at another shape."""
    return replace(candidate, effect=effect, columns=CauseColumns.of(*view.signature(effect, candidate.of)))


def tune_form(
    candidate: Candidate, view: ResidualView, space: ResidualSpace
) -> tuple[Candidate, tuple[FormEstimate, ...]]:
    """The candidate with its form at the greatest evidence, on a logarithmic scale."""
    parameters, before = tunable_parameters(candidate.effect), -np.inf
    found = list[FormEstimate]()
    # One parameter of a form is tuned after the other: where there are two, a ridge takes some rounds.
    for _ in range(MAX_ROUNDS if len(parameters) > 1 else 1):
        found = []
        for p in parameters:
            candidate, result = _tune(candidate, p, view, space)
            found.append(result)
        now = evidence_of(candidate, view, space) if len(parameters) > 1 else np.inf
        if now - before < ROUND_NATS:
            break
        before = now
    return candidate, tuple(found)


def log_range(p: Parameter) -> tuple[float, float]:
    """The logarithms between which a parameter of a form is looked for."""
    if not p.grid:
        return -3.0, 5.0
    return float(np.log(0.5 * min(p.low, *p.grid))), float(np.log(2 * max(p.high, *p.grid)))


def has_jump(effect: Effect | None) -> bool:
    """Whether a cause begins at some time within a run."""
    return effect is not None and any(p.name == "at" for p in effect.forms)


def refine_jump_time(candidate: Candidate, view: ResidualView, space: ResidualSpace) -> Candidate:
    """The candidate with the best nearby time of its jump: the bank tries only gaps between the visits of the longest
    run, and may leave some out."""
    gaps = candidate_jump_times(view)
    i = min(range(len(gaps)), key=lambda k: abs(gaps[k] - candidate.effect.at_s))  # type: ignore[union-attr]
    step = -(-len(gaps) // MAX_JUMP_TIMES)
    low, high = gaps[max(i - step, 0)], gaps[min(i + step, len(gaps) - 1)]
    near = [with_form_value(candidate, "at_s", at, view) for at in jump_times_between(view, low, high)]
    return _best([candidate, *near], view, space)


def _tune(
    candidate: Candidate, p: Parameter, view: ResidualView, space: ResidualSpace
) -> tuple[Candidate, FormEstimate]:
    """Successive parabolas through the best three points on the logarithm."""
    tried: dict[float, tuple[float, Candidate]] = {}

    def at(x: float) -> float:
        if x not in tried:
            c = with_form_value(candidate, p.field, float(np.exp(x)), view)
            tried[x] = evidence_of(c, view, space), c
        return tried[x][0]

    def best() -> float:
        return max(tried, key=lambda x: tried[x][0])

    start = getattr(candidate.effect, p.field)
    # A frequency beyond a tenth off would be another wave of the same blocks.
    gap = float(np.log(p.grid[1] / p.grid[0])) if len(p.grid) > 1 else 0.1
    low, high = log_range(p)
    # A model file may begin beyond the range that is usual.
    low, high = min(low, float(np.log(start))), max(high, float(np.log(start)))
    for x in (0.0, -gap, gap):
        at(float(np.clip(np.log(start) + x, low, high)))
    for _ in range(10):
        now, before = best(), tried[best()][0]
        fresh = float(np.clip(now + _vertex(sorted(tried), now, at), low, high))
        if min(abs(fresh - x) for x in tried) < 1e-4:
            break
        if at(fresh) - before < MIN_IMPROVEMENT_NATS and abs(fresh - now) < 0.3 * gap:
            break
    # The curvature is that of the top: points one deviation off say more of it than those of the search.
    spread = _spread(sorted(tried), best(), at)
    for x in (best() - spread, best() + spread):
        at(float(np.clip(x, low, high)))
    value = float(np.exp(best()))
    return tried[best()][1], FormEstimate(p.field, value, value * _spread(sorted(tried), best(), at))


def _neighbours(points: list[float], best: float) -> tuple[float, float] | None:
    i = points.index(best)
    return None if i in (0, len(points) - 1) else (points[i - 1], points[i + 1])


def _vertex(points: list[float], best: float, at: Callable[[float], float]) -> float:
    """Step from the best point to the vertex of the parabola through it and its neighbours; outwards at an end."""
    around = _neighbours(points, best)
    if around is None:
        other = points[1] if best == points[0] else points[-2]
        return best - other
    a, b = around[0] - best, around[1] - best
    fa, fb = at(around[0]) - at(best), at(around[1]) - at(best)
    bend = (fb / b - fa / a) / (b - a)
    if bend >= 0:
        return 0.5 * (a if fa > fb else b)
    step = -(fa / a - bend * a) / (2 * bend)
    return float(np.clip(step, 0.9 * a, 0.9 * b))


def _spread(points: list[float], best: float, at: Callable[[float], float]) -> float:
    """Standard deviation of the logarithm by the curvature at the best point; 1 where it is at an end."""
    around = _neighbours(points, best)
    if around is None:
        return 1.0
    a, b = around[0] - best, around[1] - best
    fa, fb = at(around[0]) - at(best), at(around[1]) - at(best)
    bend = 2 * (fb / b - fa / a) / (b - a)
    return float(min(1.0, 1 / np.sqrt(-bend))) if bend < 0 else 1.0
