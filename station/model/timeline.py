"""The timeline of a run: when the rig arrives at each visit, and how long it stays."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Array, Floats
from station.domain.planning import adaptive_dwell
from station.domain.recipe import plan
from station.domain.recipe.recipe import Recipe
from station.model.effect import stimulus_strength
from station.model.simulated_line import SimulatedLine

#: White noise of a device whose data sheet gives none, of the stimulus per √Hz: 100 µg/√Hz.
DEFAULT_NOISE_DENSITY = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class RunTimeline:
    """One run of the recipe as every unit lives it: names, arrivals (s from the run's start) and dwells of its visits
    (v)."""

    position: tuple[str, ...]
    arrival_s: Floats
    dwell_s: Floats
    duration_s: float
    seating: str
    prewarm_s: float
    offset_degC: float
    motors: bool
    swing_degC: float


def visit_dwells_s(recipe: Recipe) -> Floats:
    """How long each visit of all runs is measured, s; with `until_std` as long as the sheet's white noise needs."""
    return adaptive_dwell.planned_dwells_s(recipe, noise_density_of(recipe) ** 2 / 2)


def noise_density_of(recipe: Recipe) -> float:
    """White noise of the device, recipe's unit per √Hz."""
    sheet = recipe.device.noise_density
    return usual_noise_density(recipe) if sheet is None else sheet


def usual_noise_density(recipe: Recipe) -> float:
    """Taken where the sheet does not say, recipe's unit per √Hz."""
    return DEFAULT_NOISE_DENSITY * stimulus_strength(recipe)


def run_timeline(recipe: Recipe, run: int, line: SimulatedLine | None = None) -> RunTimeline:
    """The timeline of a pass; a repeated pass goes round again."""
    line = line or SimulatedLine()
    how = plan.run_of_pass(recipe, run)
    run %= len(recipe.runs)
    visits = plan.planned_visits(recipe, run) if recipe.pose_known else ()
    names, first = plan.names(recipe, run), plan.visit_index(recipe, run, 0)
    turns = np.full(len(names), 90.0)
    if len(visits) > 1 and recipe.reference.source != "rate":
        apart = np.stack([a.nest.T @ b.nest for a, b in pairwise(visits)])
        turns[1:] = np.rad2deg([np.linalg.norm(vector) for vector in rotation.to_vector(apart)])
    dwell_s = visit_dwells_s(recipe)[first : first + len(names)]
    leaves = np.cumsum([line.move_s(angle) for angle in turns.tolist()]) + np.cumsum(recipe.settle.time_s + dwell_s)
    return RunTimeline(
        names,
        leaves - recipe.settle.time_s - dwell_s,
        dwell_s,
        float(leaves[-1]),
        how.seating,
        how.prewarm_s,
        how.temperature_offset_degC,
        how.motors == "on",
        how.temperature_swing_degC,
    )


@dataclass(frozen=True, slots=True)
class FleetPart:
    """Units simulated together: the numbers `first`, `first` + 1, … of a fleet of `fleet`."""

    units: tuple[str, ...]
    first: int = 0
    fleet: int = 0

    def number(self) -> Array:
        """Place of each unit (U) in the fleet."""
        return np.arange(len(self.units)) + self.first

    def lot(self, lots: int) -> Array:
        """Which of so many lots each unit (U) is from; a fleet is split into lots in order."""
        return self.number() * lots // (self.fleet or len(self.units))
