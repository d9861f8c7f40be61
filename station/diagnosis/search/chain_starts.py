"""Where to begin a chain of causes: behind a kernel, or behind one cause of many numbers."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from station.diagnosis.search.distinguishability import (
    EstimatedSignal,
    SignatureAxes,
    estimate_signal,
    followed_share,
    signature_axes,
)
from station.diagnosis.search.rank import RankedCause, causes_of
from station.diagnosis.search.scoring import ScoringProblem

#: Causes that are tried as the first of a chain.
MAX_STARTS = 3
#: A part of a cause has at most this share of its numbers, and follows at least this share of what the cause does.
PART_NUMBERS, PART_SHARE = 0.5, 0.15


def first_of_chains(
    problem: ScoringProblem, ranks: Mapping[str, RankedCause], kernel: RankedCause | None
) -> list[RankedCause]:
    """The causes to begin a chain with: those of the largest evidence, and those that hold most of what the kernel
    follows, in excess of what noise would give each coefficient."""
    causes = _visible(ranks)
    evident = [r for r in causes if r.evidence > 0][:MAX_STARTS]
    if kernel is None or kernel.best is None:
        return evident
    shares = [followed_share(signal, axes) for signal, axes in _beside(problem, kernel, causes)]
    held = [causes[i] for i in np.argsort(shares)[::-1][:MAX_STARTS] if shares[i] > 0]
    return list({r.name: r for r in (*evident, *held)}.values())


def parts_of_cause(problem: ScoringProblem, ranks: Mapping[str, RankedCause], whole: RankedCause) -> list[RankedCause]:
    """The causes of few numbers that hold most of what one of many does: an offset of each unit in each run follows
    whatever an offset of each nest and a warm-up do together."""
    if whole.best is None:
        return []
    evident = (r for r in _visible(ranks) if r.name != whole.name and r.evidence > 0)
    causes = [r for r in evident if r.best is not None and not r.best.moving]
    shares = []
    for signal, axes in _beside(problem, whole, causes):
        small = np.count_nonzero(axes.m) <= PART_NUMBERS * np.count_nonzero(signal.axes.m)
        shares.append(followed_share(signal, axes) if small else 0.0)
    return [causes[i] for i in np.argsort(shares)[::-1][:MAX_STARTS] if shares[i] > PART_SHARE]


def _visible(ranks: Mapping[str, RankedCause]) -> list[RankedCause]:
    """The causes that leave anything, the most evident first."""
    there = (r for r in causes_of(ranks) if r.best is not None and r.at.shows(r.best))
    return sorted(there, key=lambda r: -r.evidence)


def _beside(
    problem: ScoringProblem, leader: RankedCause, causes: Sequence[RankedCause]
) -> Iterator[tuple[EstimatedSignal, SignatureAxes]]:
    """What the leader follows, and what each cause can, one after the other: axes are as long as all readings."""
    assert leader.best is not None
    moving = any(r.best is not None and r.best.moving for r in (*causes, leader))
    space = problem.space(leader.at.floor, moving=moving)
    hit = leader.at.hit(leader.best, problem.view)
    followed = estimate_signal(leader.best, problem.view.layout, space, hit.astype(float))
    for r in causes:
        assert r.best is not None
        alone = r.at.hit(r.best, problem.view, alone=True).astype(float)
        yield followed, signature_axes(r.best, problem.view.layout, space, alone)
