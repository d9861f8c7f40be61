"""A second look at what was found, each cause beside all others: what one cause leaves behind blurs the first ranking
of another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.search.cause_chains import MAX_CHAIN
from station.diagnosis.search.finding import CauseFinding, cause_finding
from station.diagnosis.search.held_out_gain import held_out_gain
from station.diagnosis.search.other_starts import AHEAD_NATS
from station.diagnosis.search.problem import refined
from station.diagnosis.search.rank import RankedCause, causes_of
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.search_state import EVIDENT_NATS, CauseSearch, SearchState, unseen_kernels
from station.diagnosis.search.walk_marginal import marginalise_walks


@dataclass(frozen=True, slots=True, eq=False)
class _BesideOthers:
    """A finding judged beside all others: the problem without it, every cause and kernel there, its evidence."""

    bare: ScoringProblem
    ranks: Mapping[str, RankedCause]
    judged: CauseFinding
    evidence: float

    def better(self, accepted: Sequence[AcceptedCause], i: int, *, pays: bool) -> list[RankedCause]:
        """What may be right in place of accepted cause i, the likeliest first: another cause that is ahead, or the same
        at another level; where it gains nothing on held-out data, any that is as likely but for chance."""
        known = {item.candidate.name for k, item in enumerate(accepted) if k != i}
        least, mine = self.evidence + (AHEAD_NATS if pays else -AHEAD_NATS), accepted[i].candidate
        found = list[RankedCause]()
        for r in causes_of(self.ranks):
            if r.best is None or r.name in known or not r.at.shows(r.best):
                continue
            if r.evidence > least if r.name != mine.name else r.best.of != mine.of:
                found.append(r)
        return sorted(found, key=lambda r: -r.evidence)[:MAX_CHAIN]


def judged_again(
    search: CauseSearch, state: SearchState, findings: tuple[CauseFinding, ...]
) -> tuple[tuple[CauseFinding, ...], SearchState]:
    """The findings, each with the probabilities and the rivals that it has beside all others. One that no longer
    explains anything, and without which nothing alarms, was a remainder of another, and is dropped."""
    return (_confirmed if len(findings) < 2 else _judged)(search, state, findings, MAX_CHAIN)


def _confirmed(
    search: CauseSearch, state: SearchState, findings: tuple[CauseFinding, ...], most: int
) -> tuple[tuple[CauseFinding, ...], SearchState]:
    """The finding alone; or, where nothing held out confirms it, one of at most so many others that these data cannot
    tell from it, that are as likely but for chance, leave nothing and are confirmed. A jump before the last visit moves
    that one alone, and so does whatever disturbs it."""
    first = len(search.first.problem.accepted)
    if state.alarms or not findings or findings[0].accepted is None:
        return findings, state
    if held_out_gain(state.problem, first, state.now.floor).accepted:
        return findings, state
    one = _beside_others(search, state.problem, first, findings[0])
    for cause in one.better(state.problem.accepted, first, pays=False)[:most]:
        if cause.name in findings[0].indistinguishable_from and (found := _in_place(search, state, one, first, cause)):
            return (found[0],), found[1]
    return findings, state


def _judged(
    search: CauseSearch, state: SearchState, findings: tuple[CauseFinding, ...], exchanges: int
) -> tuple[tuple[CauseFinding, ...], SearchState]:
    """The same, of one that is left alone, too: its rivals are others now."""
    first = len(search.first.problem.accepted)
    smooth = [f for f in findings if f.accepted is not None]
    again = [_beside_others(search, state.problem, first + i, f) for i, f in enumerate(smooth)]
    least = min(range(len(again)), key=lambda i: again[i].evidence, default=None)
    if least is not None and again[least].evidence < EVIDENT_NATS:
        without = search.state(refined(state.problem.without(first + least)))
        if not without.alarms:
            return _judged(search, without, tuple(f for f in findings if f is not smooth[least]), exchanges)
    if exchanges and (better := _exchanged(search, state, again)) is not None:
        i, finding, changed = better
        return _judged(search, changed, tuple(finding if f is smooth[i] else f for f in findings), exchanges - 1)
    judged = {id(f): new.judged for f, new in zip(smooth, again, strict=True)}
    return tuple(judged.get(id(f), f) for f in findings), state


def _beside_others(search: CauseSearch, problem: ScoringProblem, i: int, finding: CauseFinding) -> "_BesideOthers":
    """Accepted cause i, a finding, beside all others."""
    bare = problem.without(i)
    fitted = bare.fit()
    now = score_bank(bare, search.banks.of(bare.view, search.undetectable), fitted.floor)
    evidence = {name: unseen.nats for name, unseen in unseen_kernels(bare, fitted.floor).items()}
    state = replace(search.first, problem=bare, now=now, around=marginalise_walks(bare, now), evidence=evidence)
    ranks = search.ranks(state, [])
    if finding.name not in ranks or ranks[finding.name].best is None:
        return _BesideOthers(bare, {}, finding, finding.evidence[finding.name])
    found = cause_finding(bare, ranks, ranks[finding.name], finding.statistic)
    judged = replace(finding, probability=found.probability, indistinguishable_from=found.indistinguishable_from)
    return _BesideOthers(bare, ranks, judged, ranks[finding.name].evidence)


def _exchanged(
    search: CauseSearch, state: SearchState, again: Sequence["_BesideOthers"]
) -> tuple[int, CauseFinding, SearchState] | None:
    """Which finding gives way to another cause, or to itself at another level, that gains on held-out data in its place
    and leaves nothing; that as a finding, and the state with it. What others left behind decides between two such by
    little, what they predict by much."""
    first = len(search.first.problem.accepted)
    pays = [held_out_gain(state.problem, first + i, state.now.floor).accepted for i in range(len(again))]
    for i, one in enumerate(again):
        if not pays[i] and not any(pays):
            continue
        for cause in one.better(state.problem.accepted, first + i, pays=pays[i]):
            if found := _in_place(search, state, one, first + i, cause):
                return i, *found
    return None


def _in_place(
    search: CauseSearch, state: SearchState, one: "_BesideOthers", i: int, cause: RankedCause
) -> tuple[CauseFinding, SearchState] | None:
    """Another cause in place of accepted cause i, and the state with it; None where it leaves something or gains
    nothing on held-out data."""
    finding = cause_finding(one.bare, one.ranks, cause, one.judged.statistic)
    if finding.accepted is None:
        return None
    items = list(state.problem.accepted)
    items[i] = finding.accepted
    changed = search.state(refined(one.bare.with_accepted(items)))
    pays = not changed.alarms and held_out_gain(changed.problem, i, changed.now.floor).accepted
    return (finding, changed) if pays else None
