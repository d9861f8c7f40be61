"""What a recipe can and cannot tell apart, before anything is measured; and the next run that would.

A planned campaign is simulated without any cause; the bank then says how strong each cause would be at its usual
size (d) and which share of it no other cause could imitate (κ). Two causes are told apart where d·√κ is at least 3.3.
Noise is white, by the data sheet: a real floor adds to it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import erf

import numpy as np

from station.diagnosis.alike import APART_95, Axes, axes_of, share_outside
from station.diagnosis.bank import Candidate, candidates, library, testable
from station.diagnosis.floor import Floor
from station.diagnosis.problem import Allowance, problem_of
from station.diagnosis.reduce import reduce
from station.diagnosis.stage import Problem
from station.domain.recipe import Recipe, Run, Turn
from station.errors import RecipeError
from station.model.effect import Effect
from station.model.line import Line
from station.model.simulate import Job, simulate
from station.model.timeline import density_of, dwells_of, round_of

#: Samples a second that are enough to plan by: the noise of a mean follows from the density.
RATE_HZ = 20.0
#: Levels at which a cause acts only where it usually does.
RARE = ("run", "visit")
#: d from which a cause is found in 8 of 10 campaigns, 3 coefficients at 1 % (method notes, section 1).
FOUND = 3.93


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A campaign that was not measured, and the floor it would have."""

    problem: Problem
    floor: Floor

    def axes(self, candidate: Candidate) -> Axes:
        """What a candidate could move."""
        view = self.problem.view
        space = self.problem.space(self.floor, moving=True)
        hit = np.ones(len(candidate.names))
        if candidate.pattern == "scan":
            hit = (np.arange(len(hit)) == len(hit) // 2).astype(float)
        return axes_of(candidate, view, space, hit)


@dataclass(frozen=True, slots=True)
class Shown:
    """One cause: d at its usual size, the smallest size found, and d·√κ against every other cause by name."""

    effect: str
    typical: float
    unit: str
    d: float
    smallest: float
    apart: Mapping[str, float]

    @property
    def tied(self) -> tuple[str, ...]:
        """Causes it cannot be told from, the closest first; of one too weak to be found nothing is said."""
        if self.d < APART_95:
            return ()
        near = [name for name, x in self.apart.items() if x < APART_95]
        return tuple(sorted(near, key=lambda name: self.apart[name]))


@dataclass(frozen=True, slots=True)
class Apart:
    """What a recipe shows of so many units; hidden: causes that it cannot show at all."""

    units: int
    shown: tuple[Shown, ...]
    hidden: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Proposal:
    """One more run: the recipe with it, in words, which causes it separates, how surely, and how long it takes."""

    recipe: Recipe
    change: str
    separates: tuple[str, ...]
    certainty: float
    minutes: float


def planned(recipe: Recipe, units: int, seed: int = 1) -> Planned:
    """A campaign of a recipe as it is planned, without any cause."""
    density = density_of(recipe)
    slow = recipe.device.model_copy(update={"rate_hz": RATE_HZ, "noise_density": density, "lsb": 0.0})
    job = Job(recipe.model_copy(update={"device": slow}), tuple(f"unit-{i + 1}" for i in range(units)), seed)
    table = simulate(job).table
    problem = problem_of(reduce(job.recipe, table), Allowance.of(recipe, job.model))
    return Planned(problem, Floor(density / float(np.sqrt(2 * dwells_of(recipe).mean())), 0.0, 0.0))


def tell_apart(recipe: Recipe, units: int = 4) -> Apart:
    """What a recipe can and cannot tell apart at the causes' usual sizes."""
    bank = _bank(planned(recipe, units))
    effects = {e.id: e for e in library(recipe)}
    seen = {name: axes for name, axes in bank.items() if _largest(effects[name], recipe) * axes[0].length >= 1.0}
    shown = tuple(_shown(effects[name], recipe, seen) for name in seen)
    return Apart(units, shown, tuple(name for name in effects if name not in seen))


def _shown(effect: Effect, recipe: Recipe, seen: Mapping[str, Sequence[Axes]]) -> Shown:
    size = abs(effect.parameter.typical * effect.parameter.scale(recipe))
    axes = seen[effect.id][0]
    d = size * axes.length
    apart = {name: d * float(np.sqrt(_least(axes, others))) for name, others in seen.items() if name != effect.id}
    return Shown(effect.id, size, effect.parameter.unit_in(recipe.unit), d, FOUND / axes.length, apart)


def _largest(effect: Effect, recipe: Recipe) -> float:
    """The largest size met in practice."""
    p = effect.parameter
    return max(abs(p.low), abs(p.high)) * p.scale(recipe)


def _bank(plan: Planned, names: Sequence[str] | None = None) -> dict[str, list[Axes]]:
    """What each cause could move, at every shape and level; the first is the level at which the cause acts."""
    view = plan.problem.view
    found: dict[str, list[Axes]] = {}
    for effect in library(view.scene.recipe):
        if testable(effect, view) and (names is None or effect.id in names):
            # A coefficient of each run's own imitates any slow cause; that parsimony forbids it, no column shows.
            usual = [c for c in candidates(effect, view) if c.of not in RARE or c.of == effect.of[0]]
            found[effect.id] = [plan.axes(c) for c in usual]
    return {name: axes for name, axes in found.items() if axes}


def _least(found: Axes, others: Sequence[Axes]) -> float:
    """The smallest share of a cause outside what another could imitate, over its shapes and levels."""
    return min((share_outside(found, axes) for axes in others), default=1.0)


def propose(
    recipe: Recipe, units: int, ties: Mapping[str, Sequence[str]], sizes: Mapping[str, float]
) -> Proposal | None:
    """The shortest run that tells each named cause from those it is tied with, or else the one that does most.

    sizes: rms of the named causes' coefficients. None where no run of the menu brings them a step apart.
    """
    best: tuple[float, Proposal] | None = None
    for change, longer in menu(recipe):
        reached = _reached(longer, units, ties, sizes)
        proposal = Proposal(longer, change, _members(ties), _certainty(reached), _minutes(longer))
        rate = reached / proposal.minutes if reached < APART_95 else 1e3 + APART_95 / proposal.minutes
        if best is None or rate > best[0]:
            best = rate, proposal
    return best[1] if best is not None and best[1].certainty > 0.6 else None


def _reached(recipe: Recipe, units: int, ties: Mapping[str, Sequence[str]], sizes: Mapping[str, float]) -> float:
    """The smallest d·√κ of all pairs."""
    bank = _bank(planned(recipe, units), _members(ties))
    least = np.inf
    for name, others in ties.items():
        for other in others:
            if bank.get(name) and bank.get(other):
                axes = bank[name][0]
                least = min(least, sizes[name] * axes.length * float(np.sqrt(_least(axes, bank[other]))))
    return float(least) if np.isfinite(least) else 0.0


def _members(ties: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for key, others in ties.items() for name in (key, *others)))


def _certainty(reached: float) -> float:
    """Chance to name the right one of two."""
    return 0.5 * (1 + erf(reached / 2 / np.sqrt(2)))


def _minutes(recipe: Recipe) -> float:
    """How long the last run takes, the unit's change and warming included."""
    last = round_of(recipe, len(recipe.runs) - 1)
    return (last.duration_s + last.prewarm_s + Line().changeover_s) / 60


def menu(recipe: Recipe) -> Iterator[tuple[str, Recipe]]:
    """The recipe with one more run of each kind, the quickest to set up first."""
    turned, flipped = Turn(axis=(0, 0, 1), angle_deg=180), Turn(axis=(1, 0, 0), angle_deg=180)
    kinds = [
        ("once more in the next nest", Run(), {}),
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
        longer = recipe.model_dump(by_alias=True)
        longer["runs"] = [*(r.model_dump() for r in recipe.runs), run.model_dump()]
        longer["seatings"] = {k: v.model_dump() for k, v in ({**seats, **recipe.seatings}).items()}
        try:
            yield f"one run {told}", Recipe.model_validate(longer)
        except ValueError as exc:
            raise RecipeError(f"a run {told} cannot be added to recipe {recipe.name}: {exc}") from exc
