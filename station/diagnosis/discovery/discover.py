"""The search for a formula: one term after another, each the best of the whole grammar on what the others leave.

A term is accepted when its score (evidence less price) exceeds what the best of all terms reaches by chance. Terms that
the data cannot separate from it are kept beside it. At the end the alarm of the diagnosis examines the residual: while
anything still alarms, the formula is part of the truth, not the whole.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from station.diagnosis.discovery import chance
from station.diagnosis.discovery.equivalent_terms import SET_NATS, other_families, simplest, unparted
from station.diagnosis.discovery.library import libraries
from station.diagnosis.discovery.merge import TermPair
from station.diagnosis.discovery.other_forms import another_form_says_as_much
from station.diagnosis.discovery.rest import is_noise
from station.diagnosis.discovery.scan import Choice, Scan, scan_of, scanned_units
from station.diagnosis.discovery.term_fit import TermFit, TermSpaces, accepted, fit_term, refine, with_levels
from station.diagnosis.linear.noise_floor import FittedFloor, NoiseFloor
from station.diagnosis.search.alarm import NullDistribution, statistic
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.problem import refined
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import marginalise_walks
from station.model.formula.grammar import GROUP_LEVELS, INPUTS, MODULATORS, columns_of
from station.model.formula.term import Term

#: Terms of a formula at most, and how often one is looked for: several found may be one law of several axes.
MAX_TERMS, MAX_ROUNDS = 3, 6
#: Families whose constants are refined, and how far behind the best of the scan they may be, nats.
MOST_REFINED, REFINED_NATS = 20, 9.0
#: What a law may lose, as a share of its score, where its constants stand between those of the grid.
GRID_SHARE = 0.35
#: A formula is whole only where the next best term is this far below chance, nats.
NEARLY_NATS = 2.0
#: Numbers that must be left beside the calibration: of fewer no law can be read.
LEAST_NUMBERS = 12
#: What a term of the rig's groups, which are not on the grid, must be ahead of chance, nats.
GROUP_NATS = 1.5
#: Units that the scan goes over at most; what it finds is judged by all.
MOST_SCANNED_UNITS = 12

ThresholdOf = Callable[[ScoringProblem, FittedFloor, Sequence[Scan]], float]


@dataclass(frozen=True, slots=True, eq=False)
class FoundTerm:
    """A term of the formula, and those that the data cannot separate from it, the simplest first."""

    name: str
    fit: TermFit
    score: float
    equivalent: tuple[TermFit, ...]

    @property
    def spellings(self) -> tuple[TermFit, ...]:
        """All that it may be, itself first."""
        return (self.fit, *self.equivalent)


@dataclass(frozen=True, slots=True, eq=False)
class Discovery:
    """terms: of the formula, none where nothing expressible fits; problem: with them accepted last; threshold: the
    score that chance reaches; quiet: whether only noise is left; complete: whether, in addition, no other form explains
    as much; first: index of the first term among the accepted."""

    terms: tuple[FoundTerm, ...]
    problem: ScoringProblem
    threshold: float
    quiet: bool
    complete: bool
    first: int


class AlarmOnRest(NamedTuple):
    """The alarm of the diagnosis, applied to what a formula leaves: its null distribution, the causes that these data
    cannot show, and the candidates of these visits."""

    null: NullDistribution
    hidden: Sequence[str]
    banks: CandidateBanks

    def is_quiet(self, problem: ScoringProblem) -> bool:
        """Whether it finds nothing."""
        fitted, banks = problem.fit(), self.banks.of(problem.view, self.hidden)
        now = marginalise_walks(problem, score_bank(problem, banks, fitted.floor))
        return statistic(self.null, now.evidence()) <= self.null.threshold


def discover(
    problem: ScoringProblem,
    alarm: AlarmOnRest | None,
    seed: int,
    threshold_of: ThresholdOf | None = None,
    most_terms: int = MAX_TERMS,
) -> Discovery:
    """The formula for what a problem leaves, or none where it takes more terms. alarm: None where the residual is not
    examined; threshold_of: the score that chance reaches, where it is known already."""
    search = _FormulaSearch(problem, seed, threshold_of)
    found: list[FoundTerm] = []
    bare, first = problem, len(problem.accepted)
    for _ in range(MAX_ROUNDS):
        if len(found) == MAX_TERMS or (best := search.best(problem, f"formula-{len(found) + 1}")) is None:
            break
        problem = _with_term(problem, best)
        found.append(best)
        if len(found) > 1:
            problem, found = search.merged(problem, found, first)
        if len(found) > most_terms:
            return Discovery((), bare, search.threshold, quiet=False, complete=False, first=first)
        if len(found) > 1:
            problem, found = search.fitted_back(problem, found, first)
    terms = [t.fit.term for t in found]
    whole = bool(found) and search.is_exhausted(len(found)) and not is_series(terms)
    quiet = whole and alarm is not None and is_noise(problem, terms) and alarm.is_quiet(problem)
    complete = quiet and not another_form_says_as_much(problem, terms)
    return Discovery(tuple(found), problem, search.threshold, quiet, complete, first)


class _FormulaSearch:
    """The state of a search: the score by chance, drawn once."""

    def __init__(self, problem: ScoringProblem, seed: int, threshold_of: ThresholdOf | None) -> None:
        self._seed = seed
        self._threshold_of = threshold_of or self._drawn
        self._levels = _levels_of(problem)
        self._threshold: float | None = None
        self._last_top = np.inf

    @property
    def threshold(self) -> float:
        """The score by chance."""
        return np.inf if self._threshold is None else self._threshold

    def is_exhausted(self, terms: int) -> bool:
        """Whether no further term comes near the threshold: the grammar follows a little of what it cannot express."""
        return terms < MAX_TERMS and self._last_top < self.threshold - NEARLY_NATS

    def _drawn(self, problem: ScoringProblem, fitted: FittedFloor, scans: Sequence[Scan]) -> float:
        return chance.threshold(problem, fitted, scans, self._seed)

    def best(self, problem: ScoringProblem, name: str) -> FoundTerm | None:
        """The best term on what a problem leaves; None where chance does as well."""
        fitted, units = problem.fit(), scanned_units(problem, MOST_SCANNED_UNITS)
        scans = [scan_of(x, problem.view, units, fitted.floor) for x in libraries(problem.view, units.visits)]
        scans = [scan for scan in scans if scan.batches]
        if not scans or any(s.space.dof < LEAST_NUMBERS or s.space.rest <= 0 for s in scans):
            return None
        if self._threshold is None:
            self._threshold = self._threshold_of(problem, fitted, scans)
        top, choices = _best_choices(scans)
        self._last_top = top
        # Chance was drawn for the grid, whose best is therefore what must beat it; refined, it is better still.
        if top < self.threshold - GROUP_NATS:
            return None
        return self._ranked(problem, fitted.floor, [c.term for c in choices], name, top)

    def _ranked(
        self, problem: ScoringProblem, floor: NoiseFloor, terms: Sequence[Term], name: str, top: float
    ) -> FoundTerm | None:
        """The best of some terms with their constants refined, judged under the floor that fits best with it. top: the
        best of the grid."""
        # Of a fleet some units show which families are worth a fit to all.
        few = TermSpaces(problem, floor, MOST_SCANNED_UNITS)
        fits = [refine(t, few.of(t)) for t in terms]
        fits += [fit_term(t, few.of(t)) for t in _group_terms(problem)]
        fits = _by_score(fits)
        if not fits or fits[0].score < self.threshold - SET_NATS:
            return None
        if fits[0].term.of in GROUP_LEVELS:
            # The scan has terms of units and of all alone: what its groups share they may share of any other term.
            fits = _by_score([with_levels(f, few.of(f.term), (fits[0].term.of,)) for f in fits])
        leader = fits[0]
        with_it = problem.with_accepted((*problem.accepted, accepted(leader, problem.view, name))).fit(floor).floor
        spaces, fairer = TermSpaces(problem, floor), TermSpaces(problem, with_it)
        close = [f for f in fits if f.odds > leader.odds - REFINED_NATS or f.evidence > leader.evidence - SET_NATS]
        again = [with_levels(refine(f.term, fairer.of(f.term)), fairer.of(f.term), self._levels) for f in close]
        again.sort(key=lambda f: -f.odds)
        best = simplest(again, problem.view.scene)
        score = best.score + fairer.of(best.term).space.profile - spaces.of(best.term).space.profile
        if score < self.threshold or (top < self.threshold and score < self.threshold + GROUP_NATS):
            return None
        near = other_families(unparted(again, best, fairer), best, problem.view.scene)
        return FoundTerm(name, best, score, near)

    def merged(
        self, problem: ScoringProblem, found: list[FoundTerm], first: int
    ) -> tuple[ScoringProblem, list[FoundTerm]]:
        """The terms with the last one written into an earlier one, if both are better as one."""
        last = found[-1]
        for i, earlier in enumerate(found[:-1]):
            pair = TermPair(problem, first + i, first + len(found) - 1, earlier.spellings, last.spellings)
            if (one := pair.as_one(self._levels)) is not None:
                better = FoundTerm(earlier.name, one, pair.score(one), pair.rivals(one, self._levels))
                rest = [better if at == i else term for at, term in enumerate(found[:-1])]
                return _with_term(pair.bare, better, first + i), rest
        return problem, found

    def fitted_back(
        self, problem: ScoringProblem, found: list[FoundTerm], first: int
    ) -> tuple[ScoringProblem, list[FoundTerm]]:
        """The earlier terms, each searched again beside all others."""
        for i in range(len(found) - 1):
            bare = problem.without(first + i)
            better = self.best(bare, found[i].name)
            if better is None:
                continue
            problem, found[i] = _with_term(bare, better, first + i), better
        return problem, found


def _by_score(fits: Sequence[TermFit]) -> list[TermFit]:
    """The best, as many as are refined at most."""
    return sorted(fits, key=lambda f: -f.score)[:MOST_REFINED]


def _best_choices(scans: Sequence[Scan]) -> tuple[float, list[Choice]]:
    """The best score of all, and the best choice of each family, as far as they are near it."""
    best: dict[tuple[str, str], tuple[float, Choice]] = {}
    for scan in scans:
        for batch, values in scan.scores(scan.space.residual[..., None]):
            for at in np.argsort(-values[:, 0])[: 4 * MOST_REFINED]:
                choice, value = batch.choices[at], float(values[at, 0])
                key = choice.product.input.factor.name, choice.product.modulator.factor.name
                if key not in best or value > best[key][0]:
                    best[key] = (value, choice)
    ranked = sorted(best.values(), key=lambda pair: -pair[0])
    top = ranked[0][0] if ranked else -np.inf
    least = top - max(REFINED_NATS, GRID_SHARE * top)
    return top, [c for value, c in ranked if value > least][:MOST_REFINED]


def _levels_of(problem: ScoringProblem) -> tuple[str, ...]:
    """Levels at which a coefficient of its own may stand, that differ in these data; no two group alike."""
    return tuple(_distinct_levels(problem, ("unit", "common", "nest", "station", "lot", "operator")))


def _distinct_levels(problem: ScoringProblem, levels: Sequence[str]) -> Iterator[str]:
    taken: set[bytes] = set()
    for of in levels:
        key = problem.view.scene.group(of)[0].tobytes()
        if key not in taken:
            taken.add(key)
            yield of


def _group_terms(problem: ScoringProblem) -> Iterator[Term]:
    """Terms that groups of the rig may have: an offset or a gain of each, and turns of its parts. Groups seen less than
    twice each have as many numbers as there are readings of them, so no evidence can support them."""
    levels = [of for of in _distinct_levels(problem, ("common", "unit", *GROUP_LEVELS)) if of in GROUP_LEVELS]
    wanted = [("one", of) for of in levels] + [("own", of) for of in levels if of != "position"]
    if problem.view.grid.k == 3:
        wanted += [("turn-station", "common"), *(("turn-nest", of) for of in ("common", "nest", "position"))]
        wanted += [("turn-device", of) for of in ("unit", "common")]
    scene, visits = problem.view.scene, len(problem.view.reduced.mean)
    for name, of in wanted:
        if of in GROUP_LEVELS and 2 * len(scene.group(of)[1]) > visits:
            continue
        axes = tuple(c.label for c in columns_of(INPUTS[name], MODULATORS["constant"]))
        yield Term(name, "constant", axes, of)


def _with_term(problem: ScoringProblem, found: FoundTerm, place: int | None = None) -> ScoringProblem:
    """The problem with a term accepted, last or at a place, and everything known at its best."""
    items = list(problem.accepted)
    items.insert(len(items) if place is None else place, accepted(found.fit, problem.view, found.name))
    return refined(problem.with_accepted(items), rounds=2)


def is_series(terms: Sequence[Term]) -> bool:
    """Whether several terms act on one axis. They are then more likely the beginning of a series for one law outside
    the grammar, such as waves for a chirp, than several separate laws."""
    axes = [axis for term in terms for axis in {c.i for c in term.columns}]
    return len(set(axes)) < len(axes)
