"""Causes one after another, until nothing alarms."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from station.diagnosis.candidates import kernels as generic
from station.diagnosis.search.alarm import UNKNOWN_NATS, NullDistribution
from station.diagnosis.search.axes_apart import search_in_floor
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.cause_chains import Chain, chain, in_parts
from station.diagnosis.search.certainty import as_certain_together
from station.diagnosis.search.extent import ranks_in_extent
from station.diagnosis.search.finding import CauseFinding, depends_on, is_unknown, unknown_finding
from station.diagnosis.search.form_check import (
    RivalLaws,
    compare_laws,
    compare_laws_with_kernel,
    compare_laws_with_scatter,
)
from station.diagnosis.search.one_law import laws_of_two
from station.diagnosis.search.other_starts import best_of_starts
from station.diagnosis.search.rank import RankedCause, causes_of, leaders
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem
from station.diagnosis.search.search_state import (
    EVIDENT_NATS,
    CauseSearch,
    LawAlone,
    LawFactory,
    NullFactory,
)
from station.diagnosis.search.second_look import judged_again

#: Causes and kernels looked for at most.
MAX_ROUNDS = 6


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """What was found, the problem with all of it known, and the stage at which nothing alarmed any more; law: the one
    that was searched before any cause; share: how many units each unit of the stage stands for."""

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
    law: LawAlone | None = None
    share: float = 1.0

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


def search_causes(problem: ScoringProblem, null_of: NullFactory, law_of: LawFactory | None = None) -> SearchResult:
    """Everything that can be found. null_of gives the null distribution for the first stage, law_of a law that may
    stand for all causes."""
    return with_forms_checked(search_unchecked(problem, null_of, law_of))


def search_unchecked(problem: ScoringProblem, null_of: NullFactory, law_of: LawFactory | None = None) -> SearchResult:
    """The same, with each finding's probability against causes and kernels only."""
    search = search_in_floor(problem, null_of)
    found, law = _one_after_another(search, law_of)
    state = found[-1][1] if found else search.first
    statistics = [search.first.statistic, *(after.statistic for f, after in found if not f.words)]
    findings, state = judged_again(search, state, tuple(f for f, _ in found))
    statistics[-1] = state.statistic
    if not state.alarms:
        # What was left beside a cause that was not at its best yet.
        findings = tuple(f for f in findings if not f.words) or findings
    return SearchResult(
        search.first.problem,
        state.problem,
        findings,
        tuple(statistics),
        state.threshold,
        state.now,
        search.undetectable,
        state.evidence,
        search.banks,
        search.null,
        law=law,
    )


def _one_after_another(search: CauseSearch, law_of: LawFactory | None) -> tuple[Chain, LawAlone | None]:
    """Causes, the best first, until nothing alarms; perhaps a kernel at the end. Also the law that was searched first,
    if any: where it explains everything, only the kernel is found."""
    state, found, first, law = search.first, Chain(), dict[str, RankedCause](), None
    chained = False
    while state.alarms and len(found) < MAX_ROUNDS:
        ranks = search.ranks(state, [f.name for f, _ in found])
        first = first or ranks
        cause, kernel = leaders(ranks)
        if cause is not None and kernel is not None and is_unknown(kernel.evidence, cause.evidence):
            ranks = ranks_in_extent(state.problem, [s.bank for s in state.now.projected], ranks, state.now.floor)
            cause, kernel = leaders(ranks)
        if not found and kernel is not None and law_of is not None:
            law = law_of(search, 0.0 if cause is None else cause.evidence, kernel.evidence)
            if law is not None and law.is_whole:
                return _in_place_of(law, search, ranks) or [(unknown_finding(ranks, state.statistic), state)], law
        if cause is None or (kernel is not None and is_unknown(kernel.evidence, cause.evidence)):
            # Several causes at once may each explain less than a kernel that follows them all. What leads again beside
            # such causes is no more of them: they were tried as far as causes go together.
            several = [] if chained else chain(search, state, ranks, [f.name for f, _ in found])
            chained = True
            if not several and (kernel is None or kernel.evidence < UNKNOWN_NATS):
                # What nobody has described must be as much ahead of chance as of any cause.
                break
            found += several or [(unknown_finding(ranks, state.statistic), state)]
            if not several:
                break
        else:
            found += in_parts(search, state, ranks, cause, [f.name for f, _ in found])
        state = found[-1][1]
    return best_of_starts(search, search.first, first, found), law


def _in_place_of(law: LawAlone, search: CauseSearch, ranks: Mapping[str, RankedCause]) -> Chain:
    """Causes that together explain everything too, with no more numbers than the law: off-diagonal gains of a matrix
    are a turned package and axes that are not square. None where there are no such causes."""
    evident = sorted((r for r in causes_of(ranks) if r.evidence > EVIDENT_NATS), key=lambda r: -r.evidence)
    # Chains of causes are dear: none is tried where the best and any other already have more numbers.
    fits = len(evident) > 1 and evident[0].numbers + min(r.numbers for r in evident[1:]) <= law.numbers
    several = chain(search, search.first, ranks, []) if fits else []
    left = several and several[-1][1].alarms
    return [] if left or sum(f.numbers for f, _ in several) > law.numbers else several


def with_forms_checked(found: SearchResult) -> SearchResult:
    """The same, with each finding's probability against laws of no cause as well, and the covariates of the laws that
    are ahead of a cause."""
    problem, last = found.first, found.last
    checked, words, i = list[CauseFinding](), list[str](), len(problem.accepted)
    of_two = list(laws_of_two(last, range(i, len(last.accepted))))
    for finding in found.findings:
        if finding.words:
            laws = compare_laws_with_kernel(last, finding)
            checked.append(replace(finding, words=laws.words) if laws.is_ahead else finding)
        elif finding.accepted is None:
            # A variance follows anything a little; what follows a law is no scatter.
            laws = compare_laws_with_scatter(last, finding.name, problem.upper)
            checked.append(replace(finding, words=laws.words) if laws.is_ahead else laws.judged(finding))
        else:
            laws = compare_laws(last, i, last.fit().floor, finding.indistinguishable_from)
            together = [RivalLaws(law.lead, law.words) for law in of_two if i in law.places]
            laws = max((laws, *together), key=lambda found: found.nats)
            checked.append(laws.judged(finding))
            words += laws.words if laws.is_ahead else ()
            i += 1
    findings = as_certain_together([_with_words_ahead(f) for f in checked], found.statistics[-1], found.threshold)
    return replace(found, findings=findings, other_forms=tuple(dict.fromkeys(words)))


def _with_words_ahead(f: CauseFinding) -> CauseFinding:
    """A cause with what the kernels say that are ahead of it."""
    return f if f.words else replace(f, doubts=tuple(dict.fromkeys((*f.doubts, *f.words_ahead))))
