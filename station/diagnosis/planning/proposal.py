"""The next run: the shortest change of a recipe that separates a found cause from those it is tied with.

Every run of a menu is added to the recipe, the longer campaign simulated on a bench that warms as the measured one
did, and each cause of the tie, at the size it would need to look as the data do, is held against all that the others
could imitate: d·√κ (docs/diagnosis.md). What of it is promised is in `promise`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from station.diagnosis.planning.chance import SimulatedChance, simulated_plan
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.plan import PlannedRuns, least_distinct_share
from station.diagnosis.planning.promise import Promise, TrueAndOther
from station.diagnosis.planning.run_menu import minutes_of, run_menu
from station.diagnosis.planning.suspects import (
    CauseHypothesis,
    CauseTie,
    Suspects,
    axes_of,
    shaped_like,
    suspects_of,
    usual_candidates,
)
from station.diagnosis.search.finding import is_free_in_each_run
from station.domain.recipe.recipe import Recipe

#: Certainty that is enough, the gain that another run must bring, runs at most, those that may bring none on their own,
#: and how many of those that the bound ranks first are simulated.
SUFFICIENT_CERTAINTY, LEAST_GAIN, MAX_RUNS, MOST_IN_VAIN, SIMULATED = 0.95, 0.05, 4, 1, 3
#: What the bound gives no more than this is not worth simulating.
HOPELESS_CERTAINTY = 0.01


@dataclass(frozen=True, slots=True)
class Proposal:
    """One or more runs: the longer campaign, in words, how long the new runs take, and what they promise.

    chance: of simulated diagnoses, promised: the same by other sets than those it is chosen by; next_nest: whether the
    plan reckons with each unit in the next nest."""

    campaign: PlannedRuns
    change: str
    minutes: float
    promise: Promise
    chance: SimulatedChance | None = None
    promised: SimulatedChance | None = None
    next_nest: bool = False

    @property
    def recipe(self) -> Recipe:
        """The recipe with the new runs."""
        return self.campaign.recipe

    @property
    def separates(self) -> tuple[str, ...]:
        """See `Promise`."""
        return self.promise.separates

    @property
    def leaves(self) -> tuple[str, ...]:
        """See `Promise`."""
        return self.promise.leaves

    @property
    def certainty(self) -> float:
        """Chance that the right cause is left alone: of simulated diagnoses, or before them the bound of `Promise`."""
        return self.promise.certainty if self.chance is None else self.chance.share


def rated_runs(campaign: MeasuredCampaign, ties: Sequence[CauseTie]) -> Iterator[Proposal]:
    """Every run of the menu as the next one, the shortest first, with what it would separate."""
    lines_up = [suspects_of(campaign, tie) for tie in ties]
    return _rated_menu(campaign, PlannedRuns.measured(campaign.recipe), lines_up, None)


def promised(campaign: MeasuredCampaign, proposal: Proposal, ties: Sequence[CauseTie]) -> Proposal:
    """A proposal with the chance that simulated diagnoses give it."""
    simulated = _simulated(campaign, proposal, [suspects_of(campaign, tie) for tie in ties])
    return replace(simulated, chance=simulated.promised)


def propose(campaign: MeasuredCampaign, ties: Sequence[CauseTie]) -> Proposal | None:
    """The best next run, or several, with the chance that simulated diagnoses give it; None where nothing of the menu
    separates any of the causes."""
    lines_up = [suspects_of(campaign, tie) for tie in ties]
    now = PlannedRuns.measured(campaign.recipe)
    best: Proposal | None = None
    last: Proposal | None = None
    in_vain = 0
    for _ in range(MAX_RUNS):
        rated = list(_up_to_certain(_rated_menu(campaign, now, lines_up, last)))
        last = best_proposal([_simulated(campaign, p, lines_up) for p in _promising(rated)])
        if last is None:
            break
        now = last.campaign
        if best is None or last.certainty >= best.certainty + LEAST_GAIN:
            best, in_vain = last, 0
        else:
            in_vain += 1
        if best.certainty >= SUFFICIENT_CERTAINTY or in_vain > MOST_IN_VAIN:
            break
    if best is None or not best.separates:
        return None
    # What was chosen for its chance is promised by other sets than it was chosen by.
    return replace(best, chance=best.promised, next_nest=campaign.nests > 1)


def _promising(rated: Sequence[Proposal]) -> list[Proposal]:
    """Those of a menu that the bound ranks first."""
    first = best_proposal(rated)
    likely = sorted(rated, key=lambda p: -p.certainty)
    every = {id(p): p for p in ([] if first is None else [first, *likely]) if p.certainty > HOPELESS_CERTAINTY}
    return list(every.values())[:SIMULATED]


def _simulated(campaign: MeasuredCampaign, proposal: Proposal, lines_up: Sequence[Suspects]) -> Proposal:
    """A proposal with the chance that simulated diagnoses give it."""
    found = simulated_plan(campaign, proposal.campaign, lines_up)
    promise = replace(proposal.promise, simulated=found.parted)
    return replace(proposal, promise=promise, chance=found.chosen_by, promised=found.promised)


def best_proposal(found: Sequence[Proposal]) -> Proposal | None:
    """The shortest of those that are as good as any, to within a gain not worth a minute; of such the quickest to set
    up, where a hundredth of chance is all that another is better by."""
    most = max((p.certainty for p in found), default=0.0)
    good = [p for p in found if p.certainty >= min(most, SUFFICIENT_CERTAINTY) - LEAST_GAIN / 2]
    return min(good, key=lambda p: (round(p.minutes), -round(p.certainty, 2)), default=None)


def _rated_menu(
    campaign: MeasuredCampaign,
    now: PlannedRuns,
    lines_up: Sequence[Suspects],
    before: Proposal | None,
) -> Iterator[Proposal]:
    """The runs of the menu, the shortest first."""
    for text, longer in sorted(run_menu(campaign, now), key=lambda choice: round(minutes_of(choice[1]))):
        yield _rated(campaign, text, longer, lines_up, before)


def _up_to_certain(found: Iterator[Proposal]) -> Iterator[Proposal]:
    """Proposals up to the first that is certain enough."""
    for one in found:
        yield one
        if one.certainty >= SUFFICIENT_CERTAINTY:
            return


def _rated(
    campaign: MeasuredCampaign,
    text: str,
    longer: PlannedRuns,
    lines_up: Sequence[Suspects],
    before: Proposal | None,
) -> Proposal:
    """A longer campaign with what it would separate; before: the proposal that it goes on from."""
    change = text if before is None else f"{before.change}, then {text}"
    minutes = minutes_of(longer) + (before.minutes if before else 0.0)
    apart = _separations(campaign, longer, lines_up)
    return Proposal(longer, change, minutes, Promise(tuple(s.tie for s in lines_up), apart))


def _separations(
    campaign: MeasuredCampaign, longer: PlannedRuns, lines_up: Sequence[Suspects]
) -> dict[TrueAndOther, float]:
    """d·√κ of the causes of each line-up, were one of two the true one, against the other."""
    plan = campaign.gone_on(longer)
    apart: dict[TrueAndOther, float] = {}
    for suspects in lines_up:
        usual = {name: usual_candidates(plan, name) for name in suspects.tie.names}
        for shapes, (name, other) in _pairs_of(suspects):
            shaped = [axes_of(plan, one, usual[name]) for one in shapes]
            each = []
            for one, axes in zip(shapes, shaped, strict=True):
                others = [*usual[other], *shaped_like(plan, usual[other], one.effect)]
                share = least_distinct_share(axes, [x for c, x in others if not is_free_in_each_run(c)])
                each.append(one.size * axes.length * float(np.sqrt(share)))
            apart[name, other] = suspects.tie.as_one(each, [one.share for one in shapes])
    return apart


def _pairs_of(suspects: Suspects) -> Iterator[tuple[tuple[CauseHypothesis, ...], TrueAndOther]]:
    """Each cause at its shapes, were it the true one, beside each other of the tie."""
    of = dict(zip(suspects.tie.names, suspects.causes, strict=True))
    yield from ((of[name], (name, other)) for name, other in permutations(suspects.tie.names, 2))
