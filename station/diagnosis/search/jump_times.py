"""A jump at a time of its own in each run.

What jumps in several runs need not do so at the same time. The bank looks for the runs that have jumped at one time;
here each run is given the time at which its own jump is the likeliest, the clearest run of each unit first: what it
explains is then known when the others are looked at.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates import visit_gaps
from station.diagnosis.candidates.bank import Candidate, build_bank, candidate_in_view, candidate_jump_times
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.projected_bank import project_bank
from station.diagnosis.candidates.shape import with_form_value
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.several_hits import HARD_NATS
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem
from station.domain.core.types import Floats

#: Looks at the runs, each beside the jumps found by the looks before.
MAX_PASSES = 8
#: Runs whose times are refined at most.
MAX_REFINED_RUNS = 24


def fit_jump_times(
    problem: ScoringProblem, rough: AcceptedCause, floor: NoiseFloor
) -> tuple[Candidate, NDArray[np.bool_]]:
    """The candidate of an accepted jump with the time of each run, and which runs (groups) have jumped."""
    view, one = problem.view, rough.candidate
    scanned = [one, *(with_form_value(one, "at_s", at, view) for at in candidate_jump_times(view))]
    chosen = np.zeros(len(one.names), int)
    hit = np.zeros(len(one.names), bool)
    for _ in range(MAX_PASSES):
        known = replace(rough, candidate=_combined(scanned, chosen, problem), hit=hit)
        with_jumps = problem.with_accepted((*problem.accepted, known) if hit.any() else problem.accepted)
        odds = _odds(scanned, with_jumps, with_jumps.fit(floor).floor)
        # Any of so many times, in any of so many runs.
        fresh = ~hit & (odds.max(0) > np.log(odds.size))
        if not fresh.any():
            break
        # A jump moves the unit's offset, which makes its other runs look as if they had jumped too.
        fresh &= odds.max(0) == _max_of_unit(np.where(fresh, odds.max(0), -np.inf), one.where(view.layout)[0])
        chosen, hit = np.where(fresh, odds.argmax(0), chosen), hit | fresh
    if not hit.any():
        return one, rough.hit
    # Times of runs that have not jumped say nothing: one that is there anyway.
    refined = _refined(scanned, chosen, hit, problem, floor)
    return _combined(refined, np.where(hit, chosen, chosen[hit][0]), problem), hit


def at_own_times(problem: ScoringProblem, one: Candidate, at: ScoredBank) -> tuple[Candidate, float] | None:
    """A jump of some runs with the time of each, and what it costs to choose those, in nats; None where no two units
    have jumped clearly at different times, as at one time of all."""
    if one.pattern != "scan" or one.of != "run" or one.own or problem.view.grid.units < 2:
        return None
    scanned = [one, *(with_form_value(one, "at_s", time, problem.view) for time in candidate_jump_times(problem.view))]
    odds = _odds(scanned, problem, at.floor)
    clear = odds.max(0) > HARD_NATS
    if np.all(odds[0, clear] > odds.max(0)[clear] - HARD_NATS):
        return None
    found, hit = fit_jump_times(problem, at.accept(one, problem.view), at.floor)
    return (found, float(np.count_nonzero(hit) - 1) * float(np.log(len(scanned)))) if found.own else None


def _max_of_unit(values: Floats, unit: NDArray[np.intp]) -> Floats:
    """Of each run (groups) the largest value of its unit's runs."""
    most = np.full(int(unit.max()) + 1, -np.inf)
    np.maximum.at(most, unit, values)
    return np.asarray(most[unit])


def _odds(scanned: Sequence[Candidate], problem: ScoringProblem, floor: NoiseFloor) -> Floats:
    """Log odds (candidates, runs) that a run has jumped at each time."""
    view = problem.view
    projected = project_bank(
        build_bank(scanned, view.layout, moving=False), view.layout, [problem.space(floor, moving=False)]
    )[0]
    where = scanned[0].where(view.layout)
    return np.stack([log_mean_exp(projected.likelihood(found))[where] for found in projected.found])


def _refined(
    scanned: list[Candidate],
    chosen: NDArray[np.intp],
    hit: NDArray[np.bool_],
    problem: ScoringProblem,
    floor: NoiseFloor,
) -> list[Candidate]:
    """The candidates with those of the runs' own times; `chosen` then counts among these."""
    view, one = problem.view, scanned[0]
    for g in np.flatnonzero(hit) if np.count_nonzero(hit) <= MAX_REFINED_RUNS else ():
        middle = visit_gaps.middles(view, one.code == g)
        now: float = scanned[chosen[g]].effect.at_s
        near = middle[np.argsort(np.abs(middle - now))[:4]]
        more = [scanned[chosen[g]], *(with_form_value(one, "at_s", float(at), view) for at in near)]
        best = int(_odds(more, problem, floor)[:, g].argmax())
        scanned, chosen[g] = [*scanned, more[best]], len(scanned)
    return scanned


def _combined(scanned: Sequence[Candidate], chosen: NDArray[np.intp], problem: ScoringProblem) -> Candidate:
    """One candidate whose runs have the shapes chosen."""
    if np.all(chosen == chosen[0]):
        return scanned[int(chosen[0])]
    own = tuple(e for i in chosen if (e := scanned[i].effect) is not None)
    return candidate_in_view(replace(scanned[0], own=own), problem.view)
