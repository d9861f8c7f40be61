"""Formulas for what no cause of the library explains: sized, and accepted only if they gain on held-out data."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.shape import FormEstimate
from station.diagnosis.data.sample_source import SampleSource
from station.diagnosis.discovery.covariates import term_covariates
from station.diagnosis.discovery.discover import MAX_TERMS, AlarmOnRest, Discovery, FoundTerm, ThresholdOf, discover
from station.diagnosis.discovery.scan import scanned_units
from station.diagnosis.discovery.term_fit import TermFit, TermSpace, accepted, candidate_of, constant_stds
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.results.estimate import Estimate, joint_coefficients, students_share
from station.diagnosis.results.first_formula import SEED
from station.diagnosis.search.cause_search import SearchResult
from station.diagnosis.search.held_out_gain import HeldOutGain, gain_together, held_out_gain
from station.diagnosis.search.problem import refined
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats


@dataclass(frozen=True, slots=True, eq=False)
class HypothesisTerm:
    """A term with its size and its own gain beside the others."""

    found: FoundTerm
    estimate: Estimate
    gain: HeldOutGain


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """terms: of the formula, none where nothing expressible fits; gain: of all together; quiet: nothing but noise is
    left once they are known; complete: besides, no other form says as much; problem: with them accepted; threshold:
    the score that chance reaches; data: hash."""

    terms: tuple[HypothesisTerm, ...]
    gain: HeldOutGain | None
    quiet: bool
    complete: bool
    problem: ScoringProblem
    floor: FittedFloor
    threshold: float
    data: str

    @property
    def covariates(self) -> tuple[str, ...]:
        """Words of `unknown.depends_on` for what its terms depend on."""
        return tuple(dict.fromkeys(word for t in self.terms for word in term_covariates(t.found.fit.term)))

    def words_of_rest(self, left: tuple[str, ...]) -> tuple[str, ...]:
        """What the remainder depends on that no cause explains. `left` holds the words before the formula, which may
        have replaced causes that left nothing. Where the two share no covariate, one of them is wrong and the data do
        not say which, so both are given."""
        own = self.covariates
        if not left or (self.complete and set(own) & set(left)):
            return own
        both = (*own, *left) if self.complete else (*left, *own)
        return left if set(own) & set(left) else tuple(dict.fromkeys(both))


def propose_formula(
    searched: SearchResult,
    last: ScoringProblem,
    paying: Sequence[AcceptedCause],
    samples: SampleSource,
    threshold_of: ThresholdOf | None = None,
    most_terms: int = MAX_TERMS,
) -> Hypotheses:
    """The formula for what a diagnosis leaves unexplained, or none where it takes more terms. last: the problem with
    every cause found; paying: those that gain on held-out data."""
    known = None if paying or searched.law is None else searched.law.found
    if isinstance(known, Discovery) and (known.terms or most_terms == 1):
        return _accepted(known, data_hash(samples))
    assert searched.null is not None
    problem = only_with(last, len(searched.first.accepted), paying)
    alarm = AlarmOnRest(searched.null, searched.undetectable, searched.banks)
    found = discover(problem, alarm, SEED, threshold_of, most_terms)
    return _accepted(found, data_hash(samples))


def data_hash(samples: SampleSource) -> str:
    """SHA-256 of times and readings, its first 16 digits."""
    digest = hashlib.sha256()
    for name in ("time_s", "reading"):
        for table in samples.portions():
            digest.update(np.ascontiguousarray(getattr(table, name), float).tobytes())
    return digest.hexdigest()[:16]


def only_with(problem: ScoringProblem, first: int, causes: Sequence[AcceptedCause]) -> ScoringProblem:
    """The problem with the causes of the model (the first so many) and the given ones, and no other."""
    kept = {id(item) for item in causes}
    gone = [i for i, item in enumerate(problem.accepted) if i >= first and id(item) not in kept]
    for i in reversed(gone):
        problem = problem.without(i)
    return refined(problem, rounds=2) if gone else problem


def _accepted(found: Discovery, data: str) -> Hypotheses:
    """What held-out data confirm of a discovery."""
    problem, terms = found.problem, list(found.terms)
    floor = problem.fit()
    gains = [held_out_gain(problem, found.first + i, floor.floor) for i in range(len(terms))]
    while terms and not all(g.accepted for g in gains):
        # One after another, the least first: beside it, another may gain nothing.
        worst = min(range(len(terms)), key=lambda i: gains[i].log_score / max(gains[i].std_error, 1e-300))
        problem = refined(problem.without(found.first + worst), rounds=2)
        del terms[worst]
        floor = problem.fit()
        gains = [held_out_gain(problem, found.first + i, floor.floor) for i in range(len(terms))]
    whole = gain_together(problem, range(found.first, found.first + len(terms)), floor.floor) if terms else None
    sized = _estimates(problem, found.first, terms, floor)
    every = len(terms) == len(found.terms)
    rows = tuple(HypothesisTerm(t, e, g) for t, e, g in zip(terms, sized, gains, strict=True))
    quiet, complete = found.quiet and every, found.complete and every
    return Hypotheses(rows, whole, quiet, complete, problem, floor, found.threshold, data)


def _estimates(problem: ScoringProblem, first: int, terms: Sequence[FoundTerm], floor: FittedFloor) -> list[Estimate]:
    """Coefficients and constants with standard deviations."""
    return [_estimate(problem, i, term, floor) for i, term in enumerate(terms, first)]


def _estimate(problem: ScoringProblem, i: int, term: FoundTerm, floor: FittedFloor) -> Estimate:
    """Those of one term, which is the accepted cause i: standard deviations of which 1.96 cover 95 %."""
    bare = problem.without(i)
    space = bare.space(floor.floor, moving="since_arrival_s" in term.fit.term.needs)
    stds = constant_stds(term.fit, TermSpace(bare.view, scanned_units(bare, bare.view.grid.units), space))
    forms = tuple(FormEstimate(field, value, stds[field]) for field, value in term.fit.term.constants)
    value, std = joint_coefficients(problem, problem.accepted, floor)[i]
    for form in forms:
        std = np.hypot(std, _moved_by(bare, problem, i, term, form, value, floor))
    return Estimate(problem.accepted[i], value, students_share(floor.space.dof) * std, forms)


def rival_estimates(h: Hypotheses, i: int) -> Iterator[tuple[TermFit, Estimate]]:
    """What cannot be told from term i of a formula, each with the coefficients that it has in its place."""
    at = len(h.problem.accepted) - len(h.terms) + i
    bare = h.problem.without(at)
    for rival in h.terms[i].found.equivalent:
        items = [*bare.accepted[:at], accepted(rival, bare.view, h.terms[i].found.name), *bare.accepted[at:]]
        with_rival = refined(bare.with_accepted(items), rounds=2)
        floor = with_rival.fit()
        found = FoundTerm(h.terms[i].found.name, rival, rival.score, ())
        yield rival, _estimate(with_rival, at, found, floor)


def _moved_by(
    bare: ScoringProblem,
    problem: ScoringProblem,
    i: int,
    term: FoundTerm,
    form: FormEstimate,
    value: Floats,
    floor: FittedFloor,
) -> Floats:
    """How far the coefficients move when a constant moves by its standard deviation to either side, or to the end of
    its range (beyond it the deviation only says that the data do not determine the constant). Rms, as coefficients may
    move together; only the size matters for the bend of a saturation."""
    low, high = term.fit.term.range_of(form.field)
    ends = []
    for sign in (-1, 1):
        end = min(max(form.value + sign * form.std, low), high)
        moved = candidate_of(
            term.fit.term.with_constants(**{form.field: end}),
            bare.view,
            term.fit.rms,
            term.name,
        )
        item = problem.accepted[i]
        other = replace(item, candidate=moved, coefficient=np.zeros(item.coefficient.shape))
        items = [*bare.accepted[:i], other, *bare.accepted[i:]]
        ends.append(joint_coefficients(bare, items, floor)[i][0])
    return np.asarray(np.sqrt(np.mean([(end - value) ** 2 for end in ends], axis=0)))
