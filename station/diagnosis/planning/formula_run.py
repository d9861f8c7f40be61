"""The next run where formulas are tied: the one on which those that fit these data alike differ most."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from station.diagnosis.discovery.term_fit import ROUNDS, TermFit, probe_of, search_constant
from station.diagnosis.planning.measured import MeasuredCampaign, measured_campaign
from station.diagnosis.planning.plan import PlannedCampaign, PlannedRuns
from station.diagnosis.planning.promise import Promise, TiedCauses, TrueAndOther
from station.diagnosis.planning.proposal import (
    HOPELESS_CERTAINTY,
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
    """Each run of the menu, the shortest first, up to the first that is certain enough; but for those that promise no
    more than a shorter one, or next to nothing."""
    tied = tuple(TiedCauses.of([formula_text(f.term) for f in tie], np.inf, {}) for tie in ties)
    menu = [*run_menu(campaign, now), *_wider_temperatures(now, ties)]
    most = -np.inf
    for text, longer in sorted(menu, key=lambda choice: round(minutes_of(choice[1]))):
        promise = _promise_of(campaign.gone_on(longer), ties, tied, most)
        if promise is not None:
            found = Proposal(longer, text, minutes_of(longer), promise)
            yield found
            if found.certainty >= SUFFICIENT_CERTAINTY:
                return
            most = max(most, found.certainty, HOPELESS_CERTAINTY)


def _wider_temperatures(now: PlannedRuns, ties: list[tuple[TermFit, ...]]) -> Iterator[tuple[str, PlannedRuns]]:
    """A run beyond the temperatures so far, where formulas that know one are tied: there their curves part."""
    if not any(name.startswith("temperature") for tie in ties for f in tie for name in f.term.needs):
        return
    offsets = [run.temperature_offset_degC for run in now.recipe.runs]
    warmer, colder = max(offsets) + STEP_DEGC, min(offsets) - STEP_DEGC
    for text, offset in ((f"{warmer:g} °C warmer", warmer), (f"{-colder:g} °C colder", colder)):
        yield f"one run {text}", now.followed_by(Run(temperature_offset_degC=offset), {}, now.dwells[-1])


class _Rival(NamedTuple):
    """A law, were it the true one: what it moves in a longer campaign and how long that is, and a rival."""

    found: SignatureAxes
    length: float
    rival: Term

    def apart(self, share: float) -> float:
        """d·√κ, the rival following all but a share κ."""
        return self.length * float(np.sqrt(share))


def _promise_of(
    plan: PlannedCampaign, ties: list[tuple[TermFit, ...]], tied: tuple[TiedCauses, ...], most: float
) -> Promise | None:
    """What a longer campaign promises, by d·√κ of each law, were it the true one, against each other; None where that
    is no more than `most`. Rivals with the constants that they have now are as far from a law as they can be; the
    nearest of them are followed on first."""
    pairs = {names: rival for tie in ties for names, rival in _rivals(plan, tie)}
    apart = {names: pair.apart(_share_beyond(plan, pair.found, pair.rival)) for names, pair in pairs.items()}
    for names in sorted(apart, key=lambda names: apart[names]):
        if Promise(tied, apart).certainty <= most:
            return None
        apart[names] = pairs[names].apart(share_beyond(plan, pairs[names].found, pairs[names].rival))
    promise = Promise(tied, apart)
    return promise if promise.certainty > most else None


def _rivals(plan: PlannedCampaign, tie: tuple[TermFit, ...]) -> Iterator[tuple[TrueAndOther, _Rival]]:
    """Each of the laws of a tie against each other."""
    found = [plan.axes(probe_of(fit.term, plan.problem.view)) for fit in tie]
    for one, two in permutations(range(len(tie)), 2):
        names = formula_text(tie[one].term), formula_text(tie[two].term)
        yield names, _Rival(found[one], tie[one].rms * found[one].length, tie[two].term)


def share_beyond(plan: PlannedCampaign, found: SignatureAxes, rival: Term) -> float:
    """κ: which share of a law a rival cannot follow, its constants what they would have to be in the longer campaign:
    the next diagnosis looks for them anew."""
    for _ in range(ROUNDS if len(rival.fields) > 1 else 1):
        for field in rival.fields:
            rival = search_constant(
                rival, field, plan.problem.view, lambda term: 1 - _share_beyond(plan, found, term)
            ).term
    return _share_beyond(plan, found, rival)


def _share_beyond(plan: PlannedCampaign, found: SignatureAxes, rival: Term) -> float:
    """The same with the constants that it has."""
    return distinct_share(found, plan.axes(probe_of(rival, plan.problem.view)))
