"""What a recipe can and cannot tell apart, before anything is measured.

A planned campaign is simulated without any cause; the bank then says how strong each cause would be at its usual
size (d) and which share of it no other cause could imitate (κ). Two causes are told apart where d·√κ is at least 3.3.
Noise is white, by the data sheet: a real floor adds to it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from station.diagnosis.candidates.bank import Candidate, candidates, cause_library, is_testable
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.distinguishability import (
    SEPARATION_95,
    SignatureAxes,
    distinct_share,
    has_covariate_error,
    signature_axes,
)
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.joined_tables import join
from station.domain.core.types import SampleTable
from station.domain.recipe.blocks import DwellRule, Run
from station.domain.recipe.position import Position, Turn
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from station.model.effect import Effect
from station.model.model_file import Model
from station.model.scene import visits_scene_of_table
from station.model.simulate import SimulationJob, simulate
from station.model.simulated_line import SimulatedLine
from station.model.timeline import noise_density_of, usual_noise_density, visit_dwells_s

#: Samples a second that are enough to plan by: the noise of a mean follows from the density.
PLANNING_RATE_HZ = 20.0
#: Levels at which a cause acts only where it usually does.
RARE_LEVELS = ("run", "power-on", "visit")
#: d from which a cause is found in 8 of 10 campaigns, 3 coefficients at 1 % (docs/diagnosis.md).
DETECTABLE_D = 3.93


@dataclass(frozen=True, eq=False)
class PlannedCampaign:
    """A campaign that was not measured, the floor it would have, and the space of that."""

    problem: ScoringProblem
    floor: NoiseFloor
    space: ResidualSpace
    #: Of causes at shapes that were asked for already: each is asked for at every level.
    _columns: dict[Effect, CauseColumns] = field(default_factory=dict, init=False, repr=False)
    #: Candidates of each cause that was asked for already, by its id.
    _candidates: dict[str, list[Candidate]] = field(default_factory=dict, init=False, repr=False)

    @staticmethod
    def of(problem: ScoringProblem, floor: NoiseFloor) -> "PlannedCampaign":
        """The campaign under a floor."""
        return PlannedCampaign(problem, floor, problem.space(floor, moving=True))

    @cached_property
    def library(self) -> tuple[Effect, ...]:
        """Every cause that can act in its recipe."""
        return cause_library(self.problem.view.scene.recipe)

    def candidates_of(self, name: str, found: Callable[[], list[Candidate]]) -> list[Candidate]:
        """The candidates of a cause, found once."""
        if name not in self._candidates:
            self._candidates[name] = found()
        return self._candidates[name]

    def at_form(self, candidate: Candidate, effect: Effect) -> Candidate:
        """A candidate at another shape: it is the same at all levels."""
        if effect not in self._columns:
            self._columns[effect] = CauseColumns.of(*self.problem.view.signature(effect))
        return replace(candidate, effect=effect, columns=self._columns[effect])

    def axes(self, candidate: Candidate) -> SignatureAxes:
        """What a candidate could move; what its covariate may be off by is no column of any size."""
        candidate = candidate.plain if candidate.plain and has_covariate_error(candidate) else candidate
        hit = np.ones(len(candidate.names))
        if candidate.pattern == "scan":
            hit = (np.arange(len(hit)) == len(hit) // 2).astype(float)
        return signature_axes(candidate, self.problem.view.layout, self.space, hit)


@dataclass(frozen=True, slots=True)
class CauseSeparability:
    """One cause: d at its usual size, the smallest size found, and d·√κ against every other cause by name."""

    effect: str
    typical: float
    unit: str
    d: float
    smallest: float
    apart: Mapping[str, float]

    @property
    def indistinguishable_from(self) -> tuple[str, ...]:
        """Causes it cannot be told from, the closest first; of one too weak to be found nothing is said."""
        if self.d < SEPARATION_95:
            return ()
        near = [name for name, x in self.apart.items() if x < SEPARATION_95]
        return tuple(sorted(near, key=lambda name: self.apart[name]))


@dataclass(frozen=True, slots=True)
class RecipeSeparability:
    """What a recipe shows of so many units; hidden: causes that it cannot show at all."""

    units: int
    shown: tuple[CauseSeparability, ...]
    hidden: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PlannedRuns:
    """A recipe whose runs dwell differently: the rule of each run."""

    recipe: Recipe
    dwells: tuple[DwellRule, ...]

    @staticmethod
    def measured(recipe: Recipe) -> "PlannedRuns":
        """All runs as the recipe dwells."""
        return PlannedRuns(recipe, (recipe.dwell,) * len(recipe.runs))

    def followed_by(
        self, run: Run, seats: Mapping[str, Turn], dwell: DwellRule, more: Sequence[Position] = ()
    ) -> "PlannedRuns":
        """With one more run, and perhaps more positions; the recipe then dwells as that run does. Errors: RecipeError
        where it cannot be added."""
        longer = self.recipe.model_dump(by_alias=True)
        if more:
            longer["positions"] = [p.model_dump() for p in (*self.recipe.positions, *more)]
            # Six points are the faces and nothing else.
            longer["method"] = "n-point" if self.recipe.method == "six-point" else self.recipe.method
        longer["runs"] = [*(r.model_dump() for r in self.recipe.runs), run.model_dump()]
        longer["seatings"] = {k: v.model_dump() for k, v in {**seats, **self.recipe.seatings}.items()}
        longer["dwell"] = dwell.model_dump()
        try:
            return PlannedRuns(Recipe.model_validate(longer), (*self.dwells, dwell))
        except ValueError as exc:
            raise RecipeError("next-run-impossible", recipe=self.recipe.name, reason=str(exc)) from exc


def plan_campaign(recipe: Recipe, units: int, line: SimulatedLine | None = None, seed: int = 1) -> PlannedCampaign:
    """A campaign of a recipe as it is planned, without any cause, under white noise of the data sheet."""
    return plan_runs(PlannedRuns.measured(recipe), units, line, seed)


def plan_runs(runs: PlannedRuns, units: int, line: SimulatedLine | None = None, seed: int = 1) -> PlannedCampaign:
    """The same where runs dwell differently."""
    density = _density_to_plan_with(runs.recipe)
    serials = tuple(f"unit-{i + 1}" for i in range(units))
    problem = planned_problem(runs.recipe, simulated_runs(runs, 0, serials, density, line or SimulatedLine(), seed))
    dwell_s = visit_dwells_s(runs.recipe).mean()
    return PlannedCampaign.of(problem, NoiseFloor(density / float(np.sqrt(2 * dwell_s)), 0.0, 0.0))


def planned_problem(recipe: Recipe, parts: Sequence[SampleTable]) -> ScoringProblem:
    """The problem that samples pose before any cause is known, each visit as certain as it is long: parts may have
    other rates."""
    table = join(parts)
    table = table[np.lexsort((table.time_s, table.run, table.unit.code))]
    reduced = reduce_samples(recipe, table)
    samples, visit = reduced.count.sum(1), visits_scene_of_table(recipe, table).visit
    first = np.searchsorted(visit, np.arange(len(samples)))
    last = np.append(first[1:], len(visit)) - 1
    dwell_s = (table.time_s[last] - table.time_s[first]) * samples / np.maximum(samples - 1, 1)
    share = dwell_s / samples * samples.sum() / max(float(dwell_s.sum()), 1e-300) if np.all(samples > 1) else 1.0
    # The time of a visit says all: how much its samples scatter goes with their rate.
    share = np.broadcast_to(share, samples.shape)
    reduced = replace(
        reduced,
        count=reduced.count * share[:, None],
        contrast=reduced.contrast * np.sqrt(share)[:, None, None],
        sigma=reduced.sigma * float(np.sqrt(np.mean(reduced.excess.mean(1) * share))),
        excess=np.ones_like(reduced.excess),
        axis_excess=np.ones_like(reduced.axis_excess),
        axis_correlation=np.eye(3),
    )
    return initial_problem(reduced, FloorAllowance.of(recipe, Model()))


def simulated_runs(
    runs: PlannedRuns, first: int, serials: tuple[str, ...], density: float, line: SimulatedLine, seed: int = 1
) -> list[SampleTable]:
    """Samples of the runs from `first` on, without any cause, under white noise; those that dwell alike together."""
    sheet = runs.recipe.device.model_copy(update={"noise_density": density, "lsb": 0.0})
    parts = []
    for dwell in dict.fromkeys(runs.dwells[first:]):
        # A longer dwell needs no more samples: the noise of its mean follows from the density.
        rate_hz = PLANNING_RATE_HZ / max(dwell.time_s or 1.0, 1.0)
        device = sheet.model_copy(update={"rate_hz": rate_hz})
        job = SimulationJob(runs.recipe.model_copy(update={"dwell": dwell, "device": device}), serials, seed, line=line)
        table = simulate(job).table
        chosen = [r for r, d in enumerate(runs.dwells) if d == dwell and r >= first]
        parts.append(table[np.isin(table.run, chosen)])
    return parts


def _density_to_plan_with(recipe: Recipe) -> float:
    """White noise of the sheet; where that says 0, of its rounding, and without that the usual one."""
    device = recipe.device
    of_rounding = device.lsb / float(np.sqrt(6 * device.rate_hz))
    return noise_density_of(recipe) or of_rounding or usual_noise_density(recipe)


def recipe_separability(recipe: Recipe, units: int = 4) -> RecipeSeparability:
    """What a recipe can and cannot tell apart at the causes' usual sizes."""
    bank = _bank(plan_campaign(recipe, units))
    effects = {e.id: e for e in cause_library(recipe)}
    detectable = {name: axes for name, axes in bank.items() if _largest(effects[name], recipe) * axes[0].length >= 1.0}
    shown = tuple(_cause_separability(effects[name], recipe, detectable) for name in detectable)
    return RecipeSeparability(units, shown, tuple(name for name in effects if name not in detectable))


def _cause_separability(
    effect: Effect, recipe: Recipe, detectable: Mapping[str, Sequence[SignatureAxes]]
) -> CauseSeparability:
    size = abs(effect.parameter.typical * effect.parameter.scale(recipe))
    axes = detectable[effect.id][0]
    d = size * axes.length
    apart = {
        name: d * float(np.sqrt(least_distinct_share(axes, others)))
        for name, others in detectable.items()
        if name != effect.id
    }
    return CauseSeparability(
        effect.id, size, effect.parameter.unit_in(recipe.unit), d, DETECTABLE_D / axes.length, apart
    )


def _largest(effect: Effect, recipe: Recipe) -> float:
    """The largest size met in practice."""
    p = effect.parameter
    return max(abs(p.low), abs(p.high)) * p.scale(recipe)


def _bank(plan: PlannedCampaign) -> dict[str, list[SignatureAxes]]:
    """What each cause could move, at every shape and level, the one to speak of first."""
    view = plan.problem.view
    found: dict[str, list[SignatureAxes]] = {}
    for effect in cause_library(view.scene.recipe):
        if is_testable(effect, view):
            # A coefficient of each run's own imitates any slow cause; that parsimony forbids it, no column shows.
            usual = [c for c in candidates(effect, view) if c.of not in RARE_LEVELS or c.of == effect.of[0]]
            found[effect.id] = _ordered(effect, usual, [plan.axes(c) for c in usual], view.scene.recipe)
    return {name: axes for name, axes in found.items() if axes}


def _ordered(
    effect: Effect, usual: Sequence[Candidate], axes: list[SignatureAxes], recipe: Recipe
) -> list[SignatureAxes]:
    """The axes, first those of the usual shape at the usual level; or of the shape that shows most, where even the
    largest size would not show at the usual one: after a long settling time only a slow cause is left."""
    own = [i for i, c in enumerate(usual) if (c.of, c.pattern) == (usual[0].of, usual[0].pattern)]
    if not own:
        return axes
    first = min(own, key=lambda i: _distance_from_typical(usual[i].effect or effect))
    if _largest(effect, recipe) * axes[first].length < 1.0:
        first = max(own, key=lambda i: axes[i].length)
    return [axes[first], *(a for i, a in enumerate(axes) if i != first)]


def _distance_from_typical(shaped: Effect) -> float:
    """How far the parameters of a form are from their usual values, as ratios."""
    off = 0.0
    for p in shaped.forms:
        value = float(getattr(shaped, p.field))
        off += abs(float(np.log(value / p.typical))) if value > 0 and p.typical > 0 else float(value != p.typical)
    return off


def least_distinct_share(found: SignatureAxes, others: Sequence[SignatureAxes]) -> float:
    """The smallest share of a cause outside what another could imitate, over its shapes and levels."""
    return min((distinct_share(found, axes) for axes in others), default=1.0)
