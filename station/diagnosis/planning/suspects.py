"""The causes of a tie as a plan sees them: each at the shapes at which it would look like the data so far."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from station.diagnosis.candidates.bank import Candidate, candidates, is_testable
from station.diagnosis.candidates.kernels import disturbed_readings
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.plan import RARE_LEVELS, PlannedCampaign, PlannedRuns
from station.diagnosis.planning.promise import TiedCauses
from station.diagnosis.search.distinguishability import SignatureAxes, distinct_share
from station.model.effect import Effect

#: Shapes at which a cause may be true that are planned for, and the odds to the likeliest below which one is not.
MOST_SHAPES, LEAST_ODDS = 4, 0.1
#: Causes of one tie that are planned for, the likeliest, and pairs of them in all ties: no run parts what could be
#: anything, and each pair costs as much.
MOST_MEMBERS, MOST_PAIRS = 6, 60


@dataclass(frozen=True, slots=True)
class CauseHypothesis:
    """A cause that it may be: at its shape, its level and the rms of its coefficients; its share of the chance that it
    is the cause at all, the rest being other shapes of it; free: whether it leaves any reading, not its effect's."""

    effect: Effect
    of: str
    size: float
    share: float = 1.0
    free: bool = False


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
    """The causes of a tie, the one found first, each at the shapes at which it would look like the data; how likely
    each is; all members of the tie, those without a course too; and hidden: causes that the readings so far could not
    show, which those of a longer campaign may be tied with."""

    causes: tuple[tuple[CauseHypothesis, ...], ...]
    tie: TiedCauses
    members: tuple[str, ...]
    hidden: tuple[str, ...] = ()


def suspects_of_all(campaign: MeasuredCampaign, ties: Sequence[CauseTie]) -> list[Suspects]:
    """Of each tie, but of those that no further run can show: a visit that was disturbed is disturbed once."""
    plan = campaign.gone_on(PlannedRuns.measured(campaign.recipe))
    out, pairs = list[Suspects](), 0
    for tie in map(_likeliest, ties):
        size = 1 + len(tie.others)
        if usual_shapes(plan, tie.found.effect.id) and (pairs + size * (size - 1) <= MOST_PAIRS or not out):
            out.append(suspects_of(campaign, tie))
            pairs += size * (size - 1)
    return out


def _likeliest(tie: CauseTie) -> CauseTie:
    """The tie without its least likely causes where it has very many."""
    others = sorted(tie.others, key=lambda name: -tie.probability.get(name, 0.0))[: MOST_MEMBERS - 1]
    return replace(tie, others=tuple(name for name in tie.others if name in others))


def suspects_of(campaign: MeasuredCampaign, tie: CauseTie) -> Suspects:
    """The found cause, and each of the others as it would have to be to look like it so far."""
    plan = campaign.gone_on(PlannedRuns.measured(campaign.recipe))
    own = usual_candidates(plan, tie.found.effect.id)
    found = axes_of(plan, tie.found, own)
    # The strength found is freed of what noise adds to a size, and is that of all units.
    known = np.isfinite(tie.d) and found.length > 0
    head = replace(tie.found, size=_size_of(tie.d, found, _most(own))) if known else tie.found
    strength = head.size * found.length
    numbers = [found.m.size]
    out = [_likely_shapes(head, found, own, strength)]
    for other in tie.others:
        every = [*(usual := usual_candidates(plan, other)), *shaped_like(plan, usual, tie.found.effect)]
        if every:
            # Of those that look alike the one of fewest coefficients: what others could be is not what they are.
            like, axes = min(every, key=lambda pair: (round(distinct_share(found, pair[1]), 1), pair[1].m.shape[-1]))
            effect = like.effect or library_effect(plan, other)
            assert effect is not None
            size = _size_of(strength, axes, _most(every))
            alike = CauseHypothesis(effect, like.of, size, free=like.effect is None)
            out.append(_likely_shapes(alike, found, every, strength))
            numbers.append(axes.m.size)
    names = tuple(shapes[0].effect.id for shapes in out)
    members = (tie.found.effect.id, *tie.others)
    hidden = tuple(name for name in campaign.hidden if name not in members)
    return Suspects(tuple(out), TiedCauses.of(names, tie.d, tie.probability, numbers), members, hidden)


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
    others = [CauseHypothesis(e, suspect.of, _size_of(strength, axes, _most(every)), w / total) for w, e, axes in near]
    return (replace(suspect, share=1.0 - sum(other.share for other in others)), *others)


def _size_of(strength: float, axes: SignatureAxes, most: float) -> float:
    """The size at which a cause is so strong, or the largest that is thinkable where these data hardly show it."""
    return min(strength / axes.length, most) if axes.length > 0 else 0.0


def _most(every: Sequence[CandidateAxes]) -> float:
    """The largest thinkable size of a cause in all its shapes."""
    return max((c.most for c, _ in every if c.effect is not None), default=np.inf)


def usual_candidates(plan: PlannedCampaign, name: str) -> list[CandidateAxes]:
    """A cause at every shape, and at every level at which it usually acts, with what it could move."""
    return [(c, plan.axes(c)) for c in usual_shapes(plan, name)]


def usual_shapes(plan: PlannedCampaign, name: str) -> list[Candidate]:
    """The same without the axes; a variance of the floor has neither shape nor level."""
    return plan.candidates_of(name, partial(_usual_shapes, plan, name))


def _usual_shapes(plan: PlannedCampaign, name: str) -> list[Candidate]:
    view = plan.problem.view
    effect = library_effect(plan, name)
    if effect is None or not is_testable(effect, view):
        return []
    free = [c for c in disturbed_readings(view) if c.name == name]
    usual = [c for c in candidates(effect, view) if c.of not in RARE_LEVELS or c.of == effect.of[0]]
    shaped = [plan.at_form(c, shape) for c in {c.of: c for c in usual}.values() for shape in _more_forms(effect)]
    return [*free, *usual, *shaped]


def library_effect(plan: PlannedCampaign, name: str) -> Effect | None:
    """A cause of the library that acts in this recipe; None where it has no course or does not."""
    return next((e for e in plan.library if e.id == name), None)


def causes_shown(plan: PlannedCampaign) -> list[str]:
    """Ids of the causes that a campaign could show."""
    return [e.id for e in plan.library if is_testable(e, plan.problem.view)]


def _more_forms(effect: Effect) -> Iterator[Effect]:
    """Time constants between those of the grid, and as far beyond its ends as a diagnosis would go."""
    for p in effect.forms:
        if p.name == "time_constant" and p.grid:
            ends = (0.5 * min(p.low, *p.grid), 2 * max(p.high, *p.grid))
            middles = (float(np.sqrt(a * b)) for a, b in pairwise(p.grid))
            yield from (replace(effect, **{p.field: value}) for value in (*ends, *middles))


def shaped_like(plan: PlannedCampaign, usual: Sequence[CandidateAxes], other: Effect) -> list[CandidateAxes]:
    """A cause at the shape of another one, which the steps of its grid may miss; nothing where they share no shape."""
    wanted = {p.field: getattr(other, p.field) for p in other.forms}
    levels = {c.of: c for c, _ in usual}.values()
    out = []
    for c in levels:
        shape = {p.field: wanted[p.field] for p in (c.effect.forms if c.effect else ()) if p.field in wanted}
        if c.effect is not None and shape:
            at = plan.at_form(c, replace(c.effect, **shape))
            out.append((at, plan.axes(at)))
    return out


def axes_of(plan: PlannedCampaign, suspect: CauseHypothesis, usual: Sequence[CandidateAxes]) -> SignatureAxes:
    """A suspect as the planned campaign would show it."""
    return plan.axes(suspect_candidate(plan, suspect, [c for c, _ in usual]))


def suspect_candidate(plan: PlannedCampaign, suspect: CauseHypothesis, usual: Sequence[Candidate]) -> Candidate:
    """A suspect as a candidate of the planned campaign, at its level if there is one."""
    alike = [c for c in usual if (c.effect is None) == suspect.free] or usual
    chosen = next((c for c in alike if c.of == suspect.of), alike[0])
    # One that may read anything has no shape.
    return chosen if chosen.effect is None else plan.at_form(chosen, suspect.effect)
