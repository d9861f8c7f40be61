"""The next run for a diagnosis that ended in a tie."""

from typing import Any

import numpy as np

from station.diagnosis.planning.proposal import CauseHypothesis, CauseTie, MeasuredCampaign, Proposal, propose
from station.diagnosis.results.diagnose import Cause, Diagnosis
from station.errors import RecipeError

#: Units that a plan needs at most to know what more units would show.
MAX_PLANNED_UNITS = 6
#: Pairs that no order, temperature, seat or nest can part, and what would.
TIE_BREAKERS = {
    frozenset({"settling", "filter-lag"}): "another output data rate: ringing of the rig keeps its frequency in Hz",
    frozenset({"quadratic", "asymmetry"}): "tilts between the faces, or more than 1 g on a centrifuge",
    frozenset({"base-tilt", "index-error"}): "a level on the rig: an error of every position can look like its tilt",
    frozenset({"nest-tilt", "index-error"}): "the same positions in another nest",
}


def next_run(d: Diagnosis) -> tuple[dict[str, Any] | None, Proposal | None]:
    """What to measure next, as the document says it, and the recipe; nothing where nothing is tied."""
    tied = [c for c in d.causes if c.finding.indistinguishable_from]
    if not tied or not d.recipe.pose_known:
        return None, None
    ties = [t for c in tied if (t := _tie(c)) is not None]
    try:
        found = propose(_campaign(d), ties) if ties else None
    except RecipeError:
        found = None
    if found is None:
        members = {name for c in tied for name in (c.finding.name, *c.finding.indistinguishable_from)}
        told = [text for pair, text in TIE_BREAKERS.items() if pair <= members]
        change = told[0] if told else "no run of the menu separates them"
        return {"recipe_change": change, "separates": [], "minutes": 0.0, "certainty": 0.5}, None
    return {
        "recipe_change": found.change,
        "separates": list(found.separates),
        "minutes": round(found.minutes, 1),
        "certainty": found.certainty,
    }, found


def _tie(c: Cause) -> CauseTie | None:
    """A cause with those it is tied with; None of a variance of the floor."""
    if c.estimate is None or c.estimate.item.candidate.effect is None:
        return None
    size = float(np.sqrt(np.mean(c.estimate.value[c.estimate.item.hit] ** 2)))
    found = CauseHypothesis(c.estimate.item.candidate.effect, c.estimate.item.candidate.of, size)
    return CauseTie(found, c.finding.indistinguishable_from)


def _campaign(d: Diagnosis) -> MeasuredCampaign:
    """What was measured, as a plan sees it."""
    visits = d.last.view.scene.visits
    nests = len(visits.group("nest", 1)[1]) if "nest" in visits.groups else 1
    return MeasuredCampaign(d.recipe, min(len(d.table.unit.names), MAX_PLANNED_UNITS), nests, d.floor.floor)
