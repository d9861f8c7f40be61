"""Causes of the library that only imitate a law which a single formula states.

Causes of one covariate each follow a law of two covariates a little: `quadratic` and `warm-up` share part of a square
that follows the rate of the temperature. Each of them alarms and gains on held-out data, because a part of it is true.
So the formula is searched once more with none of them known. The causes are dropped where the formula then leaves only
noise and is more likely with fewer terms, or is the only explanation that leaves noise. Causes that leave something, or
that laws of no cause beat, are dropped where it explains more with fewer terms.

A cause that says the same as a term of the formula keeps its place, because its physics is known. So do causes that
together are the formula: `cross-axis` and rotation are all off-diagonal gains of a matrix, which one term writes. And
so do causes whose laws are the terms of the formula with other coefficients for a unit or an axis: what units have
in common and what each has beside it are found one after the other.

A single cause is also dropped where its remainder is not noise and that of one term is: a step follows a wave. It stays
where another cause that these data cannot separate from it leaves only noise, since that is known physics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.nuisance import AcceptedCause, accepted_columns
from station.diagnosis.data.sample_source import SampleSource
from station.diagnosis.discovery.discover import MAX_TERMS
from station.diagnosis.discovery.price import price
from station.diagnosis.discovery.rest import is_noise, visit_noise
from station.diagnosis.results.hypotheses import Hypotheses, propose_formula
from station.diagnosis.search.cause_chains import CHOICE_NATS
from station.diagnosis.search.cause_search import SearchResult
from station.diagnosis.search.form_check import in_place_of
from station.diagnosis.search.problem import marginal_nats, problem_in_view, refined
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats

#: So many causes that leave nothing are worth a look for one formula that says the same.
LEAST_CAUSES = 2
#: Columns are those of one law when others leave no more than this share of their squares: what rounding does.
SAME_LAW = 1e-6
#: A formula of as many parts as there are causes must be nearer to the data than they by this length of white data.
BEYOND_NOISE = 3.3
#: A prior so many times as wide as that of a found size holds nothing.
LOOSE = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """What accounts for the data: causes of the library and a formula beside them; None where none is needed."""

    causes: tuple[AcceptedCause, ...]
    formula: Hypotheses | None

    @property
    def parts(self) -> int:
        """Causes and terms."""
        return len(self.causes) + (0 if self.formula is None else len(self.formula.terms))


def simplest_explanation(
    searched: SearchResult,
    last: ScoringProblem,
    paying: Sequence[AcceptedCause],
    samples: SampleSource,
    *,
    whole: bool,
    doubted: Sequence[AcceptedCause] | None,
) -> Explanation:
    """The causes that stay, and the formula beside them. last: the problem with every cause found; paying: the causes
    that gain on held-out data; whole: whether these leave only noise; doubted: those of them than which laws of no
    cause are more likely; None where there are no laws more likely than any cause found."""
    doubtful, sure = doubted is not None, [c for c in paying if all(c is not one for one in doubted or ())]
    with_causes = Explanation(tuple(paying), None if whole else propose_formula(searched, last, paying, samples))
    alone_and_likely = whole and not doubtful and len(paying) < LEAST_CAUSES
    if not paying or (alone_and_likely and _leaves_noise(searched, last, paying[0])):
        return with_causes
    quiet = whole or _is_quiet(with_causes)
    # What takes as many terms as there are parts already is no simpler: it need not be looked for.
    most = max(with_causes.parts - 1, 1) if quiet else MAX_TERMS
    alone = propose_formula(searched, last, (), samples, most_terms=most)
    # A cause that nobody doubts keeps its name where another one is doubted.
    if written := _written_in(alone, sure, last):
        return _of_fewest_causes(searched, with_causes, written, last, samples)
    # Causes that leave nothing are known physics: only a whole law takes their place.
    part = not alone.terms or (not alone.quiet and whole and not doubtful)
    if part or (whole and _are_the_formula(alone, paying)):
        return with_causes
    if (quiet or not alone.quiet) and not _is_simpler(alone, with_causes, last):
        return with_causes
    if known := _causes_in(alone, paying):
        mixed = Explanation(known, propose_formula(searched, last, known, samples))
        if _is_quiet(mixed) or not alone.quiet:
            return mixed
    return Explanation((), alone)


def _of_fewest_causes(
    searched: SearchResult,
    with_causes: Explanation,
    written: tuple[AcceptedCause, ...],
    last: ScoringProblem,
    samples: SampleSource,
) -> Explanation:
    """Those of the causes whose laws the formula writes, if they leave only noise; otherwise all."""
    if len(written) == len(with_causes.causes):
        return with_causes
    fewer = Explanation(written, propose_formula(searched, last, written, samples))
    # A term in place of each cause left out writes that cause once more.
    return fewer if _is_quiet(fewer) and fewer.parts < with_causes.parts else with_causes


def _leaves_noise(searched: SearchResult, last: ScoringProblem, cause: AcceptedCause) -> bool:
    """Whether a cause, or one in its place that the data cannot separate from it, leaves only noise."""
    if is_noise(last, ()):
        return True
    (i,) = (i for i, item in enumerate(last.accepted) if item is cause)
    alike = [name for f in searched.findings if f.name == cause.candidate.name for name in f.indistinguishable_from]
    others = (in_place_of(last, i, name) for name in alike)
    return any(is_noise(other, ()) for other in others if other is not None)


def _is_quiet(explanation: Explanation) -> bool:
    return explanation.formula is not None and explanation.formula.quiet


def _is_simpler(alone: Hypotheses, with_causes: Explanation, last: ScoringProblem) -> bool:
    """Whether a formula explains everything in fewer parts, or in as many but far more closely, and is more likely
    after its price."""
    problem = _alike(last if with_causes.formula is None else with_causes.formula.problem)
    bare = _in_noise_of(_alike(alone.problem), problem)
    causes_nats = marginal_nats(problem) - CHOICE_NATS * len(with_causes.causes) - _price(with_causes.formula)
    if len(alone.terms) >= with_causes.parts and _rest(problem) - _rest(bare) < BEYOND_NOISE**2:
        return False
    return marginal_nats(bare) - _price(alone) > causes_nats


def _in_noise_of(problem: ScoringProblem, other: ScoringProblem) -> ScoringProblem:
    """A problem with contrasts in units of another's noise. Each estimates that noise beside what is known there, and a
    hundredth of it, over all contrasts, is more than two forms of one law differ by."""
    return problem_in_view(problem, replace(problem.view, sigma=other.view.sigma), problem.accepted)


def _alike(problem: ScoringProblem) -> ScoringProblem:
    """The problem with a prior on every coefficient as wide as its cause or term came out without one. A prior costs
    half a nat for each coefficient where it is no wider than that, so of two forms of one law the looser would be the
    likelier. And where a walk may absorb a slope, a cause has come out too small to follow it."""
    free = refined(problem.with_accepted([_hardly_held(item) for item in problem.accepted]), rounds=2)
    return free.with_accepted([_held_by_size(item) for item in free.accepted])


def _hardly_held(item: AcceptedCause) -> AcceptedCause:
    return item if np.any(item.mean) else replace(item, std=LOOSE * item.std)


def _held_by_size(item: AcceptedCause) -> AcceptedCause:
    size = float(np.sqrt(np.mean(item.coefficient[item.hit] ** 2))) if item.hit.any() else 0.0
    return item if np.any(item.mean) or size == 0.0 else replace(item, std=np.full(item.std.shape, size))


def _rest(problem: ScoringProblem) -> float:
    """Sum of squares of what a problem leaves, in standard deviations of the visits' own noise."""
    return problem.space(visit_noise(problem), moving=False).rest


def _price(formula: Hypotheses | None) -> float:
    return 0.0 if formula is None else sum(price(t.found.fit.term) for t in formula.terms)


def _causes_in(alone: Hypotheses, paying: Sequence[AcceptedCause]) -> tuple[AcceptedCause, ...]:
    """The causes that say the same as a term of the formula: in its place they leave no more, apart from its price."""
    if len(alone.terms) < 2:
        return ()
    whole = marginal_nats(_alike(alone.problem))
    first = len(alone.problem.accepted) - len(alone.terms)
    found = []
    for cause in paying:
        for i, term in enumerate(alone.terms):
            if _profile_with(cause, alone.problem.without(first + i)) > whole - price(term.found.fit.term):
                found.append(cause)
                break
    return tuple(found)


def _are_the_formula(alone: Hypotheses, causes: Sequence[AcceptedCause]) -> bool:
    """Whether the causes together can do exactly what a formula can, with no more coefficients: one law written twice.
    Causes shared by several units are another law than a formula of each unit."""
    bare = alone.problem
    first = len(bare.accepted) - len(alone.terms)
    terms = bare.accepted[first:]
    if not terms or any(item.candidate.moving for item in (*terms, *causes)):
        return False
    for i in reversed(range(first, len(bare.accepted))):
        bare = bare.without(i)
    view, space = bare.view, bare.fit().space
    if any(_is_shared(item.candidate, bare) for item in (*terms, *causes)):
        return False
    found = [[accepted_columns(item.in_view(view), view.layout)[0] for item in items] for items in (terms, causes)]
    formula, known = (np.concatenate([space.project(rows) for rows in items], axis=2) for items in found)
    if np.any(_count_columns(known) > _count_columns(formula)):
        return False
    for own, columns in zip(known, formula, strict=True):
        rest = columns - own @ np.linalg.lstsq(own, columns, rcond=None)[0]
        if float(np.sum(rest**2)) > SAME_LAW * float(np.sum(columns**2)):
            return False
    return True


def _is_shared(candidate: Candidate, problem: ScoringProblem) -> bool:
    """Whether any coefficient is that of several units: not where each nest holds a unit of its own."""
    units = np.unique(np.stack([candidate.code, problem.view.scene.visits.unit.code]), axis=1)[0]
    return bool(np.bincount(units).max() > 1)


def _count_columns(columns: Floats) -> NDArray[np.intp]:
    """How many columns (U, M, c) of each unit are not nothing."""
    return np.asarray(np.any(columns != 0.0, axis=1).sum(axis=1))


def _written_in(alone: Hypotheses, causes: Sequence[AcceptedCause], last: ScoringProblem) -> tuple[AcceptedCause, ...]:
    """The causes whose laws the terms of a formula are, each unit with coefficients of its own; none unless every term
    is such a law. Where a term may be any of several causes, all of them stay."""
    problem, noise = alone.problem, last.fit().floor.noise
    terms = problem.accepted[len(problem.accepted) - len(alone.terms) :]
    told = [cause for cause in causes if cause.candidate.pattern != "scan"]
    same = [[cause for cause in told if _is_law_of(term, cause, problem, noise)] for term in terms]
    if not same or not all(same):
        return ()
    chosen = {id(cause) for some in same for cause in some}
    return tuple(cause for cause in causes if id(cause) in chosen)


def _is_law_of(term: AcceptedCause, cause: AcceptedCause, problem: ScoringProblem, noise: float) -> bool:
    """Whether a cause follows a term to within one standard deviation of all visits and their contrasts together."""
    view, size = problem.view, np.where(term.hit[:, None], term.coefficient, 0.0)[term.candidate.code]
    follows = cause.in_view(view).candidate
    if term.candidate.moving != follows.moving:
        return False
    known, unit = view.calibration(problem.matrix), view.scene.visits.unit.code
    columns = np.concatenate([follows.visit, known], axis=2)[:, None] / noise
    does = np.einsum("via,va->vi", term.candidate.visit, size)[:, None] / noise
    if term.candidate.dwell is not None and follows.dwell is not None:
        inside = np.concatenate([follows.dwell, np.zeros((*follows.dwell.shape[:3], known.shape[2]))], axis=3)
        columns = np.concatenate([columns, inside / view.sigma], axis=1)
        does = np.concatenate([does, np.einsum("vbia,va->vbi", term.candidate.dwell, size) / view.sigma], axis=1)
    left = 0.0
    for u in np.unique(unit):
        own, target = columns[unit == u].reshape(-1, columns.shape[3]), does[unit == u].ravel()
        left += float(np.sum((target - own @ np.linalg.lstsq(own, target, rcond=None)[0]) ** 2))
    return left < 1.0


def _profile_with(cause: AcceptedCause, bare: ScoringProblem) -> float:
    """Log-likelihood of the readings with a cause beside what is known, at its best."""
    fresh = replace(cause, coefficient=np.zeros(cause.coefficient.shape)).in_view(bare.view)
    return marginal_nats(_alike(refined(bare.with_accepted([*bare.accepted, fresh]), rounds=2)))
