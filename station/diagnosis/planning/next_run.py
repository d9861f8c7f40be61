"""The next run for a diagnosis that ended in a tie."""

from typing import Any

import numpy as np

from station.diagnosis.candidates.bank import FLOOR_CAUSES, cause_library
from station.diagnosis.planning.measured import measured_campaign
from station.diagnosis.planning.proposal import Proposal, propose
from station.diagnosis.planning.suspects import CauseHypothesis, CauseTie
from station.diagnosis.results.diagnose import Cause, Diagnosis
from station.diagnosis.search.distinguishability import estimate_signal
from station.diagnosis.search.scoring import score_bank
from station.errors import RecipeError
from station.model.tie_breakers import tie_breakers

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
        return _without_run(next(tie_breakers(members), NO_RUN)), None
    return _document(found), found


def ties_of(d: Diagnosis) -> list[CauseTie]:
    """The causes that are tied with others, as a plan sees them."""
    return [t for c in d.causes if c.finding.indistinguishable_from and (t := _tie(d, c)) is not None]


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
    return {"recipe_change": change, "separates": [], "minutes": 0.0, "certainty": 0.0, "certainty_interval": None}


def _document(found: Proposal) -> dict[str, Any]:
    chance = found.chance
    return {
        "recipe_change": found.change,
        "separates": list(found.separates),
        "minutes": round(found.minutes, 1),
        "leaves": list(found.leaves),
        "certainty": found.certainty,
        "certainty_interval": None if chance is None else list(chance.interval),
        "simulated_diagnoses": 0 if chance is None else chance.sets,
    }


def _tie(d: Diagnosis, c: Cause) -> CauseTie | None:
    """A cause with those it is tied with; of a variance of the floor these alone, None where they are one or none."""
    if c.estimate is None:
        return _tie_beside_scatter(d, c)
    candidate = c.estimate.item.candidate
    # A visit that may read anything has the name of a cause, but not its form.
    library = (e for e in cause_library(d.recipe) if e.id == candidate.name)
    effect = candidate.effect or next(library, None)
    if effect is None:
        return None
    size = float(np.sqrt(np.mean(c.estimate.value[c.estimate.item.hit] ** 2)))
    found = CauseHypothesis(effect, candidate.of, size, free=candidate.effect is None)
    return CauseTie(found, c.finding.indistinguishable_from, c.finding.d, c.finding.probability)


def _tie_beside_scatter(d: Diagnosis, c: Cause) -> CauseTie | None:
    """Those that scatter is tied with, the likeliest first, as strong as they are where nothing scatters beyond what is
    healthy. Scatter has no course that a run could be planned for; a run that parts the others parts them from it."""
    problem, names = d.search_result.first, set(c.finding.indistinguishable_from) - set(FLOOR_CAUSES)
    likely = sorted(names, key=lambda name: (-c.finding.probability.get(name, 0.0), name))
    if len(likely) < 2:
        return None
    floor = problem.fit().floor
    now = score_bank(problem, d.search_result.banks.of(problem.view, d.search_result.undetectable), floor)
    evidence = zip(now.candidates, now.readings().evidence[0], strict=True)
    each = [(value, best) for best, value in evidence if best.name == likely[0] and best.effect is not None]
    if not each:
        return None
    best = max(each, key=lambda pair: pair[0])[1]
    hit = now.hit(best, problem.view).astype(float)
    found = estimate_signal(best, problem.view.layout, problem.space(floor, moving=best.moving), hit)
    assert best.effect is not None
    return CauseTie(CauseHypothesis(best.effect, best.of, 1.0), tuple(likely[1:]), found.d, c.finding.probability)
