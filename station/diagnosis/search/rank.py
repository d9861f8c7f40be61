"""The ranking of causes over all noise floors worth trying.

The floor that fits best when nothing new acts has swallowed a part of whatever does act. Each cause is therefore
judged under the floor that fits best with that cause: a profile of the likelihood over the floor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.bank import Bank, Candidate
from station.diagnosis.linear.noise_floor import Floor
from station.diagnosis.search.scoring import Problem, Stage, by_cause, stage
from station.diagnosis.search.walk_marginal import Panel
from station.domain.core.types import Floats

#: What a free variance costs against a bounded one, in nats: its size could have been any in a range of e³.
OCCAM = 3.0
#: Causes that are a variance of the floor, and which.
VARIANCES = {"repeatability": 1, "bias-walk": 2}
#: A floor is worth trying when it differs by more than this share from those tried.
NEAR = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Rank:
    """One cause: log evidence over all its shapes, levels and floors; its best candidate, None for a cause that is
    a variance of the floor; and the stage where that stood best."""

    name: str
    evidence: float
    best: Candidate | None
    at: Stage


def rank(problem: Problem, banks: Sequence[Bank], first: Panel, words: Sequence[str]) -> dict[str, Rank]:
    """Every cause under the best of the floors visited, `first` the one without any of them. words: the kernels."""
    zero = first.without()
    best: dict[str, Rank] = {}
    visited: list[Floor] = []
    now: Panel | None = first
    while now is not None and len(visited) < 6:
        visited.append(now.best.floor)
        merge(best, now, zero)
        now = _next(problem, banks, best, visited, words)
    best.update(_floor_causes(problem, first.best))
    return best


def merge(best: dict[str, Rank], now: Panel, zero: Floats) -> None:
    """Takes over what is more evident under the floor of `now`."""
    candidates, total = now.candidates, now.totals() - zero
    for name, value in by_cause(candidates, total[None]).items():
        if name not in best or value[0] > best[name].evidence:
            rows = [i for i, c in enumerate(candidates) if c.name == name]
            chosen = max(rows, key=lambda i: float(total[i]))
            best[name] = Rank(name, float(value[0]), candidates[chosen], now.best)


def _next(
    problem: Problem, banks: Sequence[Bank], best: dict[str, Rank], visited: list[Floor], words: Sequence[str]
) -> Panel | None:
    """The bank under the floor of the leading cause, or else of the leading kernel, if that is a new one."""
    for kernel in (False, True):
        leader = max((r for r in best.values() if (r.name in words) == kernel), key=lambda r: r.evidence, default=None)
        if leader is None or leader.best is None or leader.evidence < 0:
            continue
        with_it = problem.beside((*problem.accepted, leader.at.accept(leader.best, problem.view)))
        found = with_it.fit(leader.at.floor).floor
        if all(_differ(found, f) for f in visited):
            # With the leader known the walk is no longer in question: one floor is enough.
            return Panel(stage(problem, banks, found), (), ())
    return None


def _differ(a: Floor, b: Floor) -> bool:
    return bool(np.any(np.abs(a.variances - b.variances) * _WEIGHT > NEAR * (a.variances[0] + b.variances[0])))


#: How much a variance counts beside white noise: a turn of 1 rad moves 1 g, a step of the walk adds up over a run.
_WEIGHT = np.array([1.0, 1.0, 10.0])


def grown_with(problem: Problem, name: str) -> Problem:
    """The problem with one variance of the floor let free beyond what is allowed."""
    upper = problem.upper.copy()
    upper[VARIANCES[name]] = np.inf
    return replace(problem, upper=upper)


def _floor_causes(problem: Problem, first: Stage) -> dict[str, Rank]:
    """The causes that are variances of the floor, let free beyond what is allowed."""
    found = {}
    bounded = problem.fit(first.floor)
    for name, i in VARIANCES.items():
        if bounded.floor.variances[i] < 0.99 * problem.upper[i]:
            continue
        upper = problem.upper.copy()
        upper[i] = np.inf
        free = problem.fit(bounded.floor, upper)
        gain = free.space.profile - bounded.space.profile - OCCAM
        found[name] = Rank(name, gain, None, Stage(free.floor, first.seen))
    return found
