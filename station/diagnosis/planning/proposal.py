"""The next run: the shortest change of a recipe that tells a found cause from those it is tied with.

Every run of a menu is added to the recipe, the longer campaign simulated, and the found cause, at the size and shape
found and under the noise floor found, is held against all that the others could imitate: d·√κ (docs/diagnosis.md).
The shortest run with 3.3 is proposed; where none has, the one that does most for its minutes, with a second
one on top of it if that helps.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations
from math import erf

import numpy as np

from station.diagnosis.candidates.bank import Candidate, candidates, cause_library, is_testable
from station.diagnosis.candidates.shape import with_form
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.planning.plan import RARE_LEVELS, PlannedCampaign, least_distinct_share, plan_campaign
from station.diagnosis.search.distinguishability import SEPARATION_95, SignatureAxes, distinct_share
from station.domain.recipe.recipe import Recipe, Run, Turn
from station.errors import RecipeError
from station.model.effect import Effect
from station.model.simulated_line import SimulatedLine
from station.model.timeline import run_timeline

#: What a proposal must promise at least: better than a coin.
MIN_CERTAINTY = 0.6
#: d·√κ from which a run is said to bring two causes apart at all: right in 5 of 6 cases.
USEFUL_SEPARATION = 2.0
#: d·√κ that is enough whatever the room's temperature does meanwhile, which no plan knows.
AMPLE_SEPARATION = 3 * SEPARATION_95
SECOND_NEST = "once more in the next nest"


@dataclass(frozen=True, slots=True)
class CauseHypothesis:
    """A cause that it may be: at its shape, its level and the rms of its coefficients."""

    effect: Effect
    of: str
    size: float


@dataclass(frozen=True, slots=True)
class CauseTie:
    """A found cause, and the causes it cannot be told from."""

    found: CauseHypothesis
    others: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MeasuredCampaign:
    """What was measured: the recipe, how many units through how many nests, and the floor found."""

    recipe: Recipe
    units: int
    nests: int
    floor: NoiseFloor


#: A pair of causes: the one found, and one that it is tied with.
CausePair = tuple[str, str]
#: A cause at a shape and level, and what it could move.
CandidateAxes = tuple[Candidate, SignatureAxes]


@dataclass(frozen=True, slots=True)
class Proposal:
    """One or two more runs: the recipe with them, in words, how long they take, and each pair's d·√κ then.

    found: ids of the causes that were found, which stand at the heads of the line-ups.
    """

    recipe: Recipe
    change: str
    minutes: float
    apart: Mapping[CausePair, float]
    found: tuple[str, ...]

    @property
    def reached(self) -> float:
        """The smallest d·√κ."""
        return min(self.apart.values(), default=0.0)

    @property
    def separates(self) -> tuple[str, ...]:
        """The causes found, and those that it tells from them; where it tells none from them, what it tells apart."""
        named = [pair for pair in self.apart if set(pair) & set(self.found)]
        return tuple(dict.fromkeys(name for pair in named or self.apart for name in pair))

    @property
    def certainty(self) -> float:
        """Chance to name the right one; every pair may go wrong."""
        return max(0.5, 1 - sum(1 - _probability_right(x) for x in self.apart.values()))

    def of(self, pairs: Collection[CausePair]) -> "Proposal":
        """The same for some of the pairs."""
        return replace(self, apart={pair: x for pair, x in self.apart.items() if pair in pairs})


def propose(campaign: MeasuredCampaign, ties: Sequence[CauseTie]) -> Proposal | None:
    """The best next run. None where nothing of the menu brings any of the causes a step apart.

    A pair that no run brings apart is left out: what is tied with it for good need not keep the others from being told.
    """
    lines_up = [_hypotheses(campaign, tie) for tie in ties]
    found = _rated(campaign, lines_up)
    pairs = {pair for p in found for pair, x in p.apart.items() if x > USEFUL_SEPARATION}
    if not pairs:
        return None
    best = _best([p.of(pairs) for p in found])
    if best.reached < SEPARATION_95:
        again = _best([p.of(pairs) for p in _rated(replace(campaign, recipe=best.recipe), lines_up)])
        if again.reached > 1.2 * best.reached:
            change = f"{best.change}, then {again.change}"
            best = replace(again, change=change, minutes=best.minutes + again.minutes)
    return best if best.certainty > MIN_CERTAINTY else None


def _best(found: Sequence[Proposal]) -> Proposal:
    """The shortest that does it; of equally short ones the first on the menu that does it amply, or the one that does
    most. Where none does it, the one that does most a minute."""
    enough = [p for p in found if p.reached >= SEPARATION_95]
    if not enough:
        return max(found, key=lambda p: p.reached / p.minutes)
    short = [p for p in enough if round(p.minutes) == min(round(p.minutes) for p in enough)]
    return next((p for p in short if p.reached >= AMPLE_SEPARATION), max(short, key=lambda p: p.reached))


def _hypotheses(campaign: MeasuredCampaign, tie: CauseTie) -> list[CauseHypothesis]:
    """The found cause, and each of the others as it would have to be to look like it so far."""
    plan = _planned(campaign, campaign.recipe)
    found = _axes_of(plan, tie.found, _usual(plan, tie.found.effect.id))
    out = [tie.found]
    for other in tie.others:
        every = [*(usual := _usual(plan, other)), *_shaped_like(plan, usual, tie.found.effect)]
        if every:
            like, axes = min(every, key=lambda pair: distinct_share(found, pair[1]))
            size = tie.found.size * found.length / axes.length if axes.length > 0 else 0.0
            out.append(CauseHypothesis(like.effect or tie.found.effect, like.of, size))
    return out


def _rated(campaign: MeasuredCampaign, lines_up: Sequence[Sequence[CauseHypothesis]]) -> list[Proposal]:
    """The runs of the menu, the shortest first, up to one that does it."""
    heads = tuple(suspects[0].effect.id for suspects in lines_up)
    out: list[Proposal] = []
    for text, longer in sorted(run_menu(campaign), key=lambda choice: round(_minutes(choice[1]))):
        out.append(Proposal(longer, text, _minutes(longer), _separations(campaign, longer, lines_up), heads))
        if out[-1].reached >= AMPLE_SEPARATION:
            break
    return out


def _separations(
    campaign: MeasuredCampaign, longer: Recipe, lines_up: Sequence[Sequence[CauseHypothesis]]
) -> dict[CausePair, float]:
    """d·√κ of the causes of each line-up, whichever of two it is."""
    plan = _planned(campaign, longer)
    apart: dict[CausePair, float] = {}
    for suspects in lines_up:
        usual = {s.effect.id: _usual(plan, s.effect.id) for s in suspects}
        found = {s.effect.id: _axes_of(plan, s, usual[s.effect.id]) for s in suspects}
        for one, two in permutations(suspects, 2):
            name, other = one.effect.id, two.effect.id
            others = [*usual[other], *_shaped_like(plan, usual[other], one.effect)]
            share = least_distinct_share(found[name], [axes for _, axes in others])
            pair = (min(name, other), max(name, other))
            apart[pair] = min(one.size * found[name].length * float(np.sqrt(share)), apart.get(pair, np.inf))
    return apart


def _planned(campaign: MeasuredCampaign, recipe: Recipe) -> PlannedCampaign:
    # A room that wanders would part what the next room, which stays calm, does not.
    calm = SimulatedLine(nests=campaign.nests, wander_degC=0.0)
    return PlannedCampaign.of(plan_campaign(recipe, campaign.units, calm).problem, campaign.floor)


def _usual(plan: PlannedCampaign, name: str) -> list[CandidateAxes]:
    """A cause at every shape, and at every level at which it usually acts; a variance of the floor has neither."""
    view = plan.problem.view
    effect = next((e for e in cause_library(view.scene.recipe) if e.id == name), None)
    if effect is None or not is_testable(effect, view):
        return []
    usual = [c for c in candidates(effect, view) if c.of not in RARE_LEVELS or c.of == effect.of[0]]
    usual += [_at_form(plan, c, shape) for c in {c.of: c for c in usual}.values() for shape in _more_forms(effect)]
    return [(c, plan.axes(c)) for c in usual]


def _more_forms(effect: Effect) -> Iterator[Effect]:
    """Time constants between those of the grid, and as far beyond its ends as a diagnosis would go."""
    for p in effect.forms:
        if p.name == "time_constant" and p.grid:
            ends = (0.5 * min(p.low, *p.grid), 2 * max(p.high, *p.grid))
            middles = (float(np.sqrt(a * b)) for a, b in pairwise(p.grid))
            yield from (replace(effect, **{p.field: value}) for value in (*ends, *middles))


def _shaped_like(plan: PlannedCampaign, usual: Sequence[CandidateAxes], other: Effect) -> list[CandidateAxes]:
    """A cause at the shape of another one, which the steps of its grid may miss; nothing where they share no shape."""
    wanted = {p.field: getattr(other, p.field) for p in other.forms}
    levels = {c.of: c for c, _ in usual}.values()
    out = []
    for c in levels:
        shape = {p.field: wanted[p.field] for p in (c.effect.forms if c.effect else ()) if p.field in wanted}
        if c.effect is not None and shape:
            at = _at_form(plan, c, replace(c.effect, **shape))
            out.append((at, plan.axes(at)))
    return out


def _axes_of(plan: PlannedCampaign, suspect: CauseHypothesis, usual: Sequence[CandidateAxes]) -> SignatureAxes:
    """A suspect as the planned campaign would show it."""
    like = next((c for c, _ in usual if c.of == suspect.of), usual[0][0])
    return plan.axes(_at_form(plan, like, suspect.effect))


def _at_form(plan: PlannedCampaign, candidate: Candidate, effect: Effect) -> Candidate:
    """A candidate at another shape."""
    return with_form(candidate, effect, plan.problem.view)


def _probability_right(reached: float) -> float:
    """Chance to name the right one of two."""
    return 0.5 * (1 + erf(reached / 2 / np.sqrt(2)))


def _minutes(recipe: Recipe) -> float:
    """How long the last run takes, the unit's change and warming included."""
    last = run_timeline(recipe, len(recipe.runs) - 1)
    return (last.duration_s + last.prewarm_s + SimulatedLine().changeover_s) / 60


def run_menu(campaign: MeasuredCampaign) -> Iterator[tuple[str, Recipe]]:
    """The recipe with one more run of each kind, the quickest to set up first."""
    turned, flipped = Turn(axis=(0, 0, 1), angle_deg=180), Turn(axis=(1, 0, 0), angle_deg=180)
    kinds = [
        *([(SECOND_NEST, Run(), {})] if campaign.nests > 1 else []),
        ("motors off", Run(motors="off"), {}),
        ("reversed order", Run(order="reversed"), {}),
        ("turned 180° in the seat", Run(seating="turned"), {"turned": turned}),
        ("flipped 180° in the seat", Run(seating="flipped"), {"flipped": flipped}),
        ("10 °C warmer", Run(temperature_offset_degC=10), {}),
        ("warmed up for ten minutes", Run(prewarm_s=600), {}),
        ("reversed and 10 °C warmer", Run(order="reversed", temperature_offset_degC=10), {}),
        ("flipped and warmed up", Run(seating="flipped", prewarm_s=600), {"flipped": flipped}),
        (
            "turned, reversed, 10 °C warmer and warmed up",
            Run(seating="turned", order="reversed", temperature_offset_degC=10, prewarm_s=600),
            {"turned": turned},
        ),
    ]
    for told, run, seats in kinds:
        longer = campaign.recipe.model_dump(by_alias=True)
        longer["runs"] = [*(r.model_dump() for r in campaign.recipe.runs), run.model_dump()]
        longer["seatings"] = {k: v.model_dump() for k, v in ({**seats, **campaign.recipe.seatings}).items()}
        try:
            yield f"one run {told}", Recipe.model_validate(longer)
        except ValueError as exc:
            raise RecipeError(f"a run {told} cannot be added to recipe {campaign.recipe.name}: {exc}") from exc
