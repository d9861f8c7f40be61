"""The next run for a diagnosis that ended in a tie."""

from typing import Any

import numpy as np

from station.diagnosis.diagnose import Diagnosis
from station.diagnosis.plan import Proposal, propose
from station.errors import RecipeError

#: Units that a plan needs at most to know what more units would show.
UNITS = 6
#: Pairs that no order, temperature, seat or nest can part, and what would.
REMEDIES = {
    frozenset({"settling", "filter-lag"}): "another output data rate: ringing of the rig keeps its frequency in Hz",
    frozenset({"quadratic", "asymmetry"}): "tilts between the faces, or more than 1 g on a centrifuge",
    frozenset({"base-tilt", "index-error"}): "a level on the rig: an error of every position can look like its tilt",
    frozenset({"nest-tilt", "index-error"}): "the same positions in another nest",
}


def next_run(d: Diagnosis) -> tuple[dict[str, Any] | None, Proposal | None]:
    """What to measure next, as the document says it, and the recipe; nothing where nothing is tied."""
    ties = {c.finding.name: c.finding.alike for c in d.causes if c.finding.alike}
    if not ties or not d.recipe.pose_known:
        return None, None
    sizes = {
        c.finding.name: float(np.sqrt(np.mean(c.estimate.value[c.estimate.item.hit] ** 2)))
        for c in d.causes
        if c.finding.alike and c.estimate is not None
    }
    ties = {name: others for name, others in ties.items() if name in sizes}
    members = [*ties, *(other for others in ties.values() for other in others)]
    try:
        found = propose(d.recipe, min(len(d.table.unit.names), UNITS), ties, sizes) if ties else None
    except RecipeError:
        found = None
    if found is None:
        told = [text for pair, text in REMEDIES.items() if pair <= set(members)]
        change = told[0] if told else "no run of the menu separates them"
        return {"recipe_change": change, "separates": [], "minutes": 0.0, "certainty": 0.5}, None
    return {
        "recipe_change": found.change,
        "separates": list(found.separates),
        "minutes": round(found.minutes, 1),
        "certainty": found.certainty,
    }, found
