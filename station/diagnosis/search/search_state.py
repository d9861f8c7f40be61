"""The state of a search: what is accepted so far, the bank in it, and the ranking that it makes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from station.diagnosis.candidates import kernels as generic
from station.diagnosis.candidates.bank import Bank, smooth_causes
from station.diagnosis.candidates.projected_bank import visible_candidates
from station.diagnosis.linear.noise_floor import FittedFloor, NoiseFloor
from station.diagnosis.search.alarm import NullDistribution, statistic
from station.diagnosis.search.bend import bend_nats
from station.diagnosis.search.best_form import tune_forms
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.extent import ranks_beside_scan
from station.diagnosis.search.finding import CauseFinding, cause_finding
from station.diagnosis.search.first_look import sampled_look
from station.diagnosis.search.freed_turn import freed_turn
from station.diagnosis.search.hidden_state import find_states
from station.diagnosis.search.narrow_laws import find_laws
from station.diagnosis.search.problem import refined
from station.diagnosis.search.rank import (
    RankedCause,
    floor_causes,
    keep_best,
    leaders,
    rank_causes,
    variance_surprise,
    with_free_variance,
)
from station.diagnosis.search.restless_arrivals import find_restless_arrivals
from station.diagnosis.search.ripple import find_ripple
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem, score_bank
from station.diagnosis.search.unseen import Unseen
from station.diagnosis.search.walk_marginal import WalkMarginal, marginalise_walks, score_over_walks, slow_candidates

NullFactory = Callable[[ScoringProblem, FittedFloor, WalkMarginal], NullDistribution]
#: The law, if any, that may stand for everything, where the best cause and the best kernel explain so many nats.
LawFactory = Callable[["CauseSearch", float, float], "LawAlone | None"]

#: A cause beside a grown floor must gain so many nats to come before it.
EVIDENT_NATS = 6.0
#: Chance of an alarm by any of the laws, whose chance is that of all of them together.
LAW_LEVEL = 2e-3
#: How often one and the same cause may be found.
MAX_REPEATS = 2


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


class LawAlone(NamedTuple):
    """A law of no cause, as whoever looked for it found it, whether it is all there is, and its numbers."""

    found: object
    is_whole: bool
    numbers: int


class CauseSearch:
    """The state of a search: the causes that these data cannot show, and the null distribution at the first step."""

    def __init__(self, problem: ScoringProblem, null_of: NullFactory) -> None:
        self._null_of = null_of
        self._null: NullDistribution | None = None
        self.undetectable: tuple[str, ...] = ()
        self.banks = CandidateBanks(problem.view)
        self.first = self._first(problem)

    @property
    def null(self) -> NullDistribution | None:
        """What scores look like when nothing is wrong."""
        return self._null

    def state(self, problem: ScoringProblem) -> SearchState:
        """The whole bank with everything accepted."""
        if problem is self.first.problem:
            return self.first
        fitted = problem.fit()
        now = score_bank(problem, self.banks.of(problem.view, self.undetectable), fitted.floor, keep=True)
        return self._judged(problem, fitted, marginalise_walks(problem, now))

    def _first(self, problem: ScoringProblem) -> SearchState:
        """The whole bank before anything is known. Of a fleet in which something leads by far, what is surely behind it
        is looked at in a sample."""
        fitted, banks = problem.fit(), self.banks.of(problem.view, ())
        sampled = sampled_look(problem, banks, fitted.floor)
        contenders = None if sampled is None else sampled.contenders()
        if sampled is not None and contenders is not None:
            shown, self.undetectable = _drop_undetectable(problem, sampled.scored, sampled.sample.share)
            slow = slow_candidates(problem, [s.bank for s in shown.projected], shown.floor)
            self._null = self._null_of(problem, fitted, WalkMarginal(shown, (), slow))
            there = [bank.named({c.name for c in bank.candidates} - set(self.undetectable)) for bank in contenders]
            now = score_bank(problem, there, fitted.floor, keep=True)
            state = self._judged(problem, fitted, marginalise_walks(problem, now))
            if state.alarms:
                return state
        now, self.undetectable = _drop_undetectable(problem, score_bank(problem, banks, fitted.floor, keep=True))
        around = marginalise_walks(problem, now)
        self._null = self._null_of(problem, fitted, around)
        return self._judged(problem, fitted, around)

    def _judged(self, problem: ScoringProblem, fitted: FittedFloor, around: WalkMarginal) -> SearchState:
        """The state, and whether anything in it is beyond chance."""
        assert self._null is not None
        unseen = unseen_kernels(problem, fitted.floor)
        evidence = around.evidence() | {name: found.nats for name, found in unseen.items()}
        # The bank follows readings; scatter beyond what the floor may hold shows in the floor alone.
        scatter = [variance_surprise(grown.gain, fitted.space.dof) for grown in problem.grown_floors.values()]
        surprise = max([statistic(self._null, evidence), *(found.surprise for found in unseen.values()), *scatter])
        evident = max(evidence.values(), default=0.0) >= EVIDENT_NATS
        if not evident or surprise <= self._null.threshold:
            laws = find_laws(problem, fitted.floor, self.banks.of_laws(problem.view))
            evidence |= {name: found.nats for name, found in laws.items()}
            surprise = max([surprise, *(self._null.beside(found.surprise, LAW_LEVEL) for found in laws.values())])
        return SearchState(problem, around.best, around, evidence, surprise, self._null.threshold)

    def ranks(self, state: SearchState, before: Sequence[str]) -> dict[str, RankedCause]:
        """Every cause and kernel at its best; without what has been found often enough already."""
        banks = tuple(s.bank for s in state.now.projected)
        ranks = rank_causes(state.problem, banks, state.around, generic.KERNEL_NAMES)
        ranks |= floor_causes(state.problem, state.now)
        # A state follows whatever moves a unit's axes together, and one of many laws nearly any cause: what is evident
        # comes before them, and they are asked again.
        evident = any(r.evidence >= EVIDENT_NATS for r in ranks.values())
        for name in (generic.RIPPLE,) if evident else (generic.RIPPLE, *generic.STATES, *generic.LAWS):
            if name in state.evidence:
                ranks[name] = RankedCause(name, state.evidence[name], None, state.now)
        ranks = {name: r for name, r in ranks.items() if before.count(name) < MAX_REPEATS}
        ranks = tune_forms(state.problem, _prefer_evident_cause(state.problem, banks, ranks))
        leader = max(ranks.values(), key=lambda r: r.evidence, default=None)
        evident = leader is not None and leader.evidence >= EVIDENT_NATS
        return ranks_beside_scan(state.problem, banks, ranks, state.now.floor) if evident else ranks

    def accepted(
        self, state: SearchState, ranks: Mapping[str, RankedCause], cause: RankedCause
    ) -> tuple[CauseFinding, SearchState]:
        """A cause as a finding, and the state with it accepted."""
        finding = cause_finding(state.problem, ranks, cause, state.statistic)
        after = self.state(_accept_finding(state.problem, finding))
        item = finding.accepted
        bend = bend_nats(after.problem, state.problem, item, finding.floor) if item is not None else 0.0
        if bend > EVIDENT_NATS:
            alike = {finding.name, *finding.indistinguishable_from}
            bent = {n: replace(r, evidence=r.evidence + bend) if n in alike else r for n, r in ranks.items()}
            finding = cause_finding(state.problem, bent, bent[cause.name], state.statistic)
        freed = freed_turn(state.problem, finding) if after.alarms else None
        if freed is None:
            return finding, after
        other = self.state(_accept_finding(state.problem, freed))
        return (freed, other) if other.statistic < after.statistic else (finding, after)


def unseen_kernels(problem: ScoringProblem, floor: NoiseFloor) -> dict[str, Unseen]:
    """What no column of the bank shows, under its name as a kernel."""
    return {
        generic.RIPPLE: find_ripple(problem, floor),
        **find_states(problem, floor),
        **find_restless_arrivals(problem),
    }


def _drop_undetectable(
    problem: ScoringProblem, now: ScoredBank, share: float = 1.0
) -> tuple[ScoredBank, tuple[str, ...]]:
    """The stage without the causes that it cannot show, and those: their covariates were not recorded, or the largest
    amplitude ever met would leave nothing here. share: how many units each of its units stands for."""
    count = problem.view.reduced.count.sum(1).mean()
    swollen = max(1.0, now.floor.noise * float(np.sqrt(count)) / problem.view.sigma)
    shown = {
        c.name
        for s in now.projected
        for c, v in zip(s.bank.candidates, visible_candidates(s, swollen * float(np.sqrt(share))), strict=True)
        if v
    }
    projected = tuple(s.only([c.name in shown for c in s.bank.candidates]) for s in now.projected)
    return ScoredBank(now.floor, projected), tuple(name for name in smooth_causes() if name not in shown)


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
    # A jump that the bank's times miss by a visit is two steps of a walk.
    rivals = tune_forms(grown, rivals)
    cause = leaders(rivals)[0]
    if cause is None or cause.evidence < EVIDENT_NATS:
        return ranks
    return {**ranks, cause.name: replace(cause, evidence=leader.evidence + cause.evidence)}
