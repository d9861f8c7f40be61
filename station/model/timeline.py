"""The timeline of a run: when the rig arrives at each stop, and how long it stays."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from station.domain import plan, rotation
from station.domain.recipe import Recipe
from station.domain.types import Array, Floats
from station.model.effect import strength
from station.model.line import Line

#: Stops of a run whose recipe lists no positions, because a person holds the part in any pose.
STOPS_BY_HAND = 24
#: White noise of a device whose data sheet gives none, of the stimulus per √Hz: 100 µg/√Hz.
DENSITY = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """One run of the recipe as every unit lives it: names and arrivals (s from the run's start) of its stops."""

    position: tuple[str, ...]
    arrival_s: Floats
    dwell_s: float
    duration_s: float
    seating: str
    prewarm_s: float
    offset_degC: float
    motors: bool


def dwell_of(recipe: Recipe) -> float:
    """How long a stop is measured, s; `until_std` is reached when white noise has averaged down to it."""
    dwell = recipe.dwell
    if dwell.time_s is not None:
        return dwell.time_s
    wanted = 0.5 * (density_of(recipe) / (dwell.until_std or np.inf)) ** 2
    return float(np.clip(wanted, dwell.min_s, dwell.max_s))


def density_of(recipe: Recipe) -> float:
    """White noise of the device, recipe's unit per √Hz."""
    sheet = recipe.device.noise_density
    return DENSITY * strength(recipe) if sheet is None else sheet


def round_of(recipe: Recipe, run: int, line: Line | None = None) -> Round:
    """The timeline of a pass; a repeated pass goes round again."""
    line = line or Line()
    how = plan.of_run(recipe, run)
    stops = plan.stops(recipe, run % len(recipe.runs)) if recipe.pose_known else ()
    names = tuple(s.position for s in stops) or tuple(p.name for p in recipe.positions)
    names = names or tuple(f"hand-{i + 1}" for i in range(STOPS_BY_HAND))
    turns = [90.0] * len(names)
    for i, (a, b) in enumerate(pairwise(stops)):
        if recipe.reference.source != "rate":
            turns[i + 1] = float(np.rad2deg(np.linalg.norm(rotation.to_vector(a.nest.T @ b.nest))))
    stay = recipe.settle.time_s + dwell_of(recipe)
    moves = np.array([line.move_s(angle) for angle in turns])
    arrival = np.cumsum(moves) + stay * np.arange(len(names))
    return Round(
        names,
        arrival,
        dwell_of(recipe),
        float(arrival[-1] + stay),
        how.seating,
        how.prewarm_s,
        how.temperature_offset_degC,
        how.motors == "on",
    )


@dataclass(frozen=True, slots=True)
class Batch:
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
