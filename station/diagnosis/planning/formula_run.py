"""The next run where formulas are tied: the one on which those that fit these data alike differ most."""

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from station.diagnosis.discovery.term_fit import TermFit, candidate_of
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.planning.measured import measured_campaign
from station.diagnosis.planning.plan import PlannedCampaign, PlannedRuns, plan_runs
from station.diagnosis.planning.proposal import (
    SUFFICIENT_CERTAINTY,
    CausePair,
    MeasuredCampaign,
    Proposal,
    best_proposal,
    minutes_of,
    run_menu,
)
from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.search.distinguishability import distinct_share
from station.model.formula.text import formula_text

#: Rivals of one term that a run is planned against.
MOST_RIVALS = 4


def next_formula_run(d: Diagnosis) -> Proposal | None:
    """The best next run for the formulas of a diagnosis; None where none are tied, or nothing of the menu helps."""
    h = d.hypotheses
    if h is None or not d.recipe.pose_known:
        return None
    ties = [(t.found.fit, *t.found.equivalent[:MOST_RIVALS]) for t in h.terms if t.found.equivalent]
    if not ties:
        return None
    campaign, now = measured_campaign(d), PlannedRuns.measured(d.recipe)
    found = best_proposal(list(_rated(campaign, now, ties, h.floor.floor)))
    return found if found is not None and found.separates else None


def _rated(
    campaign: MeasuredCampaign, now: PlannedRuns, ties: list[tuple[TermFit, ...]], floor: NoiseFloor
) -> Iterator[Proposal]:
    """Each run of the menu, the shortest first, up to the first that is certain enough."""
    names = tuple(tuple(formula_text(f.term) for f in tie) for tie in ties)
    for text, longer in sorted(run_menu(campaign, now), key=lambda choice: round(minutes_of(choice[1]))):
        plan = PlannedCampaign.of(plan_runs(longer, campaign.units, campaign.line).problem, floor)
        apart: dict[CausePair, float] = {}
        for tie in ties:
            apart |= _separations(plan, tie)
        found = Proposal(longer, text, minutes_of(longer), apart, names)
        yield found
        if found.certainty >= SUFFICIENT_CERTAINTY:
            return


def _separations(plan: PlannedCampaign, tie: tuple[TermFit, ...]) -> dict[CausePair, float]:
    """d·√κ of each pair, whichever of the two it is: rivals as large as they would have to be to look like this."""
    axes = [plan.axes(candidate_of(f.term, plan.problem.view, f.rms)) for f in tie]
    apart: dict[CausePair, float] = {}
    for one, two in permutations(range(len(tie)), 2):
        d = tie[one].rms * axes[one].length
        names = formula_text(tie[one].term), formula_text(tie[two].term)
        pair = min(names), max(names)
        share = distinct_share(axes[one], axes[two])
        apart[pair] = min(d * float(np.sqrt(share)), apart.get(pair, np.inf))
    return apart
