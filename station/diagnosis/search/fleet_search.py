"""Causes of a fleet, found in a sample of its units and confirmed in all of them.

What forty units show clearly, four hundred show as clearly: only its sizes need them all. The sample holds units spread
over the fleet and those whose readings scatter unlike all others'. What is found in it holds for the fleet where it is
certain: causes of the library, told from all others but those that all units cannot tell from them either, beside which
the sample has nothing left. In all units they are fitted anew, and nothing may be left there: no unit stands out, no
part of the floor is beyond its bound, and no cause of the library, in the shape that it fits the sample best with at
each level, explains anything. Otherwise the fleet is searched as a whole, as it is where its sample shows nothing.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import Candidate, build_bank, candidates_of_shape
from station.diagnosis.candidates.kernels import disturbed_readings
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.data.visit_noise import MAD_PER_SIGMA
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.cause_search import (
    SearchResult,
    search_causes,
    search_unchecked,
    with_forms_checked,
)
from station.diagnosis.search.distinguishability import SEPARATION_95, estimate_signal, separations
from station.diagnosis.search.finding import CauseFinding, accepted_at_best
from station.diagnosis.search.problem import refined
from station.diagnosis.search.rank import RankedCause, variance_surprise
from station.diagnosis.search.scoring import ScoringProblem, evidence_by_cause, score_bank
from station.diagnosis.search.search_state import LawFactory, NullFactory
from station.diagnosis.search.unit_sample import FLOOR_UNITS, LEAST_SHARE, SURE_ERRORS, spread_units
from station.model.effect import Effect

#: Units that are added to a sample, at the most, because they stand out.
MOST_ODD_UNITS = 8
#: A cause that a sample makes so probable needs no more units.
CERTAIN = 0.99
#: What a cause may explain in all units beside those found, nats: chance reaches e^this once in as many causes.
LEFT_NATS = 4.0


def search_by_sample(problem: ScoringProblem, null_of: NullFactory, law_of: LawFactory | None = None) -> SearchResult:
    """Everything that can be found (see `search_causes`), of a fleet by a sample where that is enough."""
    units = problem.view.grid.units
    if units >= LEAST_SHARE * FLOOR_UNITS and not problem.accepted:
        fitted = problem.fit()
        chosen = np.union1d(spread_units(units, FLOOR_UNITS), standing_out(fitted.space)[:MOST_ODD_UNITS])
        found = search_unchecked(problem.of_units(chosen, fitted.floor), null_of, law_of)
        if (whole := _in_all_units(problem, found)) is not None:
            return with_forms_checked(whole)
    return search_causes(problem, null_of, law_of)


def standing_out(space: ResidualSpace) -> NDArray[np.intp]:
    """Units whose squares, without anything known, are beyond those of the others by more than chance, the largest
    first."""
    rows = np.maximum(space.live.sum(1), 1)
    squares = np.sum(space.residual**2, axis=1) / rows
    usual = float(np.median(squares))
    scatter = float(np.median(np.abs(squares - usual))) / MAD_PER_SIGMA
    beyond = (squares - usual) / np.maximum(scatter, usual * np.sqrt(2 / rows))
    return np.argsort(-beyond)[: np.count_nonzero(beyond > SURE_ERRORS)]


def _in_all_units(problem: ScoringProblem, found: SearchResult) -> SearchResult | None:
    """What a sample shows as all units have it; None where it is not certain, or they show more."""
    if not _is_certain(found):
        return None
    last, findings = problem, list[CauseFinding]()
    for finding in found.findings:
        item, floor = _accepted_by_all(last, finding)
        d = None if item is None else _strength(last, item, finding, floor)
        if item is None or d is None:
            return None
        last = refined(replace(last, near=floor).with_accepted((*last.accepted, item)))
        findings.append(replace(finding, accepted=last.accepted[-1], d=d))
    if _shows_more(last, found):
        return None
    share = problem.view.grid.units / found.first.view.grid.units
    return replace(found, first=problem, last=last, findings=tuple(findings), share=share)


def _is_certain(found: SearchResult) -> bool:
    """Whether a search has found causes alone, each for certain, and nothing is left beside them."""
    left = found.words or found.statistics[-1] > found.threshold
    return bool(found.findings) and not left and all(_is_sure(finding) for finding in found.findings)


def _is_sure(finding: CauseFinding) -> bool:
    """Whether a finding is one cause in groups that are known, or in visits that it alone explains, told from all
    others but those alike."""
    cause = None if finding.accepted is None else finding.accepted.candidate
    known = cause is not None and (cause.scans_visits if cause.effect is None else cause.pattern != "scan")
    return known and cause is not None and not cause.own and finding.set_probability >= CERTAIN


def _of_all(of_sample: Candidate, problem: ScoringProblem) -> Candidate | None:
    """A candidate of a sample as all units have it; None where they have no such groups."""
    view, shape = problem.view, of_sample.effect
    found = disturbed_readings(view) if shape is None else candidates_of_shape(shape, view)
    return next((c for c in found if (c.name, *_level(c)) == (of_sample.name, *_level(of_sample))), None)


def _accepted_by_all(problem: ScoringProblem, finding: CauseFinding) -> tuple[AcceptedCause | None, NoiseFloor]:
    """A cause of a sample with the amplitude that all units show, in the groups that it hits there, and the floor with
    it; none where they have no such groups."""
    assert finding.accepted is not None
    best = _of_all(finding.accepted.candidate, problem)
    if best is None:
        return None, finding.floor
    at = score_bank(problem, [build_bank([best], problem.view.layout, moving=best.moving)], finding.floor)
    return accepted_at_best(problem, RankedCause(best.name, 0.0, best, at))


def _strength(problem: ScoringProblem, item: AcceptedCause, finding: CauseFinding, floor: NoiseFloor) -> float | None:
    """How strong a cause is in all units under a floor; None where all units may tell it from one that the sample could
    not."""
    alike = [_of_all(c, problem) for c in finding.alike if c.pattern != "scan"]
    others = [(c, np.ones(len(c.names))) for c in alike if c is not None]
    if len(others) < len(finding.indistinguishable_from):
        return None
    layout, moving = problem.view.layout, any(c.moving for c in (item.candidate, *(c for c, _ in others)))
    space = problem.space(floor, moving=moving)
    found = estimate_signal(item.candidate, layout, space, item.hit.astype(float))
    apart = separations(found, others, layout, space)
    return None if any(x >= SEPARATION_95 for x in apart.values()) else found.d


def _level(candidate: Candidate) -> tuple[str, str]:
    return candidate.of, candidate.pattern


def _shows_more(problem: ScoringProblem, found: SearchResult) -> bool:
    """Whether all units show anything beside what is known of them."""
    fitted = problem.fit()
    grown = problem.grown_floors.values()
    if any(variance_surprise(each.gain, fitted.space.dof) > found.threshold for each in grown):
        return True
    if standing_out(fitted.space).size:
        return True
    items = [
        c
        for shape, levels in _best_shapes(found).items()
        for c in candidates_of_shape(shape, problem.view)
        if _level(c) in levels
    ]
    items += disturbed_readings(problem.view)
    banks = [build_bank(items, problem.view.layout, moving=moving) for moving in sorted({c.moving for c in items})]
    scored = score_bank(problem, banks, fitted.floor)
    evidence = evidence_by_cause(scored.candidates, scored.readings().evidence)
    return any(float(nats[0]) > LEFT_NATS for nats in evidence.values())


def _best_shapes(found: SearchResult) -> dict[Effect, set[tuple[str, str]]]:
    """Shapes of the library's causes that fit a sample best, with all found in it known, with the levels at which they
    do; of what hits few groups, which may hit none of the sample, every shape."""
    best, rare = dict[tuple[str, str, str], tuple[float, Effect]](), list[Candidate]()
    for c, nats in zip(found.stage.candidates, found.stage.readings().evidence[0].tolist(), strict=True):
        if c.effect is None:
            continue
        if c.pattern == "scan":
            rare.append(c)
        elif nats > best.get((c.name, *_level(c)), (-np.inf, c.effect))[0]:
            best[c.name, *_level(c)] = nats, c.effect
    shapes: dict[Effect, set[tuple[str, str]]] = {}
    for (_, of, pattern), (_, effect) in best.items():
        shapes.setdefault(effect, set()).add((of, pattern))
    for c in rare:
        assert c.effect is not None
        shapes.setdefault(c.effect, set()).add(_level(c))
    return shapes
