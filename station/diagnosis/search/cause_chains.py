"""Chains: several causes that together explain what a single cause, or a kernel, explains alone."""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.search.alarm import EXPLAINS_NATS, UNKNOWN_NATS
from station.diagnosis.search.chain_starts import MAX_STARTS, first_of_chains, parts_of_cause
from station.diagnosis.search.finding import KERNEL_MARGIN, CauseFinding
from station.diagnosis.search.problem import marginal_nats
from station.diagnosis.search.rank import OCCAM_NATS, RankedCause, causes_of, leaders
from station.diagnosis.search.search_state import EVIDENT_NATS, MAX_REPEATS, CauseSearch, SearchState

#: Causes that are tried together against a kernel, and what it costs to choose one more, in nats: one of twenty.
MAX_CHAIN, CHOICE_NATS = 3, 3.0

#: Causes found one after the other, each with the state that it leaves.
Chain = list[tuple[CauseFinding, SearchState]]
#: Causes known together, in alphabetical order, whichever came first: name, level and pattern of each.
KnownCauses = tuple[tuple[str, str, str], ...]


def in_parts(
    search: CauseSearch, state: SearchState, ranks: Mapping[str, RankedCause], cause: RankedCause, before: Sequence[str]
) -> Chain:
    """The cause, or several causes of few numbers that together explain more than one of many, or more scatter, does
    alone. Where it leaves something, what follows it counts with it: an error of each position does what a turned
    package does, and of a scatter of every visit as much as it can."""
    accepted = search.accepted(state, ranks, cause)
    is_scatter = cause.best is None
    parts = _evident(ranks) if is_scatter else parts_of_cause(state.problem, ranks, cause)
    if not parts:
        return [accepted]
    whole = chain_from(search, cause, state, ranks, before, set())[1] if accepted[1].alarms else [accepted]
    # A cause that is known already is no other part.
    never_again = before if is_scatter else [*before, *before, *[cause.name] * MAX_REPEATS]
    reached, new = set[KnownCauses](), [first for first in parts if first.name not in before]
    tried = [found for first in new if (found := chain_from(search, first, state, ranks, never_again, reached)[1])]
    # A scatter has one number, and follows nothing.
    most = np.inf if is_scatter else sum(f.numbers for f, _ in whole)
    simpler = [found for found in tried if not found[-1][1].alarms and sum(f.numbers for f, _ in found) <= most]
    found = max(simpler, default=[], key=_whole_nats)
    if not found:
        return [accepted]
    start = marginal_nats(state.problem)
    ahead = _whole_nats(found) - start - (_with_kernel(whole) - start)
    if ahead > -KERNEL_MARGIN * (_with_kernel(whole) - start) * whole[-1][1].alarms:
        return found
    return [(accepted[0].beside(ahead), accepted[1])]


def chain(search: CauseSearch, state: SearchState, ranks: Mapping[str, RankedCause], before: Sequence[str]) -> Chain:
    """Causes, one after the other, that together explain at least what the leading kernel does; none where there are
    none. Alone each may explain next to nothing, because what the others do passes for noise, so each of the best few
    is tried as the first. A kernel may still follow what is left either way: the evidence of all steps is compared, and
    each further cause is one more choice out of the library."""
    kernel = leaders(ranks)[1]
    target = 0.0 if kernel is None else kernel.evidence
    # Alone, what is known already holds nothing more.
    causes = [r for r in first_of_chains(state.problem, ranks, kernel) if r.evidence > 0 or r.name not in before]
    reached = set[KnownCauses]()
    tried = [chain_from(search, first, state, ranks, before, reached) for first in causes]
    quiet = [(v, f) for v, f in tried if f and not f[-1][1].alarms]
    # Of chains that leave nothing the likeliest as a whole: evidence in what the others still leave is too kind to
    # causes of many numbers, which cost little beside so much noise.
    # One that comes twice makes up for what its first size missed.
    likely = max(quiet, key=lambda pair: (_is_of_different_causes(pair[1]), _whole_nats(pair[1])), default=None)
    value, found = likely or max(tried, key=lambda pair: pair[0], default=(0.0, []))
    if likely and len(found) > 1 and not any(_is_picked(f) for f, _ in found):
        # Nor is it kind to the first of two causes that each look like noise beside the other. That which visits were
        # picked out of many is a choice, too, only their evidence knows.
        value = max(value, _known_nats(found) - marginal_nats(state.problem))
    # Where a kernel is still needed in the end, the causes must have paid as an unknown would have to. Where
    # nothing is left, the kernel must beat them by its share, as it must beat a single cause.
    margin = UNKNOWN_NATS if found and found[-1][1].alarms else -KERNEL_MARGIN * value
    return found if value >= target + margin else []


def chain_from(
    search: CauseSearch,
    cause: RankedCause,
    state: SearchState,
    ranks: Mapping[str, RankedCause],
    before: Sequence[str],
    reached: set[KnownCauses],
) -> tuple[float, Chain]:
    """The evidence of a cause and of those that are evident after it, plus what a kernel then still explains. Of chains
    that come to know the same causes, in whatever order, only the first goes on: reached, to which this one adds."""
    total, found, known = 0.0, Chain(), KnownCauses()
    while (known := tuple(sorted((*known, _key(cause))))) not in reached:
        reached.add(known)
        finding, after = search.accepted(state, ranks, cause)
        total += finding.evidence[cause.name] - CHOICE_NATS * bool(found)
        found.append((finding, after))
        state = after
        if not state.alarms:
            return total, found
        ranks = search.ranks(state, [*before, *(f.name for f, _ in found)])
        best, rival = leaders(ranks)
        left = 0.0 if rival is None else max(rival.evidence, 0.0)
        # Scatter needs no column that noise could follow: that it alarms is enough.
        least = EXPLAINS_NATS if best is not None and best.best is None else EVIDENT_NATS
        if best is None or best.evidence < least or len(found) == MAX_CHAIN:
            return total + left - CHOICE_NATS, found
        cause = best
    return -np.inf, found


def _evident(ranks: Mapping[str, RankedCause]) -> list[RankedCause]:
    """The causes that are evident beside no other, the most evident first."""
    evident = [r for r in causes_of(ranks) if r.best is not None and r.evidence > EVIDENT_NATS]
    return sorted(evident, key=lambda r: -r.evidence)[:MAX_STARTS]


def _is_of_different_causes(found: Chain) -> bool:
    return len({f.name for f, _ in found}) == len(found)


def _is_picked(finding: CauseFinding) -> bool:
    return finding.accepted is not None and finding.accepted.candidate.pattern == "scan"


def _whole_nats(found: Chain) -> float:
    """The same with the scatter that would still go with them, because one chain stops at what another has to name."""
    grown = found[-1][1].problem.grown_floors.values()
    more = max((floor.gain for floor in grown), default=0.0) - OCCAM_NATS - CHOICE_NATS
    return _known_nats(found) + max(more, 0.0)


def _known_nats(found: Chain) -> float:
    """How likely the readings are with all causes of a chain known, each further one being one more choice."""
    scatters = sum(f.accepted is None for f, _ in found)
    picked = sum(_picking_nats(f) for f, _ in found)
    return marginal_nats(found[-1][1].problem) - CHOICE_NATS * len(found) - OCCAM_NATS * scatters - picked


def _picking_nats(finding: CauseFinding) -> float:
    """What it costs that the visits or runs which a cause hits are these, and no others."""
    if not _is_picked(finding) or finding.accepted is None:
        return 0.0
    hit = finding.accepted.hit
    return float(np.log(scipy.special.binom(len(hit), np.count_nonzero(hit))))


def _with_kernel(found: Chain) -> float:
    """The same, with what a kernel still explains where something is left."""
    left = found[-1][1]
    kernel = max((e for name, e in left.evidence.items() if name in KERNEL_NAMES), default=0.0)
    return _whole_nats(found) + (kernel - CHOICE_NATS - UNKNOWN_NATS) * left.alarms


def _key(cause: RankedCause) -> tuple[str, str, str]:
    best = cause.best
    return (cause.name, best.of, best.pattern) if best is not None else (cause.name, "", "")
