"""The next run: the shortest change of a recipe that separates a found cause from those it is tied with.

Every run of a menu is added to the recipe, the longer campaign simulated on a bench that warms as the measured one
did, and each cause of the tie, at the size it would need to look as the data do, is held against all that the others
could imitate: d·√κ (docs/diagnosis.md). What of it is promised is in `promise`.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations, product

import numpy as np

from station.diagnosis.planning.chance import CHOOSING_SETS, PROMISED_SETS, PlanSimulator, SetsToDraw, SimulatedChance
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.plan import PlannedRuns, least_distinct_share
from station.diagnosis.planning.promise import Promise, TrueAndOther
from station.diagnosis.planning.run_menu import made_for, minutes_of, run_menu
from station.diagnosis.planning.suspects import (
    CauseHypothesis,
    CauseTie,
    Suspects,
    axes_of,
    causes_shown,
    shaped_like,
    suspects_of_all,
    usual_candidates,
)
from station.diagnosis.search.distinguishability import SEPARATION_95
from station.diagnosis.search.finding import is_free_in_each_run
from station.domain.recipe.blocks import Run
from station.domain.recipe.recipe import Recipe

#: Certainty that is enough, the gain that another run must bring, runs at most and those that may bring none on their
#: own: none where the best is likely enough already.
SUFFICIENT_CERTAINTY, LEAST_GAIN, MAX_RUNS, MOST_IN_VAIN = 0.95, 0.05, 4, 1
#: How many of those that the bound ranks first are simulated for the first run, one less for each after it; one less
#: again where units times positions are more than so many: a simulated diagnosis takes up to a second there.
SIMULATED, LARGE_CAMPAIGN = 3, 96
#: Runs that promise most alone: what is tried again after the first.
MOST_KINDS = 4
#: A chance below which another nest is planned for, where there was one alone; and the runs in it at most.
LIKELY, MAX_RUNS_ELSEWHERE = 0.9, 2
#: What the bound gives no more than this is not worth simulating.
HOPELESS_CERTAINTY = 0.01
#: To this share of a distance two plans part alike.
ALIKE_SHARE = 0.03
#: d·√κ beyond which a cause that only the new runs can show is none that the true one could be taken for.
CLEARLY_APART = 6.0


@dataclass(frozen=True, slots=True)
class Proposal:
    """One or more runs: the longer campaign, in words, how long the new runs take, and what they promise.

    chance: of simulated diagnoses; next_nest: whether the plan reckons with each unit in the next nest, another_nest:
    in one that nothing was measured in; simulators: those made for it, by the id of the bench's campaign."""

    campaign: PlannedRuns
    change: str
    minutes: float
    promise: Promise
    chance: SimulatedChance | None = None
    next_nest: bool = False
    another_nest: bool = False
    simulators: Mapping[int, PlanSimulator] = field(default_factory=dict, repr=False, compare=False)

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
    lines_up = suspects_of_all(campaign, ties)
    return _rated_menu(campaign, PlannedRuns.measured(campaign.recipe), lines_up, None)


def promised(campaign: MeasuredCampaign, proposal: Proposal, ties: Sequence[CauseTie]) -> Proposal:
    """A proposal with the chance that simulated diagnoses give it."""
    return _simulated(campaign, proposal, suspects_of_all(campaign, ties), PROMISED_SETS)


def propose(campaign: MeasuredCampaign, ties: Sequence[CauseTie]) -> Proposal | None:
    """The best next run, or several, with the chance that simulated diagnoses give it; None where nothing of the menu
    separates any of the causes."""
    lines_up = suspects_of_all(campaign, ties)
    if not lines_up:
        return None
    best = _longer(campaign, lines_up, MAX_RUNS)
    if campaign.in_one_nest and _of_a_nest(lines_up) and (best is None or best.certainty < LIKELY):
        # What is a nest's and what is the rig's, no run in that nest tells.
        other = _longer(replace(campaign, nests=2), lines_up, MAX_RUNS_ELSEWHERE)
        if other is not None and (best is None or other.certainty > best.certainty + LEAST_GAIN):
            best = replace(other, another_nest=True)
    if best is None:
        return None
    # What was chosen for its chance is promised by other sets than it was chosen by.
    where = replace(campaign, nests=2) if best.another_nest else campaign
    told = _on_both_benches(where, best, lines_up, PROMISED_SETS)
    return replace(told, next_nest=campaign.nests > 1, simulators={}) if told.separates else None


def _of_a_nest(lines_up: Sequence[Suspects]) -> bool:
    """Whether any of the causes is one of a nest, as a rule."""
    return any(one.effect.of[:1] == ("nest",) for s in lines_up for shapes in s.causes for one in shapes)


def _longer(campaign: MeasuredCampaign, lines_up: Sequence[Suspects], runs: int) -> Proposal | None:
    """The best of one run up to so many, by simulated diagnoses; of two benches on that which parts less."""
    here, other = campaign, campaign.on_drifting_bench
    now, kinds = PlannedRuns.measured(campaign.recipe), list[Run]()
    best: Proposal | None = None
    last: Proposal | None = None
    in_vain = 0
    most = SIMULATED if campaign.units * len(campaign.recipe.positions) <= LARGE_CAMPAIGN else SIMULATED - 1
    for number in range(runs):
        menu = _Menu(_rated_menu(here, now, lines_up, last, kinds), _runs_of_causes(here, now, lines_up, last))
        least = HOPELESS_CERTAINTY if best is None else best.certainty + LEAST_GAIN / 2
        last = menu.best_simulated(here, lines_up, least, most if number == 0 else most - 1)
        if last is None:
            break
        harder = False
        if other is not None:
            there = _simulated(other, last, lines_up, CHOOSING_SETS)
            harder, last = there.certainty < last.certainty - LEAST_GAIN, _together(last, there)
        now = last.campaign
        if best is None or last.certainty >= best.certainty + LEAST_GAIN:
            best, in_vain = last, 0
        else:
            in_vain += 1
        if best.certainty >= SUFFICIENT_CERTAINTY or in_vain > (0 if best.certainty >= LIKELY else MOST_IN_VAIN):
            break
        if harder:
            here, other, kinds = other or here, here, []
        elif not kinds:
            kinds = menu.worth_trying()
    return best


def _runs_of_causes(
    campaign: MeasuredCampaign, now: PlannedRuns, lines_up: Sequence[Suspects], last: Proposal | None
) -> list[Proposal]:
    """The runs made for causes that are likely left tied so far: none of which the plan has already. A bound that knows
    nothing of the errors of covariates ranks them too low."""
    chances = {} if last is None else last.promise.simulated
    left = {name for pair, chance in chances.items() if chance < LIKELY for name in pair}
    names = {name for s in lines_up for name in s.members if last is None or name in left}
    names -= {made_for(run) or "" for run in now.recipe.runs}
    menu = run_menu(campaign, now, names)
    own = [_kind_of(longer) for _, longer in menu if made_for(_kind_of(longer)) is not None] if names else []
    return list(_rated_menu(campaign, now, lines_up, last, own)) if own else []


class _Menu:
    """The runs that may be next, rated as far as they were looked at: the shortest first."""

    def __init__(self, runs: Iterator[Proposal], first: Sequence[Proposal] = ()) -> None:
        self._runs, self._first = runs, first
        self._rated: list[Proposal] = []

    def best_simulated(
        self, campaign: MeasuredCampaign, lines_up: Sequence[Suspects], least: float, most: int
    ) -> Proposal | None:
        """The best of so many: of the runs of a tied cause's own the best, and those that the bound ranks first; of all
        it gives more than the least chance, and of such as part alike one; no further than to one certain enough."""
        found, tried = list[Proposal](), list[Mapping[TrueAndOther, float]]()
        first = best_proposal([p for p in self._first if p.certainty > least])
        while len(found) < most:
            if first is None:
                self._rated += _up_to_certain(self._runs)
                left = [p for p in self._rated if p.certainty > least and not any(_alike(p, one) for one in tried)]
                first = best_proposal(left)
            if first is None:
                break
            tried.append(first.promise.apart)
            found.append(_simulated(campaign, first, lines_up, CHOOSING_SETS))
            if found[-1].certainty >= SUFFICIENT_CERTAINTY:
                break
            first = None
        return best_proposal(found)

    def worth_trying(self) -> list[Run]:
        """Of a whole menu the runs that alone promise most, and of each pair the shortest that parts it."""
        self._rated += self._runs
        likely = sorted(self._rated, key=lambda p: -p.certainty)[:MOST_KINDS]
        pairs = {pair for p in self._rated for pair in p.promise.apart}
        best = [
            max(self._rated, key=lambda p: min(p.promise.apart.get(pair, 0.0), CLEARLY_APART)) for pair in sorted(pairs)
        ]
        return [_kind_of(p.campaign) for p in (*likely, *best)]


def _alike(proposal: Proposal, apart: Mapping[TrueAndOther, float]) -> bool:
    """Whether a proposal parts the same pairs as far as another one does, to a share."""
    mine = proposal.promise.apart
    return mine.keys() == apart.keys() and all(
        abs(x - apart[pair]) <= ALIKE_SHARE * max(x, apart[pair], SEPARATION_95) for pair, x in mine.items()
    )


def _simulated(
    campaign: MeasuredCampaign, proposal: Proposal, lines_up: Sequence[Suspects], sets: SetsToDraw
) -> Proposal:
    """A proposal with the chance that simulated diagnoses give it."""
    new = {other for _, other in proposal.promise.apart} - {name for s in lines_up for name in s.members}
    key = id(campaign)
    made = proposal.simulators.get(key) or PlanSimulator.of(campaign, proposal.campaign, lines_up, sorted(new))
    found = made.simulated(lines_up, sets)
    promise = replace(proposal.promise, simulated=found.parted)
    simulators = {**proposal.simulators, key: made}
    return replace(proposal, promise=promise, chance=found.chance, simulators=simulators)


def _on_both_benches(
    campaign: MeasuredCampaign, proposal: Proposal, lines_up: Sequence[Suspects], sets: SetsToDraw
) -> Proposal:
    """The same, of so many in all, half of them where the room drifts, if that may be."""
    if (drifting := campaign.on_drifting_bench) is None:
        return _simulated(campaign, proposal, lines_up, sets)
    half = replace(sets, count=sets.count // 2)
    return _together(*(_simulated(where, proposal, lines_up, half) for where in (campaign, drifting)))


def _together(one: Proposal, other: Proposal) -> Proposal:
    """A proposal with the chance that as many simulated diagnoses on each of two benches give it."""
    assert one.chance is not None and other.chance is not None
    chance = SimulatedChance(one.chance.right + other.chance.right, one.chance.sets + other.chance.sets)
    pairs = one.promise.simulated.keys() & other.promise.simulated.keys()
    parted = {pair: (one.promise.simulated[pair] + other.promise.simulated[pair]) / 2 for pair in sorted(pairs)}
    simulators = {**one.simulators, **other.simulators}
    return replace(one, promise=replace(one.promise, simulated=parted), chance=chance, simulators=simulators)


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
    kinds: Collection[Run] = (),
) -> Iterator[Proposal]:
    """The runs of the menu, the shortest first; kinds: none but these, where there are any."""
    menu = run_menu(campaign, now, {name for s in lines_up for name in s.members})
    for text, longer in sorted(menu, key=lambda choice: round(minutes_of(choice[1]))):
        if not kinds or _kind_of(longer) in kinds:
            yield _rated(campaign, text, longer, lines_up, before)


def _kind_of(longer: PlannedRuns) -> Run:
    """What the last run of a longer campaign is, however long it dwells, and of however many positions."""
    return longer.recipe.runs[-1]


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
    apart, shown = dict[TrueAndOther, float](), causes_shown(plan)
    for suspects in lines_up:
        new = [name for name in suspects.hidden if name in shown]
        usual = {name: usual_candidates(plan, name) for name in (*suspects.tie.names, *new)}
        for shapes, (name, other) in _pairs_of(suspects, new):
            shaped = [axes_of(plan, one, usual[name]) for one in shapes]
            each = []
            for one, axes in zip(shapes, shaped, strict=True):
                others = [*usual[other], *shaped_like(plan, usual[other], one.effect)]
                share = least_distinct_share(axes, [x for c, x in others if not is_free_in_each_run(c)])
                each.append(one.size * axes.length * float(np.sqrt(share)))
            parted = suspects.tie.as_one(each, [one.share for one in shapes])
            if other not in new or parted < CLEARLY_APART:
                apart[name, other] = parted
    return apart


def _pairs_of(suspects: Suspects, new: Sequence[str]) -> Iterator[tuple[tuple[CauseHypothesis, ...], TrueAndOther]]:
    """Each cause at its shapes, were it the true one, beside each other of the tie and each that is new."""
    of = dict(zip(suspects.tie.names, suspects.causes, strict=True))
    yield from ((of[name], (name, other)) for name, other in permutations(suspects.tie.names, 2))
    yield from ((of[name], (name, other)) for name, other in product(suspects.tie.names, new))
