"""The next run: the shortest change of a recipe that separates a found cause from those it is tied with.

Every run of a menu is added to the recipe, the longer campaign simulated on a bench that warms as the measured one
did, and each cause of the tie, at the size it would need to look as the data do, is held against all that the others
could imitate: d·√κ (docs/diagnosis.md). What of it is promised is in `promise`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, permutations
from typing import Any

import numpy as np

from station.diagnosis.candidates.bank import Candidate, candidates, cause_library, is_testable
from station.diagnosis.candidates.shape import with_form
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.plan import (
    RARE_LEVELS,
    PlannedCampaign,
    PlannedRuns,
    least_distinct_share,
)
from station.diagnosis.planning.promise import Promise, TiedCauses, TrueAndOther
from station.diagnosis.search.distinguishability import SignatureAxes, distinct_share
from station.diagnosis.search.finding import is_free_in_each_run
from station.domain.recipe.blocks import DwellRule, Run
from station.domain.recipe.position import Turn
from station.domain.recipe.recipe import Recipe
from station.model.effect import Effect
from station.model.simulated_line import SimulatedLine
from station.model.timeline import run_timeline

#: Certainty that is enough, the gain that another run must bring, and runs at most.
SUFFICIENT_CERTAINTY, LEAST_GAIN, MAX_RUNS = 0.95, 0.05, 3
#: How much longer a slow run dwells, and at most for how long, s.
SLOW_FACTOR, SLOWEST_DWELL_S = 10.0, 10.0
#: Shapes at which a cause may be true that are planned for, and the odds to the likeliest below which one is not.
MOST_SHAPES, LEAST_ODDS = 4, 0.1
SECOND_NEST = "once more in the next nest"


@dataclass(frozen=True, slots=True)
class CauseHypothesis:
    """A cause that it may be: at its shape, its level and the rms of its coefficients; its share of the chance that it
    is the cause at all, the rest being other shapes of it."""

    effect: Effect
    of: str
    size: float
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class CauseTie:
    """A found cause of strength d with the causes it cannot be told from; probability of each by id, all alike where
    none is given."""

    found: CauseHypothesis
    others: tuple[str, ...]
    d: float = np.inf
    probability: Mapping[str, float] = field(default_factory=dict)


#: A candidate at a shape and level, and what it could move.
CandidateAxes = tuple[Candidate, SignatureAxes]


@dataclass(frozen=True, slots=True)
class Suspects:
    """The causes of a tie, the one found first, each at the shapes at which it would look like the data; and how likely
    each is."""

    causes: tuple[tuple[CauseHypothesis, ...], ...]
    tie: TiedCauses


@dataclass(frozen=True, slots=True)
class Proposal:
    """One or more runs: the longer campaign, in words, how long the new runs take, and what they promise."""

    campaign: PlannedRuns
    change: str
    minutes: float
    promise: Promise

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
        """See `Promise`."""
        return self.promise.certainty


def rated_runs(campaign: MeasuredCampaign, ties: Sequence[CauseTie]) -> Iterator[Proposal]:
    """Every run of the menu as the next one, the shortest first, with what it would separate."""
    lines_up = [_suspects(campaign, tie) for tie in ties]
    return _rated_menu(campaign, PlannedRuns.measured(campaign.recipe), lines_up, None)


def propose(campaign: MeasuredCampaign, ties: Sequence[CauseTie]) -> Proposal | None:
    """The best next run, or several; None where nothing of the menu separates any of the causes."""
    lines_up = [_suspects(campaign, tie) for tie in ties]
    now = PlannedRuns.measured(campaign.recipe)
    best: Proposal | None = None
    for _ in range(MAX_RUNS):
        better = best_proposal(list(_up_to_certain(_rated_menu(campaign, now, lines_up, best))))
        if better is None or (best is not None and better.certainty < best.certainty + LEAST_GAIN):
            break
        best, now = better, better.campaign
        if best.certainty >= SUFFICIENT_CERTAINTY:
            break
    return best if best is not None and best.separates else None


def best_proposal(found: Sequence[Proposal]) -> Proposal | None:
    """The shortest of those that are as good as any, to within a gain not worth a minute; of such the quickest to set
    up, where a hundredth of chance is all that another is better by."""
    most = max((p.certainty for p in found), default=0.0)
    good = [p for p in found if p.certainty >= min(most, SUFFICIENT_CERTAINTY) - LEAST_GAIN / 2]
    return min(good, key=lambda p: (round(p.minutes), -round(p.certainty, 2)), default=None)


def _suspects(campaign: MeasuredCampaign, tie: CauseTie) -> Suspects:
    """The found cause, and each of the others as it would have to be to look like it so far."""
    plan = campaign.gone_on(PlannedRuns.measured(campaign.recipe))
    found = _axes_of(plan, tie.found, _usual(plan, tie.found.effect.id))
    # The strength found is freed of what noise adds to a size, and is that of all units.
    known = np.isfinite(tie.d) and found.length > 0
    head = replace(tie.found, size=tie.d / found.length) if known else tie.found
    strength = head.size * found.length
    out = [_likely_shapes(head, found, _usual(plan, head.effect.id), strength)]
    for other in tie.others:
        every = [*(usual := _usual(plan, other)), *_shaped_like(plan, usual, tie.found.effect)]
        if every:
            # Of those that look alike the one of fewest coefficients: what others could be is not what they are.
            like, axes = min(every, key=lambda pair: (round(distinct_share(found, pair[1]), 1), pair[1].m.shape[-1]))
            alike = CauseHypothesis(like.effect or tie.found.effect, like.of, _size_of(strength, axes))
            out.append(_likely_shapes(alike, found, every, strength))
    names = tuple(shapes[0].effect.id for shapes in out)
    return Suspects(tuple(out), TiedCauses.of(names, tie.d, tie.probability))


def _likely_shapes(
    suspect: CauseHypothesis, found: SignatureAxes, every: Sequence[CandidateAxes], strength: float
) -> tuple[CauseHypothesis, ...]:
    """A suspect at the shapes that the data do not rule out: one that leaves a share κ of a signal of strength d is
    less likely by d²κ/2 nats. The suspect's own comes first."""
    mine = [(c.effect, axes) for c, axes in every if c.of == suspect.of and c.effect is not None]
    if not suspect.effect.forms or not np.isfinite(strength):
        return (suspect,)
    odds = [float(np.exp(-0.5 * strength**2 * distinct_share(found, axes))) for _, axes in mine]
    top = max(odds, default=0.0)
    near = [
        (w, e, axes) for w, (e, axes) in zip(odds, mine, strict=True) if w > LEAST_ODDS * top and e != suspect.effect
    ]
    near.sort(key=lambda shape: [float(getattr(shape[1], p.field)) for p in suspect.effect.forms])
    near = near[:: max(-(-len(near) // MOST_SHAPES), 1)]
    total = sum(w for w, _, _ in near) + top
    others = [CauseHypothesis(e, suspect.of, _size_of(strength, axes), w / total) for w, e, axes in near]
    return (replace(suspect, share=1.0 - sum(other.share for other in others)), *others)


def _size_of(strength: float, axes: SignatureAxes) -> float:
    """The size at which a cause is so strong."""
    return strength / axes.length if axes.length > 0 else 0.0


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
        usual = {name: _usual(plan, name) for name in suspects.tie.names}
        for shapes, (name, other) in _pairs_of(suspects):
            shaped = [_axes_of(plan, one, usual[name]) for one in shapes]
            each = []
            for one, axes in zip(shapes, shaped, strict=True):
                others = [*usual[other], *_shaped_like(plan, usual[other], one.effect)]
                share = least_distinct_share(axes, [x for c, x in others if not is_free_in_each_run(c)])
                each.append(one.size * axes.length * float(np.sqrt(share)))
            apart[name, other] = suspects.tie.as_one(each, [one.share for one in shapes])
    return apart


def _pairs_of(suspects: Suspects) -> Iterator[tuple[tuple[CauseHypothesis, ...], TrueAndOther]]:
    """Each cause at its shapes, were it the true one, beside each other of the tie."""
    of = dict(zip(suspects.tie.names, suspects.causes, strict=True))
    yield from ((of[name], (name, other)) for name, other in permutations(suspects.tie.names, 2))


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


def minutes_of(runs: PlannedRuns) -> float:
    """How long the last run takes, the unit's change and warming included."""
    last = run_timeline(runs.recipe, len(runs.recipe.runs) - 1)
    return (last.duration_s + last.prewarm_s + SimulatedLine().changeover_s) / 60


def run_menu(campaign: MeasuredCampaign, now: PlannedRuns) -> Iterator[tuple[str, PlannedRuns]]:
    """The campaign with one more run of each kind, the quickest to set up first."""
    turned, flipped = Turn(axis=(0, 0, 1), angle_deg=180), Turn(axis=(1, 0, 0), angle_deg=180)
    kinds: list[tuple[str, dict[str, Any], dict[str, Turn], bool]] = [
        *([(SECOND_NEST, {}, {}, False)] if campaign.nests > 1 else []),
        ("motors off", {"motors": "off"}, {}, False),
        ("reversed order", {"order": "reversed"}, {}, False),
        ("turned 180° in the seat", {"seating": "turned"}, {"turned": turned}, False),
        ("flipped 180° in the seat", {"seating": "flipped"}, {"flipped": flipped}, False),
        ("10 °C warmer", {"temperature_offset_degC": 10}, {}, False),
        ("reversed and 10 °C warmer", {"order": "reversed", "temperature_offset_degC": 10}, {}, False),
        ("slow", {"order": "reversed"}, {}, True),
        ("slow and 10 °C warmer", {"order": "reversed", "temperature_offset_degC": 10}, {}, True),
        ("warmed up for ten minutes", {"prewarm_s": 600}, {}, False),
        ("flipped and warmed up", {"seating": "flipped", "prewarm_s": 600}, {"flipped": flipped}, False),
        (
            "turned, reversed, 10 °C warmer and warmed up",
            {"seating": "turned", "order": "reversed", "temperature_offset_degC": 10, "prewarm_s": 600},
            {"turned": turned},
            False,
        ),
        ("slow, flipped and warmed up", {"seating": "flipped", "prewarm_s": 600}, {"flipped": flipped}, True),
        (
            "slow, flipped, 10 °C warmer and warmed up",
            {"seating": "flipped", "prewarm_s": 600, "temperature_offset_degC": 10},
            {"flipped": flipped},
            True,
        ),
    ]
    for text, run, seats, slow in kinds:
        # A recipe has one dwell: what follows a slow run is slow too.
        dwell = _slow(now.dwells[0]) if slow else now.dwells[-1]
        if slow and dwell == now.dwells[-1]:
            continue
        words = f"one run {text}" + (f" (dwells of {dwell.time_s:g} s)" if slow else "")
        yield words, now.followed_by(Run(**run), seats, dwell)


def _slow(rule: DwellRule) -> DwellRule:
    """A dwell that is so much longer; an adaptive one stays."""
    if rule.time_s is None or rule.time_s >= SLOWEST_DWELL_S:
        return rule
    return DwellRule(time_s=min(SLOW_FACTOR * rule.time_s, SLOWEST_DWELL_S))
