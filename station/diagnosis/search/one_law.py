"""Whether two causes together are one law that the library does not have.

A window is a jump and one back, an exponential of the input a square and a cube, what climbs within the dwells a
hysteresis and a lag of the other sign: two causes of one covariate, of which the second does on every axis and unit
what the first does, in one and the same ratio. One law whose form is the sum of both in that ratio says it with half
the numbers. Two causes that are there of themselves have their own sizes on each axis, and no such ratio; where there
is one axis alone, nothing tells one from the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from station.diagnosis.candidates.bank import Candidate, build_bank
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.kernels import acts_by
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.linear.evidence import Pattern, log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.problem import marginal_nats
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.domain.core.types import Floats

#: Directions between one cause alone and the other alone, over half a turn, and how many times they are tried closer.
DIRECTIONS, TIMES_CLOSER = 24, 2
#: What dies away within the dwells acts by what stands still in them where its visits follow that but for such a share.
SAME_COURSE = 0.02

#: Columns (v, 3, a) of visits, and those (v, B−1, 3, a) of contrasts of what changes within them.
Columns = tuple[Floats, Floats | None]


@dataclass(frozen=True, slots=True)
class OneLaw:
    """By how many nats one law is ahead of two accepted causes, whose places these are, and what all three act by."""

    places: tuple[int, int]
    lead: float
    words: tuple[str, ...]


def laws_of_two(problem: ScoringProblem, places: Sequence[int]) -> Iterator[OneLaw]:
    """Every two of some accepted causes that one law may do in place of."""
    for i, j in combinations(sorted(places), 2):
        if words := _common_words(problem.accepted[i], problem.accepted[j]):
            yield OneLaw((i, j), _lead(problem, i, j), words)


def _common_words(one: AcceptedCause, two: AcceptedCause) -> tuple[str, ...]:
    """What two causes of coefficients of the same groups and axes both act by."""
    a, b = one.candidate, two.candidate
    alike = (a.of, a.axes) == (b.of, b.axes) and np.array_equal(a.code, b.code) and np.any(one.hit & two.hit)
    if a.effect is None or b.effect is None or not alike:
        return ()
    words = tuple(dict.fromkeys((acts_by(a.effect), acts_by(b.effect))))
    return words if len(words) == 1 or (a.moving != b.moving and _is_same_course(one, two)) else ()


def _is_same_course(one: AcceptedCause, two: AcceptedCause) -> bool:
    """Whether the visits of two causes follow each other but for a factor."""
    x, y = (_shown(item)[0].ravel() for item in (one, two))
    return bool((x @ y) ** 2 > (1 - SAME_COURSE) * (x @ x) * (y @ y))


def _lead(problem: ScoringProblem, i: int, j: int) -> float:
    """How much likelier the readings are with one law than with two causes: its direction averaged over all."""
    bare, floor = problem.without(j).without(i), problem.fit().floor
    one, two = (problem.accepted[k].in_view(bare.view) for k in (i, j))
    moving, parts = one.candidate.moving or two.candidate.moving, (_shown(one), _shown(two))
    middle, width = 0.0, np.pi
    for _ in range(TIMES_CLOSER + 1):
        angles = middle + width * ((np.arange(DIRECTIONS) + 0.5) / DIRECTIONS - 0.5)
        laws = [_law(one.candidate, f"one-law/{k}", parts, float(x)) for k, x in enumerate(angles)]
        now = score_bank(bare, [build_bank(laws, bare.view.layout, moving=moving)], floor)
        nats = now.readings().evidence[0]
        best, averaged = int(nats.argmax()), float(log_mean_exp(nats) + np.log(width / np.pi))
        middle, width = float(angles[best]), 3 * width / DIRECTIONS
    law = now.accept(laws[best], bare.view, one.hit | two.hit)
    with_it = bare.with_accepted((*bare.accepted, law))
    return _nats(with_it, floor, moving) + averaged - float(nats[best]) - _nats(problem, floor, moving)


def _nats(problem: ScoringProblem, floor: NoiseFloor, moving: bool) -> float:
    return marginal_nats(problem, problem.space(floor, moving=moving))


def _shown(item: AcceptedCause) -> Columns:
    """The columns of a cause where it acts, of visits of a mean square of one together."""
    c = item.candidate.even
    there, dwell = item.hit[c.code].astype(float), c.dwell
    visit = c.visit * there[:, None, None]
    size = max(float(np.sqrt(np.mean(np.sum(visit**2, axis=(1, 2))))), 1e-300)
    return visit / size, None if dwell is None else dwell * there[:, None, None, None] / size


def _law(like: Candidate, name: str, parts: tuple[Columns, Columns], angle: float) -> Candidate:
    """What moves by two parts in a ratio, in the groups of a cause."""
    weights = np.cos(angle), np.sin(angle)
    visit = sum(w * visit for w, (visit, _) in zip(weights, parts, strict=True))
    inside = [w * dwell for w, (_, dwell) in zip(weights, parts, strict=True) if dwell is not None]
    columns = CauseColumns.of(np.asarray(visit), np.sum(inside, axis=0) if inside else None)
    pattern: Pattern = "shared" if like.pattern == "shared" else "own"
    return Candidate(name, None, like.of, pattern, like.code, like.names, columns)
