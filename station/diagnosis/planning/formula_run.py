"""The next run where formulas are tied: the one on which those that fit these data alike differ most."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np

from station.diagnosis.discovery.term_fit import ROUNDS, TermFit, candidate_of, search_constant
from station.diagnosis.planning.measured import MeasuredCampaign, measured_campaign
from station.diagnosis.planning.plan import PlannedCampaign, PlannedRuns
from station.diagnosis.planning.promise import Promise, TiedCauses, TrueAndOther
from station.diagnosis.planning.proposal import (
    SUFFICIENT_CERTAINTY,
    Proposal,
    best_proposal,
)
from station.diagnosis.planning.run_menu import minutes_of, run_menu
from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.search.distinguishability import SignatureAxes, distinct_share
from station.domain.recipe.blocks import Run
from station.model.formula.term import Term
from station.model.formula.text import formula_text

#: Rivals of one term that a run is planned against.
MOST_RIVALS = 4
#: How far beyond the temperatures so far a run may go.
STEP_DEGC = 10.0


def tied_formulas(d: Diagnosis) -> list[tuple[TermFit, ...]]:
    """Of each term the fits that these data cannot tell apart, the one proposed first; none where no run is planned."""
    if d.hypotheses is None or not d.recipe.pose_known:
        return []
    return [(t.found.fit, *t.found.equivalent[:MOST_RIVALS]) for t in d.hypotheses.terms if t.found.equivalent]


def next_formula_run(d: Diagnosis, ties: list[tuple[TermFit, ...]]) -> Proposal | None:
    """The best next run for the tied formulas of a diagnosis; None where nothing of the menu helps."""
    assert d.hypotheses is not None
    campaign, now = measured_campaign(d), PlannedRuns.measured(d.recipe)
    found = best_proposal(list(_rated(replace(campaign, floor=d.hypotheses.floor.floor), now, ties)))
    return found if found is not None and found.separates else None


def _rated(campaign: MeasuredCampaign, now: PlannedRuns, ties: list[tuple[TermFit, ...]]) -> Iterator[Proposal]:
    """Each run of the menu, the shortest first, up to the first that is certain enough."""
    tied = tuple(TiedCauses.of([formula_text(f.term) for f in tie], np.inf, {}) for tie in ties)
    menu = [*run_menu(campaign, now), *_wider_temperatures(now, ties)]
    for text, longer in sorted(menu, key=lambda choice: round(minutes_of(choice[1]))):
        plan = campaign.gone_on(longer)
        apart: dict[TrueAndOther, float] = {}
        for tie in ties:
            apart |= _separations(plan, tie)
        found = Proposal(longer, text, minutes_of(longer), Promise(tied, apart))
        yield found
        if found.certainty >= SUFFICIENT_CERTAINTY:
            return


def _wider_temperatures(now: PlannedRuns, ties: list[tuple[TermFit, ...]]) -> Iterator[tuple[str, PlannedRuns]]:
    """A run beyond the temperatures so far, where formulas that know one are tied: there their curves part."""
    if not any(name.startswith("temperature") for tie in ties for f in tie for name in f.term.needs):
        return
    offsets = [run.temperature_offset_degC for run in now.recipe.runs]
    warmer, colder = max(offsets) + STEP_DEGC, min(offsets) - STEP_DEGC
    for text, offset in ((f"{warmer:g} °C warmer", warmer), (f"{-colder:g} °C colder", colder)):
        yield f"one run {text}", now.followed_by(Run(temperature_offset_degC=offset), {}, now.dwells[-1])


def _separations(plan: PlannedCampaign, tie: tuple[TermFit, ...]) -> dict[TrueAndOther, float]:
    """d·√κ of each, were it the true one, against each other."""
    apart: dict[TrueAndOther, float] = {}
    for one, two in permutations(tie, 2):
        found = plan.axes(candidate_of(one.term, plan.problem.view, one.rms))
        names = formula_text(one.term), formula_text(two.term)
        apart[names] = one.rms * found.length * float(np.sqrt(share_beyond(plan, found, two.term)))
    return apart


def share_beyond(plan: PlannedCampaign, found: SignatureAxes, rival: Term) -> float:
    """κ: which share of a law a rival cannot follow, its constants what they would have to be in the longer campaign:
    the next diagnosis looks for them anew."""
    view = plan.problem.view

    def followed(term: Term) -> float:
        return 1 - distinct_share(found, plan.axes(candidate_of(term, view)))

    for _ in range(ROUNDS if len(rival.fields) > 1 else 1):
        for field in rival.fields:
            rival = search_constant(rival, field, view, followed).term
    return 1 - followed(rival)
