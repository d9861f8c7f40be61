"""Causes one after another, until nothing alarms."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates import kernels as generic
from station.diagnosis.candidates.bank import Bank, smooth_causes
from station.diagnosis.candidates.projected_bank import visible_candidates
from station.diagnosis.linear.noise_floor import FittedFloor, NoiseFloor
from station.diagnosis.search.alarm import EXPLAINS_NATS, UNKNOWN_NATS, NullDistribution, statistic
from station.diagnosis.search.best_form import tune_forms
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.chain_starts import first_of_chains, parts_of_cause
from station.diagnosis.search.finding import (
    KERNEL_MARGIN,
    CauseFinding,
    cause_finding,
    depends_on,
    is_unknown,
    unknown_finding,
)
from station.diagnosis.search.form_check import compare_laws, compare_laws_with_kernel, compare_laws_with_scatter
from station.diagnosis.search.hidden_state import find_state
from station.diagnosis.search.problem import refined
from station.diagnosis.search.rank import (
    RankedCause,
    keep_best,
    leaders,
    rank_causes,
    variance_gains,
    variance_surprise,
    with_free_variance,
)
from station.diagnosis.search.ripple import find_ripple
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem, score_bank
from station.diagnosis.search.unseen import Unseen
from station.diagnosis.search.walk_marginal import WalkMarginal, marginalise_walks, score_over_walks

NullFactory = Callable[[ScoringProblem, FittedFloor, WalkMarginal], NullDistribution]

#: Causes that are tried together against a kernel, and what it costs to choose one more, in nats: one of twenty.
MAX_CHAIN, CHOICE_NATS = 3, 3.0
#: A cause beside a grown floor must gain so many nats to come before it.
EVIDENT_NATS = 6.0
#: Causes and kernels looked for at most, and how often one and the same may be found.
MAX_ROUNDS, MAX_REPEATS = 6, 2


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """What was found, the problem with all of it known, and the stage at which nothing alarmed any more."""

    first: ScoringProblem
    last: ScoringProblem
    findings: tuple[CauseFinding, ...]
    statistics: tuple[float, ...]
    threshold: float
    stage: ScoredBank
    undetectable: tuple[str, ...]
    rest: Mapping[str, float]
    banks: CandidateBanks
    null: NullDistribution | None = None
    other_forms: tuple[str, ...] = ()

    @property
    def words(self) -> tuple[str, ...]:
        """What the rest depends on that no cause explains, and what the laws do that causes only resemble; empty where
        nothing is left."""
        left = next((f.words for f in self.findings if f.words), ())
        words = tuple(dict.fromkeys((*self.other_forms, *left)))
        if words or self.statistics[-1] <= self.threshold:
            return words
        kernels = {name: e for name, e in self.rest.items() if name in generic.KERNEL_NAMES}
        return depends_on(kernels) if max(kernels.values(), default=0.0) >= UNKNOWN_NATS else ()

    @property
    def ranking(self) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Log evidence and probability of every cause when the first one was looked for."""
        if self.findings:
            return self.findings[0].evidence, self.findings[0].probability
        causes = {name: e for name, e in self.rest.items() if name not in generic.KERNEL_NAMES}
        return self.rest, dict.fromkeys(causes, 0.0)


def _drop_undetectable(problem: ScoringProblem, now: ScoredBank) -> tuple[ScoredBank, tuple[str, ...]]:
    """The stage without the causes that it cannot show, and those: their covariates were not recorded, or the largest
    amplitude ever met would leave nothing here."""
    count = problem.view.reduced.count.sum(1).mean()
    swollen = max(1.0, now.floor.noise * float(np.sqrt(count)) / problem.view.sigma)
    shown = {
        c.name
        for s in now.projected
        for c, v in zip(s.bank.candidates, visible_candidates(s, swollen), strict=True)
        if v
    }
    projected = tuple(s.only([c.name in shown for c in s.bank.candidates]) for s in now.projected)
    return ScoredBank(now.floor, projected), tuple(name for name in smooth_causes() if name not in shown)


def search_causes(problem: ScoringProblem, null_of: NullFactory) -> SearchResult:
    """Everything that can be found. null_of gives the null distribution for the first stage."""
    search = CauseSearch(problem, null_of)
    state = search.state(problem)
    found: list[tuple[CauseFinding, SearchState]] = []
    while state.alarms and len(found) < MAX_ROUNDS:
        ranks = search.ranks(state, [f.name for f, _ in found])
        cause, kernel = leaders(ranks)
        if cause is None or (kernel is not None and is_unknown(kernel.evidence, cause.evidence)):
            # Several causes at once may each explain less than a kernel that follows them all.
            chain = search.chain(state, ranks, [f.name for f, _ in found])
            if not chain and (kernel is None or kernel.evidence < UNKNOWN_NATS):
                # What nobody has described must be as much ahead of chance as of any cause.
                break
            if not chain:
                found.append((unknown_finding(ranks, state.statistic), state))
                break
            found += chain
        else:
            found += search.in_parts(state, ranks, cause, [f.name for f, _ in found])
        state = found[-1][1]
    statistics = [search.first.statistic, *(after.statistic for f, after in found if not f.words)]
    findings, state = search.judged_again(state, tuple(f for f, _ in found))
    statistics[-1] = state.statistic
    findings, other_forms = _with_forms_checked(problem, state, findings)
    return SearchResult(
        problem,
        state.problem,
        findings,
        tuple(statistics),
        state.threshold,
        state.now,
        search.undetectable,
        state.evidence,
        search.banks,
        search.null,
        other_forms,
    )


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """The problem with what is accepted so far, the bank in it, and whether anything alarms."""

    problem: ScoringProblem
    now: ScoredBank
    around: WalkMarginal
    evidence: Mapping[str, float]
    statistic: float
    threshold: float

    @property
    def alarms(self) -> bool:
        """Whether anything is left to explain."""
        return self.statistic > self.threshold


class CauseSearch:
    """The state of a search: the causes that these data cannot show, and the null distribution at the first step."""

    def __init__(self, problem: ScoringProblem, null_of: NullFactory) -> None:
        self._null_of = null_of
        self._null: NullDistribution | None = None
        self.undetectable: tuple[str, ...] = ()
        self.banks = CandidateBanks(problem.view)
        self.first = self.state(problem)

    @property
    def null(self) -> NullDistribution | None:
        """What scores look like when nothing is wrong."""
        return self._null

    def state(self, problem: ScoringProblem) -> SearchState:
        """The whole bank with everything accepted."""
        if self._null is not None and problem is self.first.problem:
            return self.first
        fitted = problem.fit()
        now = score_bank(problem, self.banks.of(problem.view, self.undetectable), fitted.floor)
        if self._null is None:
            now, self.undetectable = _drop_undetectable(problem, now)
        around = marginalise_walks(problem, now)
        if self._null is None:
            self._null = self._null_of(problem, fitted, around)
        unseen = _unseen(problem, fitted.floor)
        evidence = around.evidence() | {name: found.nats for name, found in unseen.items()}
        # The bank follows readings; scatter beyond what the floor may hold shows in the floor alone.
        scatter = [variance_surprise(gain, fitted.space.dof) for gain, _ in variance_gains(problem, fitted).values()]
        surprise = max([statistic(self._null, evidence), *(found.surprise for found in unseen.values()), *scatter])
        return SearchState(problem, now, around, evidence, surprise, self._null.threshold)

    def ranks(self, state: SearchState, before: Sequence[str]) -> dict[str, RankedCause]:
        """Every cause and kernel at its best; without what has been found often enough already."""
        banks = tuple(s.bank for s in state.now.projected)
        ranks = rank_causes(state.problem, banks, state.around, generic.KERNEL_NAMES)
        for name in (generic.RIPPLE, generic.STATE):
            ranks[name] = RankedCause(name, state.evidence[name], None, state.now)
        ranks = {name: r for name, r in ranks.items() if before.count(name) < MAX_REPEATS}
        return tune_forms(state.problem, _prefer_evident_cause(state.problem, banks, ranks))

    def accepted(
        self, state: SearchState, ranks: Mapping[str, RankedCause], cause: RankedCause
    ) -> tuple[CauseFinding, SearchState]:
        """A cause as a finding, and the state with it accepted."""
        finding = cause_finding(state.problem, ranks, cause, state.statistic)
        return finding, self.state(_accept_finding(state.problem, finding))

    def in_parts(
        self, state: SearchState, ranks: Mapping[str, RankedCause], cause: RankedCause, before: Sequence[str]
    ) -> list[tuple[CauseFinding, SearchState]]:
        """The cause, or several of few numbers that together explain more than one of many does alone."""
        accepted = self.accepted(state, ranks, cause)
        parts = parts_of_cause(state.problem, ranks, cause)
        if not parts or accepted[1].alarms:
            return [accepted]
        # A cause that is known already is no other part.
        never_again = [*before, *before, *[cause.name] * MAX_REPEATS]
        tried = [self._chain_from(first, state, ranks, never_again) for first in parts if first.name not in before]
        simpler = [
            (value, found)
            for value, found in tried
            if not found[-1][1].alarms and sum(f.numbers for f, _ in found) <= accepted[0].numbers
        ]
        value, found = max(simpler, default=(-np.inf, []), key=lambda pair: pair[0])
        if value > cause.evidence:
            return found
        return [(accepted[0].beside(value - cause.evidence), accepted[1])]

    def judged_again(
        self, state: SearchState, findings: tuple[CauseFinding, ...]
    ) -> tuple[tuple[CauseFinding, ...], SearchState]:
        """The findings, each with the probabilities and the rivals that it has beside all others: what one cause leaves
        behind blurs the first ranking of another. One that explains nothing any more, and without which nothing alarms,
        was such a blur, and goes."""
        if len(findings) < 2:
            return findings, state
        first = len(self.first.problem.accepted)
        smooth = [f for f in findings if f.accepted is not None]
        again = [self._judged_with_others(state.problem, first + i, f) for i, f in enumerate(smooth)]
        least = min(range(len(again)), key=lambda i: again[i][1], default=None)
        if least is not None and again[least][1] < EXPLAINS_NATS:
            without = self.state(refined(state.problem.without(first + least)))
            if not without.alarms:
                return self.judged_again(without, tuple(f for f in findings if f is not smooth[least]))
        judged = {id(f): new for f, (new, _) in zip(smooth, again, strict=True)}
        return tuple(judged.get(id(f), f) for f in findings), state

    def _judged_with_others(self, problem: ScoringProblem, i: int, finding: CauseFinding) -> tuple[CauseFinding, float]:
        """A finding judged beside all others, and its evidence there."""
        bare = problem.without(i)
        fitted = bare.fit()
        now = score_bank(bare, self.banks.of(bare.view, self.undetectable), fitted.floor)
        evidence = {name: found.nats for name, found in _unseen(bare, fitted.floor).items()}
        state = replace(self.first, problem=bare, now=now, around=marginalise_walks(bare, now), evidence=evidence)
        ranks = self.ranks(state, [])
        if finding.name not in ranks or ranks[finding.name].best is None:
            return finding, finding.evidence[finding.name]
        found = cause_finding(bare, ranks, ranks[finding.name], finding.statistic)
        judged = replace(finding, probability=found.probability, indistinguishable_from=found.indistinguishable_from)
        return judged, ranks[finding.name].evidence

    def chain(
        self, state: SearchState, ranks: Mapping[str, RankedCause], before: Sequence[str]
    ) -> list[tuple[CauseFinding, SearchState]]:
        """Causes, one after the other, that together explain at least what the leading kernel does; none where there
        are no such.

        Alone each may explain next to nothing, as what the others do passes for noise; so each of the best few is tried
        as the first. Both ways end in data that a kernel may still follow: the evidence of all steps is compared, and
        each further cause is one more choice out of the library.
        """
        kernel = leaders(ranks)[1]
        target = 0.0 if kernel is None else kernel.evidence
        causes = first_of_chains(state.problem, ranks, kernel)
        tried = [self._chain_from(first, state, ranks, before) for first in causes]
        value, found = max(tried, key=lambda pair: pair[0], default=(0.0, []))
        # Where a kernel is still needed in the end, the causes must have paid as an unknown would have to. Where
        # nothing is left, the kernel must beat them by its share, as it must beat a single cause.
        margin = UNKNOWN_NATS if found and found[-1][1].alarms else -KERNEL_MARGIN * value
        return found if value >= target + margin else []

    def _chain_from(
        self, cause: RankedCause, state: SearchState, ranks: Mapping[str, RankedCause], before: Sequence[str]
    ) -> tuple[float, list[tuple[CauseFinding, SearchState]]]:
        """The evidence of a cause and of those that are evident after it, with what a kernel then still explains."""
        total, found = 0.0, list[tuple[CauseFinding, SearchState]]()
        while True:
            total += cause.evidence - CHOICE_NATS * bool(found)
            found.append(self.accepted(state, ranks, cause))
            state = found[-1][1]
            if not state.alarms:
                return total, found
            ranks = self.ranks(state, [*before, *(f.name for f, _ in found)])
            best, rival = leaders(ranks)
            left = 0.0 if rival is None else max(rival.evidence, 0.0)
            if best is None or best.evidence < EVIDENT_NATS or len(found) == MAX_CHAIN:
                return total + left - CHOICE_NATS, found
            cause = best


def _unseen(problem: ScoringProblem, floor: NoiseFloor) -> dict[str, Unseen]:
    """What no column of the bank shows, under its name as a kernel."""
    return {generic.RIPPLE: find_ripple(problem, floor), generic.STATE: find_state(problem, floor)}


def _with_forms_checked(
    problem: ScoringProblem, last: SearchState, findings: tuple[CauseFinding, ...]
) -> tuple[tuple[CauseFinding, ...], tuple[str, ...]]:
    """The findings with their probabilities against laws of no cause, and the covariates of the laws that are ahead of
    a cause. problem: the one before the search; last: the state with all causes known."""
    checked, words, i = list[CauseFinding](), list[str](), len(problem.accepted)
    for finding in findings:
        if finding.words:
            laws = compare_laws_with_kernel(last.problem, finding)
            checked.append(replace(finding, words=laws.words) if laws.is_ahead else finding)
        elif finding.accepted is None:
            # A variance follows anything a little; what follows a law is no scatter.
            laws = compare_laws_with_scatter(last.problem, finding.name, problem.upper)
            checked.append(replace(finding, words=laws.words) if laws.is_ahead else laws.judged(finding))
        else:
            laws = compare_laws(last.problem, i, last.now.floor)
            checked.append(laws.judged(finding))
            words += laws.words if laws.is_ahead else ()
            i += 1
    return tuple(checked), tuple(dict.fromkeys(words))


def _accept_finding(problem: ScoringProblem, finding: CauseFinding) -> ScoringProblem:
    """The problem with what was found accepted and everything known at its best."""
    problem = replace(problem, near=finding.floor)
    if finding.accepted is None:
        return with_free_variance(problem, finding.name)
    return refined(problem.with_accepted((*problem.accepted, finding.accepted)))


def _prefer_evident_cause(
    problem: ScoringProblem, banks: Sequence[Bank], ranks: dict[str, RankedCause]
) -> dict[str, RankedCause]:
    """A grown floor explains anything a little: where it leads, but a cause is evident beside it, that cause leads."""
    leader = max(ranks.values(), key=lambda r: r.evidence, default=None)
    if leader is None or leader.best is not None or leader.name in generic.KERNEL_NAMES:
        return ranks
    grown = with_free_variance(problem, leader.name)
    now = score_over_walks(grown, banks, grown.fit(leader.at.floor).floor)
    rivals: dict[str, RankedCause] = {}
    keep_best(rivals, now, now.without())
    # A jump that the bank's times miss by a stop is two steps of a walk.
    rivals = tune_forms(grown, rivals)
    cause = leaders(rivals)[0]
    if cause is None or cause.evidence < EVIDENT_NATS:
        return ranks
    return {**ranks, cause.name: replace(cause, evidence=leader.evidence + cause.evidence)}
