"""The plan as it is lived through: when the rig arrives, how warm it is, who works, which motors run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from station.domain import plan, rotation
from station.domain.recipe import Recipe
from station.domain.types import Array, Floats, Labels
from station.model.climate import climate, drive
from station.model.effect import stream, strength
from station.model.line import Line
from station.model.scene import Scene
from station.model.visits import Visits, visits_of

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


def scene_of_plan(
    recipe: Recipe, units: Sequence[str] | Batch, seed: int, rate_hz: Floats | None = None, *, line: Line | None = None
) -> Scene:
    """The scene of a planned campaign: every unit goes once through every run of the recipe.

    rate_hz (U): true sample rates of the units, the data sheet's when left out.
    """
    line = line or Line()
    batch = units if isinstance(units, Batch) else Batch(tuple(units))
    rates = np.full(len(batch.units), recipe.device.rate_hz) if rate_hz is None else rate_hz
    rounds = [round_of(recipe, run, line) for run in range(len(recipe.runs))]
    visits = visits_of_plan(recipe, batch, rounds, line)
    if not recipe.pose_known:
        visits = replace(visits, nest_R=_by_hand(visits, seed))
    since = [_grid(recipe, done, rate) for rate in rates for done in rounds]
    arrival = np.tile(np.concatenate([done.arrival_s for done in rounds]), len(rates))
    count = np.repeat([len(s) for s in since], [len(done.position) for done in rounds] * len(rates))
    visit = np.repeat(np.arange(len(visits)), count)
    stops = [len(done.position) for done in rounds] * len(rates)
    since_arrival = np.concatenate([np.tile(s, n) for s, n in zip(since, stops, strict=True)])
    scene = Scene(recipe, visits, visit, arrival[visit] + since_arrival, since_arrival)
    return _conditions(scene, rounds, line, seed, batch.number()[visits.unit.code] // line.nests)


def _grid(recipe: Recipe, done: Round, rate_hz: float) -> Floats:
    """Sample times of one stop, s since arrival."""
    return recipe.settle.time_s + np.arange(max(1, round(done.dwell_s * rate_hz))) / rate_hz


def visits_of_plan(recipe: Recipe, batch: Batch, rounds: list[Round], line: Line) -> Visits:
    """Every stop of every unit, with who worked where."""
    units = len(batch.units)
    stops = [len(done.position) for done in rounds]
    unit = Labels(batch.units, np.repeat(np.arange(units, dtype=np.int32), sum(stops)))
    run = np.tile(np.repeat(np.arange(len(rounds), dtype=np.int32), stops), units)
    visit = np.tile(np.concatenate([np.arange(n, dtype=np.int32) for n in stops]), units)
    at = batch.number()[unit.code]
    labels = {
        "position": Labels.of(np.tile(np.concatenate([done.position for done in rounds]), units)),
        "seating": Labels.of(np.tile(np.repeat([done.seating for done in rounds], stops), units)),
        "station": _numbered("S", at // line.nests % line.stations),
        "nest": _numbered("N", (at + run) % line.nests),
        "lot": _numbered("L", batch.lot(line.lots)[unit.code]),
        "operator": _numbered("O", (at // line.nests + run) % line.operators),
    }
    return visits_of(recipe, unit, run, visit, labels)


def _numbered(letter: str, number: Array) -> Labels:
    """S1, S2, …"""
    return Labels.of([f"{letter}{int(n) + 1}" for n in number])


def _by_hand(visits: Visits, seed: int) -> Floats:
    """Any orientation at each stop (v, 3, 3): a person turned the part."""
    _, names = visits.group("visit", 1)
    q = np.array([stream(seed, "hand", name).standard_normal(4) for name in names])
    return np.array([rotation.from_quaternion(one) for one in q])


def _conditions(scene: Scene, rounds: list[Round], line: Line, seed: int, load: Array) -> Scene:
    """The same scene with what a thermometer, a clock and a motor drive would tell of it; load (v): fixture load."""
    visits, row = scene.visits, scene.visit
    lasts = np.array([r.prewarm_s + r.duration_s + line.changeover_s for r in rounds])
    begun = np.concatenate([[0.0], np.cumsum(lasts)])
    prewarm = np.array([r.prewarm_s for r in rounds])[visits.run]
    offset = np.array([r.offset_degC for r in rounds])[visits.run]
    started = line.changeover_s + load * begun[-1] + begun[visits.run] + prewarm
    known = climate(scene.time_s, started[row], prewarm[row], offset[row], line=line, seed=seed)
    return replace(scene, motor=_motor(visits, load, rounds, seed)[row], **known)


def _motor(visits: Visits, load: Array, rounds: list[Round], seed: int) -> Floats:
    """Drive level (v) of the line's motors: another at each stop, the same for all units of a fixture load."""
    on = np.array([r.motors for r in rounds])[visits.run]
    key, inverse = np.unique(np.stack([load, visits.run, visits.visit]), axis=1, return_inverse=True)
    level = np.array([drive(seed, *k) for k in key.T])
    return np.where(on, level[inverse], 0.0)
