"""What the direction of a gold reference's reading tells of causes that the units alone cannot tell apart.

A gold that sits in the nest beside the units feels what turns base, fixture and nest, and nothing of how a sensor sits
in its unit. Where its certificate states how well its axes agree with the nest's (`seat_std_deg`), its directions are
projected on the turns that a found cause makes: the share β is 1 for what turns the nest, 0 for what turns the sensor.
Its spread holds the gold's seat, one turn for all visits, and its offset. Two normal hypotheses: ln L₁/L₀ =
(β² − (β − 1)²) / 2σ².
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from station import plugins
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.data.faults import gold_reference
from station.diagnosis.search.cause_search import SearchResult
from station.diagnosis.search.finding import CauseFinding
from station.diagnosis.search.form_check import in_place_of
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.effect import PoseEffect, SensorEffect
from station.model.forward import ActiveEffects, resting_stimulus
from station.model.scene import Scene, visits_scene_of_table

#: Nats by which one side must lead, 99 of 100, and how far, in standard deviations, β may be off it.
LEAST_NATS, MOST_OFF = 4.6, 3.3
#: Turns add up and bend a little: β is no better than this.
SHARE_STD = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class GoldDirections:
    """apart (v, 3): by how much the gold's direction is off the nominal one in the nest's frame, times the stimulus;
    noise: its standard deviation; seat_std rad; offset_std in the recipe's unit."""

    scene: Scene
    apart: Floats
    noise: float
    seat_std: float
    offset_std: float

    def share(self, active: ActiveEffects) -> tuple[float, float]:
        """β of the turns that causes make, and its standard deviation; endless where they make none."""
        visits = self.scene.visits
        turned = resting_stimulus(self.scene, active) - resting_stimulus(self.scene)
        nominal = np.einsum("vji,vj->vi", visits.nest_R, visits.stimulus)
        along = nominal / np.linalg.norm(nominal, axis=1, keepdims=True)
        turned = _across(np.einsum("vij,vj->vi", visits.seat_R, turned), along)
        squares = float(np.sum(turned**2))
        if not squares > 0:
            return 0.0, np.inf
        seat = [np.sum(np.cross(axis, nominal) * turned) * self.seat_std for axis in np.eye(3)]
        offset = [
            np.sum(_across(np.tile(axis, (len(along), 1)), along) * turned) * self.offset_std for axis in np.eye(3)
        ]
        variance = float(np.sum(np.square([*seat, *offset]))) / squares**2 + self.noise**2 / squares + SHARE_STD**2
        return float(np.sum(self.apart * turned)) / squares, float(np.sqrt(variance))


def gold_directions(recipe: Recipe, table: SampleTable) -> GoldDirections | None:
    """The gold's directions at the visits of a table; None without a gold whose certificate states its seat, and where
    the gold is the truth, so that nothing is told beside it."""
    own, source = recipe.reference.gold, recipe.reference.source
    if table.gold is None or own is None or own.seat_std_deg is None:
        return None
    if source in ("gold", "rate") or not recipe.pose_known or recipe.converts:
        return None
    scene = visits_scene_of_table(recipe, table)
    reading, variance = gold_reference.calibrated_means(recipe, table, scene.visit)
    nominal = np.einsum("vji,vj->vi", scene.visits.nest_R, scene.visits.stimulus)
    length = np.linalg.norm(nominal, axis=1, keepdims=True)
    along = nominal / length
    apart = _across(reading / np.linalg.norm(reading, axis=1, keepdims=True) * length, along)
    offset_std = own.offset_std or gold_reference.OFFSET_STD * float(length.mean())
    noise = float(np.sqrt(variance.mean()))
    return GoldDirections(scene, apart, noise, float(np.deg2rad(own.seat_std_deg)), offset_std)


def settle(searched: SearchResult, gold: GoldDirections | None) -> SearchResult:
    """The search with those of its ties decided that the gold's direction decides."""
    if gold is None:
        return searched
    place, findings = len(searched.first.accepted), list[CauseFinding]()
    for found in searched.findings:
        if found.accepted is None:
            findings.append(found)
            continue
        searched, settled = _settled(searched, found, place, gold)
        findings.append(settled)
        place += 1
    return replace(searched, findings=tuple(findings))


def _settled(
    searched: SearchResult, finding: CauseFinding, place: int, gold: GoldDirections
) -> tuple[SearchResult, CauseFinding]:
    """One finding, that at a place in the last problem, without the causes that the gold speaks against."""
    members = (finding.name, *finding.indistinguishable_from)
    turns_nest = {name: side for name in members if (side := _turns_nest(name)) is not None}
    if finding.name not in turns_nest or len(set(turns_nest.values())) < 2:
        return searched, finding
    told = _told(searched.last.accepted[place], gold)
    if told is None:
        return searched, finding
    kept = [name for name in members if turns_nest.get(name, told) == told]
    item = searched.last.accepted[place]
    if finding.name not in kept:
        best = max((n for n in kept if n in turns_nest), key=lambda n: finding.evidence.get(n, -np.inf))
        swapped = in_place_of(searched.last, place, best)
        if swapped is None:
            return searched, finding
        searched, item = replace(searched, last=swapped), swapped.accepted[place]
        kept = [best, *(n for n in kept if n != best)]
    return searched, _only(finding, item, kept, members)


def _only(finding: CauseFinding, item: AcceptedCause, kept: Sequence[str], members: Sequence[str]) -> CauseFinding:
    """The finding with the first of the causes kept, and the others beside it; they share what the set had."""
    whole, left = (sum(finding.probability.get(n, 0.0) for n in names) for names in (members, kept))
    probability = dict(finding.probability)
    for name in members:
        share = probability.get(name, 0.0) / left if left > 0 else float(name == kept[0])
        probability[name] = whole * share if name in kept else 0.0
    return replace(
        finding, name=kept[0], accepted=item, probability=probability, indistinguishable_from=tuple(kept[1:])
    )


def _told(item: AcceptedCause, gold: GoldDirections) -> bool | None:
    """Whether the gold turns as the cause has it; None where it tells neither."""
    share, std = gold.share(item.active_effects())
    nats = (share**2 - (share - 1) ** 2) / (2 * std**2)
    turns = nats > 0
    return turns if abs(nats) > LEAST_NATS and abs(share - turns) < MOST_OFF * std else None


def _turns_nest(name: str) -> bool | None:
    """Whether a cause turns what the gold sits in, or acts in the unit alone; None of one that does neither."""
    kind = plugins.load_all("station.model.effects").get(name)
    if kind is None or not issubclass(kind, PoseEffect | SensorEffect):
        return None
    return issubclass(kind, PoseEffect) and kind.frame != "device"


def _across(values: Floats, along: Floats) -> Floats:
    """Values (v, 3) without what lies along unit vectors (v, 3)."""
    return np.asarray(values - np.sum(values * along, axis=1, keepdims=True) * along)
