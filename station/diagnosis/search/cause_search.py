"""Causes one after another, until nothing alarms."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates import kernels as generic
from station.diagnosis.candidates.bank import (
    Bank,
    Candidate,
    build_bank,
    candidates,
    cause_library,
    disturbed_readings,
    is_testable,
    smooth_causes,
)
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.projected_bank import visible_candidates
from station.diagnosis.candidates.shape import (
    evidence_of,
    has_jump,
    may_ring,
    refine_jump_time,
    tunable_parameters,
    tune_form,
    with_ringing,
)
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import FittedFloor, NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.alarm import EXPLAINS_NATS, UNKNOWN_NATS, NullDistribution, statistic
from station.diagnosis.search.distinguishability import (
    SEPARATION_95,
    estimate_signal,
    followed_share,
    separations,
    signature_axes,
)
from station.diagnosis.search.jump_times import fit_jump_times
from station.diagnosis.search.problem import refined
from station.diagnosis.search.rank import (
    RankedCause,
    keep_best,
    rank_causes,
    variance_gains,
    variance_surprise,
    with_free_variance,
)
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import WalkMarginal, marginalise_walks, score_over_walks
from station.model.effects.disturbed_visit import DisturbedVisit

NullFactory = Callable[[ScoringProblem, FittedFloor, WalkMarginal], NullDistribution]

#: A kernel must beat every cause by this share, too: no form, and no mean of a block, is more exact. What it leaves out
#: is found in the next round.
KERNEL_MARGIN = 0.04
#: Causes that are tried together against a kernel, how many of them as the first, and what it costs to choose one more,
#: in nats: one of twenty.
MAX_CHAIN, MAX_STARTS, CHOICE_NATS = 3, 3, 3.0
#: A cause beside a grown floor must gain so many nats to come before it.
EVIDENT_NATS = 6.0
#: A kernel is named beside the leading one where it explains all but this share of what that explains.
NEAR_SHARE = 0.08
#: Causes and kernels looked for at most, and how often one and the same may be found.
MAX_ROUNDS, MAX_REPEATS = 6, 2


@dataclass(frozen=True, slots=True, eq=False)
class CauseFinding:
    """One cause found, or one kernel that no cause explains.

    ranks: log evidence of every cause at that point; chosen: what was accepted; probability of it together with
    `alike`, the causes that cannot be told from it; d: its strength; floor: beside it; words: what an unknown depends
    on.
    """

    name: str
    accepted: AcceptedCause | None
    floor: NoiseFloor
    evidence: Mapping[str, float]
    probability: Mapping[str, float]
    indistinguishable_from: tuple[str, ...]
    d: float
    statistic: float
    words: tuple[str, ...] = ()

    @property
    def covariates(self) -> tuple[str, ...]:
        """On what the kernels depend that explain most where it was found."""
        return self.words or depends_on({n: e for n, e in self.evidence.items() if n in generic.KERNEL_NAMES})


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
    null: NullDistribution | None = None

    @property
    def words(self) -> tuple[str, ...]:
        """What the rest depends on that no cause explains; empty where nothing is left."""
        said = next((f.words for f in self.findings if f.words), ())
        if said or self.statistics[-1] <= self.threshold:
            return said
        kernels = {name: e for name, e in self.rest.items() if name in generic.KERNEL_NAMES}
        return depends_on(kernels) if max(kernels.values(), default=0.0) >= UNKNOWN_NATS else ()

    @property
    def ranking(self) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Log evidence and probability of every cause when the first one was looked for."""
        if self.findings:
            return self.findings[0].evidence, self.findings[0].probability
        causes = {name: e for name, e in self.rest.items() if name not in generic.KERNEL_NAMES}
        return self.rest, dict.fromkeys(causes, 0.0)


def build_banks(view: ResidualView, hidden: Collection[str] = ()) -> tuple[Bank, Bank]:
    """The still and the moving candidates, without the causes that are hidden from these data."""
    effects = [e for e in cause_library(view.scene.recipe) if e.id not in hidden and is_testable(e, view)]
    items = [c for e in effects for c in candidates(e, view)] + generic.kernel_candidates(view)
    items += [] if DisturbedVisit.id in hidden else disturbed_readings(view)
    return build_bank(items, view.layout, moving=False), build_bank(items, view.layout, moving=True)


def _drop_undetectable(problem: ScoringProblem, now: ScoredBank) -> tuple[ScoredBank, tuple[str, ...]]:
    """The stage without the causes that it cannot show, and those: their covariates were not recorded, or the largest
    amplitude ever met would leave nothing here."""
    count = problem.view.reduced.count.sum(1).mean()
    swollen = max(1.0, now.floor.noise * float(np.sqrt(count)) / problem.view.sigma)
    shown = {
        c.name for s in now.seen for c, v in zip(s.bank.candidates, visible_candidates(s, swollen), strict=True) if v
    }
    seen = tuple(s.only([c.name in shown for c in s.bank.candidates]) for s in now.seen)
    return ScoredBank(now.floor, seen), tuple(name for name in smooth_causes() if name not in shown)


def search_causes(problem: ScoringProblem, null_of: NullFactory) -> SearchResult:
    """Everything that can be found. null_of gives the null distribution for the first stage."""
    search = _Search(problem, null_of)
    look = search.look(problem)
    found: list[tuple[CauseFinding, _Look]] = []
    while look.alarms and len(found) < MAX_ROUNDS:
        ranks = search.ranks(look, [f.name for f, _ in found])
        cause, kernel = _leaders(ranks)
        if cause is None or (kernel is not None and is_unknown(kernel.evidence, cause.evidence)):
            # Several causes at once may each explain less than a kernel that follows them all.
            chain = search.chain(look, ranks, [f.name for f, _ in found])
            if not chain and (kernel is None or kernel.evidence < UNKNOWN_NATS):
                # What nobody has described must be as much ahead of chance as of any cause.
                break
            if not chain:
                found.append((_unknown(ranks, look.statistic), look))
                break
            found += chain
        else:
            found.append(search.accepted(look, ranks, cause))
        look = found[-1][1]
    findings = search.judged_again(look.problem, tuple(f for f, _ in found))
    statistics = (search.first.statistic, *(after.statistic for f, after in found if not f.words))
    return SearchResult(
        problem,
        look.problem,
        findings,
        statistics,
        look.threshold,
        look.now,
        search.undetectable,
        look.evidence,
        search.null,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
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


class _Search:
    """The state of a search: the causes that these data cannot show, and the null distribution of the first look."""

    def __init__(self, problem: ScoringProblem, null_of: NullFactory) -> None:
        self._null_of = null_of
        self._null: NullDistribution | None = None
        self.undetectable: tuple[str, ...] = ()
        self.first = self.look(problem)

    @property
    def null(self) -> NullDistribution | None:
        """What scores look like when nothing is wrong."""
        return self._null

    def look(self, problem: ScoringProblem) -> _Look:
        """The whole bank beside everything accepted."""
        if self._null is not None and problem is self.first.problem:
            return self.first
        fitted = problem.fit()
        now = score_bank(problem, build_banks(problem.view, self.undetectable), fitted.floor)
        if self._null is None:
            now, self.undetectable = _drop_undetectable(problem, now)
        around = marginalise_walks(problem, now)
        if self._null is None:
            self._null = self._null_of(problem, fitted, around)
        evidence = around.evidence()
        # The bank follows readings; scatter beyond what the floor may hold shows in the floor alone.
        scatter = [variance_surprise(gain, fitted.space.dof) for gain, _ in variance_gains(problem, fitted).values()]
        surprise = max([statistic(self._null, evidence), *scatter])
        return _Look(problem, now, around, evidence, surprise, self._null.threshold)

    def ranks(self, look: _Look, before: Sequence[str]) -> dict[str, RankedCause]:
        """Every cause and kernel at its best; without what has been found often enough already."""
        banks = tuple(s.bank for s in look.now.seen)
        ranks = rank_causes(look.problem, banks, look.around, generic.KERNEL_NAMES)
        ranks = {name: r for name, r in ranks.items() if before.count(name) < MAX_REPEATS}
        return _tune_forms(look.problem, _prefer_evident_cause(look.problem, banks, ranks))

    def accepted(self, look: _Look, ranks: Mapping[str, RankedCause], cause: RankedCause) -> tuple[CauseFinding, _Look]:
        """A cause as a finding, and the look with it accepted."""
        finding = _finding(look.problem, ranks, cause, look.statistic)
        return finding, self.look(_accept_finding(look.problem, finding))

    def judged_again(self, problem: ScoringProblem, findings: tuple[CauseFinding, ...]) -> tuple[CauseFinding, ...]:
        """The findings, each with the probabilities and the rivals that it has beside all others: what one cause leaves
        behind blurs the first look at another."""
        first = len(self.first.problem.accepted)
        smooth = [f for f in findings if f.accepted is not None]
        if len(smooth) < 2:
            return findings
        again = {id(f): self._judged_beside(problem, first + i, f) for i, f in enumerate(smooth)}
        return tuple(again.get(id(f), f) for f in findings)

    def _judged_beside(self, problem: ScoringProblem, i: int, finding: CauseFinding) -> CauseFinding:
        bare = problem.without(i)
        fitted = bare.fit()
        now = score_bank(bare, build_banks(bare.view, self.undetectable), fitted.floor)
        look = replace(self.first, problem=bare, now=now, around=marginalise_walks(bare, now))
        ranks = self.ranks(look, [])
        if finding.name not in ranks or ranks[finding.name].best is None:
            return finding
        found = _finding(bare, ranks, ranks[finding.name], finding.statistic)
        return replace(finding, probability=found.probability, indistinguishable_from=found.indistinguishable_from)

    def chain(
        self, look: _Look, ranks: Mapping[str, RankedCause], before: Sequence[str]
    ) -> list[tuple[CauseFinding, _Look]]:
        """Causes, one after the other, that together explain at least what the leading kernel does; none where there
        are no such.

        Alone each may explain next to nothing, as what the others do passes for noise; so each of the best few is tried
        as the first. Both ways end in data that a kernel may still follow: the evidence of all steps is compared, and
        each further cause is one more choice out of the library.
        """
        kernel = _leaders(ranks)[1]
        target = 0.0 if kernel is None else kernel.evidence
        causes = _first_of_chains(look.problem, ranks, kernel)
        tried = [self._chain_from(first, look, ranks, before) for first in causes]
        value, found = max(tried, key=lambda pair: pair[0], default=(0.0, []))
        # Where a kernel is still needed in the end, the causes must have paid as an unknown would have to.
        margin = UNKNOWN_NATS if found and found[-1][1].alarms else 0.0
        return found if value >= target + margin else []

    def _chain_from(
        self, cause: RankedCause, look: _Look, ranks: Mapping[str, RankedCause], before: Sequence[str]
    ) -> tuple[float, list[tuple[CauseFinding, _Look]]]:
        """The evidence of a cause and of those that are evident after it, with what a kernel then still explains."""
        total, found = 0.0, list[tuple[CauseFinding, _Look]]()
        while True:
            total += cause.evidence - CHOICE_NATS * bool(found)
            found.append(self.accepted(look, ranks, cause))
            look = found[-1][1]
            if not look.alarms:
                return total, found
            ranks = self.ranks(look, [*before, *(f.name for f, _ in found)])
            best, rival = _leaders(ranks)
            left = 0.0 if rival is None else max(rival.evidence, 0.0)
            if best is None or best.evidence < EVIDENT_NATS or len(found) == MAX_CHAIN:
                return total + left - CHOICE_NATS, found
            cause = best


def _first_of_chains(
    problem: ScoringProblem, ranks: Mapping[str, RankedCause], kernel: RankedCause | None
) -> list[RankedCause]:
    """The causes to begin a chain with: those of the largest evidence, and those that hold most of what the kernel
    follows, each coefficient counted as noise would count it."""
    causes = sorted((r for r in _causes_of(ranks) if r.best is not None), key=lambda r: -r.evidence)
    evident = [r for r in causes if r.evidence > 0][:MAX_STARTS]
    if kernel is None or kernel.best is None:
        return evident
    moving = any(r.best is not None and r.best.dwell is not None for r in (*causes, kernel))
    space = problem.space(kernel.at.floor, moving=moving)
    followed = estimate_signal(kernel.best, problem.view, space, np.ones(len(kernel.best.names)))
    shares = []
    for r in causes:
        assert r.best is not None
        axes = signature_axes(r.best, problem.view, space, r.at.hit(r.best, problem.view, alone=True).astype(float))
        shares.append(followed_share(followed, axes))
    held = [causes[i] for i in np.argsort(shares)[::-1][:MAX_STARTS] if shares[i] > 0]
    return list({r.name: r for r in (*evident, *held)}.values())


def _causes_of(ranks: Mapping[str, RankedCause]) -> list[RankedCause]:
    return [r for name, r in ranks.items() if name not in generic.KERNEL_NAMES]


def _leaders(ranks: Mapping[str, RankedCause]) -> tuple[RankedCause | None, RankedCause | None]:
    """The best cause and the best kernel."""
    causes, kernels = _causes_of(ranks), [r for name, r in ranks.items() if name in generic.KERNEL_NAMES]
    return max(causes, key=lambda r: r.evidence, default=None), max(kernels, key=lambda r: r.evidence, default=None)


def depends_on(kernels: Mapping[str, float]) -> tuple[str, ...]:
    """The covariates of the kernels that explain most, by their evidence; the likeliest first."""
    top = max(kernels.values(), default=0.0)
    near = [name for name, e in kernels.items() if e >= top - max(UNKNOWN_NATS, NEAR_SHARE * top)]
    near.sort(key=lambda name: -kernels[name])
    return tuple(dict.fromkeys(word for name in near for word in generic.covariates_of(name)))


def _accept_finding(problem: ScoringProblem, finding: CauseFinding) -> ScoringProblem:
    """The problem with what was found accepted and everything known at its best."""
    problem = replace(problem, near=finding.floor)
    if finding.accepted is None:
        return with_free_variance(problem, finding.name)
    return refined(problem.beside((*problem.accepted, finding.accepted)))


def _prefer_evident_cause(
    problem: ScoringProblem, banks: Sequence[Bank], ranks: dict[str, RankedCause]
) -> dict[str, RankedCause]:
    """A grown floor explains anything a little: where it leads, but a cause is evident beside it, that cause leads."""
    leader = max(ranks.values(), key=lambda r: r.evidence, default=None)
    if leader is None or leader.best is not None or leader.name in generic.KERNEL_NAMES:
        return ranks
    grown = with_free_variance(problem, leader.name)
    now = score_over_walks(grown, banks, grown.fit(leader.at.floor).floor)
    beside_it: dict[str, RankedCause] = {}
    keep_best(beside_it, now, now.without())
    # A jump that the bank's times miss by a stop is two steps of a walk.
    beside_it = _tune_forms(grown, beside_it)
    cause = _leaders(beside_it)[0]
    if cause is None or cause.evidence < EVIDENT_NATS:
        return ranks
    return {**ranks, cause.name: replace(cause, evidence=leader.evidence + cause.evidence)}


def _tune_forms(problem: ScoringProblem, ranks: dict[str, RankedCause]) -> dict[str, RankedCause]:
    """The same with the form of each promising cause at its best."""
    top = max((r.evidence for r in ranks.values()), default=0.0)
    leads = any(r.evidence == top for name, r in ranks.items() if name in generic.KERNEL_NAMES)
    for name, r in ranks.items():
        if r.best is None or r.best.effect is None:
            continue
        # Without its waves a cause that rings explains next to nothing.
        if r.evidence < 0.25 * top and not (leads and may_ring(r.best.effect)):
            continue
        space = problem.space(r.at.floor, moving=r.best.dwell is not None)
        best = _with_best_form(r.best, problem.view, space)
        if leads and may_ring(r.best.effect):
            ringing = _with_best_form(with_ringing(r.best, problem.view, space), problem.view, space)
            quiet, loud = (evidence_of(c, problem.view, space) for c in (best, ringing))
            # A frequency is one more thing to choose: it must pay for itself.
            best = ringing if loud > quiet + UNKNOWN_NATS else best
        if best is not r.best:
            gain = evidence_of(best, problem.view, space) - evidence_of(r.best, problem.view, space)
            bank = build_bank([best], problem.view.layout, moving=best.dwell is not None)
            ranks[name] = RankedCause(name, r.evidence + max(gain, 0.0), best, score_bank(problem, [bank], r.at.floor))
    return ranks


def _with_best_form(candidate: Candidate, view: ResidualView, space: ResidualSpace) -> Candidate:
    """The candidate with its form at its best."""
    best = refine_jump_time(candidate, view, space) if has_jump(candidate.effect) else candidate
    if not tunable_parameters(best.effect):
        return best
    found, before = tune_form(best, view, space)[0], evidence_of(best, view, space)
    # One parameter of a form is tuned after the other: where there are two, it takes some rounds.
    for _ in range(MAX_ROUNDS if len(tunable_parameters(best.effect)) > 1 else 0):
        now = evidence_of(found, view, space)
        if now - before < UNKNOWN_NATS:
            break
        found, before = tune_form(found, view, space)[0], now
    return found


def is_unknown(kernel: float, cause: float) -> bool:
    """Whether a kernel, by its evidence, is ahead of every cause, or of causes that explain nothing."""
    return kernel > cause + max(UNKNOWN_NATS, KERNEL_MARGIN * cause) or cause < EXPLAINS_NATS < kernel


def _unknown(ranks: Mapping[str, RankedCause], surprise: float) -> CauseFinding:
    """The leading kernel, which no cause explains."""
    evidence = {name: r.evidence for name, r in ranks.items()}
    kernel = _leaders(ranks)[1]
    assert kernel is not None
    words = depends_on({name: e for name, e in evidence.items() if name in generic.KERNEL_NAMES})
    return CauseFinding(kernel.name, None, kernel.at.floor, evidence, {}, (), 0.0, surprise, words)


def _finding(
    problem: ScoringProblem, ranks: Mapping[str, RankedCause], cause: RankedCause, surprise: float
) -> CauseFinding:
    """A cause with those it cannot be told from. Its probability is that against everything a kernel can follow too:
    what nobody has described yet is as much less likely beforehand as it must be ahead to be called unknown."""
    evidence = {name: r.evidence for name, r in ranks.items()}
    causes = _causes_of(ranks)
    likely = _credible(_posterior({r.name: r.evidence for r in causes}))
    probability = _posterior({n: e - UNKNOWN_NATS * (n in generic.KERNEL_NAMES) for n, e in evidence.items()})
    accepted, floor = _accept(problem, cause)
    near_by, d = _indistinguishable(problem, causes, accepted, floor)
    members = [n for n in dict.fromkeys((*likely, *near_by)) if n != cause.name]
    return CauseFinding(cause.name, accepted, floor, evidence, probability, tuple(members), d, surprise)


def _accept(problem: ScoringProblem, cause: RankedCause) -> tuple[AcceptedCause | None, NoiseFloor]:
    """The cause with its amplitude under the floor that fits best with it, and that floor."""
    if cause.best is None:
        return None, cause.at.floor
    best, at, hit = cause.best, cause.at, None
    if has_jump(best.effect) and best.pattern == "scan":
        best, hit = fit_jump_times(problem, at.accept(best, problem.view), at.floor)
        at = score_bank(problem, [build_bank([best], problem.view.layout, moving=False)], at.floor)
    floor = problem.beside((*problem.accepted, at.accept(best, problem.view, hit))).fit(at.floor).floor
    own = score_bank(problem, [build_bank([best], problem.view.layout, moving=best.dwell is not None)], floor)
    return own.accept(best, problem.view, hit), floor


def _posterior(evidence: Mapping[str, float]) -> dict[str, float]:
    values = np.array(list(evidence.values()))
    shares = np.exp(values - (log_mean_exp(values) + np.log(len(values))))
    return dict(zip(evidence, (float(s) for s in shares), strict=True))


def _credible(probability: Mapping[str, float], level: float = 0.95) -> list[str]:
    """The likeliest causes that together hold `level` of the probability."""
    chosen: list[str] = []
    for name in sorted(probability, key=lambda n: -probability[n]):
        if sum(probability[n] for n in chosen) >= level:
            break
        chosen.append(name)
    return chosen


def _is_free_in_each_run(candidate: Candidate) -> bool:
    usual = candidate.effect.of[0] if candidate.effect is not None else ""
    return usual == "run" and candidate.pattern == "own"


def _indistinguishable(
    problem: ScoringProblem, causes: Sequence[RankedCause], accepted: AcceptedCause | None, floor: NoiseFloor
) -> tuple[list[str], float]:
    """Causes closer than 3.3 to the accepted one, and its strength d."""
    if accepted is None:
        return [], 0.0
    # An offset of each run's own imitates any slow cause; that parsimony forbids it, no column shows.
    others = [
        (r.best, r.at)
        for r in causes
        if r.best is not None and r.name != accepted.candidate.name and not _is_free_in_each_run(r.best)
    ]
    moving = any(c.dwell is not None for c in (accepted.candidate, *(c for c, _ in others)))
    space = problem.space(floor, moving=moving)
    found = estimate_signal(accepted.candidate, problem.view, space, accepted.hit.astype(float))
    hits = [(c, at.hit(c, problem.view, alone=True).astype(float)) for c, at in others]
    apart = separations(found, hits, problem.view, space)
    return sorted((n for n, x in apart.items() if x < SEPARATION_95), key=lambda n: apart[n]), found.d
