"""The next run for a diagnosis that ended in a tie."""

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from station import plugins
from station.diagnosis.planning.measured import measured_campaign
from station.diagnosis.planning.proposal import CauseHypothesis, CauseTie, Proposal, propose
from station.diagnosis.results.diagnose import Cause, Diagnosis
from station.errors import RecipeError
from station.model.effect import Effect
from station.model.model_file import EFFECTS

#: Where nothing parts what is tied: the faces have a sentence for it in their language.
NO_RUN = ""


def next_run(d: Diagnosis) -> tuple[dict[str, Any] | None, Proposal | None]:
    """What to measure next, as the document says it, and the recipe; nothing where nothing is tied."""
    tied = [c for c in d.causes if c.finding.indistinguishable_from]
    if not tied and d.hypotheses is not None:
        return _formula_run(d)
    if not tied or not d.recipe.pose_known:
        return None, None
    ties = ties_of(d)
    try:
        found = propose(measured_campaign(d), ties) if ties else None
    except RecipeError:
        found = None
    if found is None:
        members = {name for c in tied for name in (c.finding.name, *c.finding.indistinguishable_from)}
        return _without_run(next(_tie_breakers(members), NO_RUN)), None
    return _document(found), found


def ties_of(d: Diagnosis) -> list[CauseTie]:
    """The causes that are tied with others, as a plan sees them."""
    return [t for c in d.causes if c.finding.indistinguishable_from and (t := _tie(c)) is not None]


def _formula_run(d: Diagnosis) -> tuple[dict[str, Any] | None, Proposal | None]:
    """What to measure next to part the formulas that were proposed."""
    # Formulas are planned for only where there are any.
    from station.diagnosis.planning.formula_run import next_formula_run, tied_formulas

    if not (ties := tied_formulas(d)):
        return None, None
    found = next_formula_run(d, ties)
    return (_without_run(NO_RUN), None) if found is None else (_document(found), found)


def _without_run(change: str) -> dict[str, Any]:
    """What would help where no run does."""
    return {"recipe_change": change, "separates": [], "minutes": 0.0, "certainty": 0.0}


def _document(found: Proposal) -> dict[str, Any]:
    return {
        "recipe_change": found.change,
        "separates": list(found.separates),
        "minutes": round(found.minutes, 1),
        "leaves": list(found.leaves),
        "certainty": found.certainty,
    }


def _tie_breakers(members: Collection[str]) -> Iterator[str]:
    """What would tell two of these causes apart though no run does, as their files say."""
    for name in sorted(members):
        kind: type[Effect] = plugins.load(EFFECTS, name)
        yield from (text for other, text in kind.separated_by if other in members)


def _tie(c: Cause) -> CauseTie | None:
    """A cause with those it is tied with; None of a variance of the floor."""
    if c.estimate is None or c.estimate.item.candidate.effect is None:
        return None
    size = float(np.sqrt(np.mean(c.estimate.value[c.estimate.item.hit] ** 2)))
    found = CauseHypothesis(c.estimate.item.candidate.effect, c.estimate.item.candidate.of, size)
    return CauseTie(found, c.finding.indistinguishable_from, c.finding.d, c.finding.probability)
