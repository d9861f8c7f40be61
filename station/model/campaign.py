"""The plan as it is lived through: who worked where, how warm it was, which motors ran, when each sample was taken."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core import rotation
from station.domain.core.types import Array, Floats, Labels
from station.domain.recipe.recipe import Recipe
from station.model.climate import Swing, climate, motor_level
from station.model.effect import random_stream
from station.model.scene import Scene
from station.model.simulated_line import SimulatedLine
from station.model.timeline import FleetPart, RunTimeline, run_timeline
from station.model.visit_table import VisitTable, visit_table

RowIndex = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """Every unit of a batch goes once through every run of the recipe; visits (v) hold all visits."""

    recipe: Recipe
    part: FleetPart
    line: SimulatedLine
    seed: int
    rounds: tuple[RunTimeline, ...]
    visits: VisitTable

    def arrival_s(self) -> Floats:
        """Arrival at each visit (v), s from the start of its run."""
        return np.tile(np.concatenate([done.arrival_s for done in self.rounds]), len(self.part.units))

    def started_s(self) -> Floats:
        """Start of each visit's run (v) on the one clock of the fleet, s."""
        lasts = np.array([r.prewarm_s + r.duration_s + self.line.changeover_s for r in self.rounds])
        begun = np.concatenate([[0.0], np.cumsum(lasts)])
        run = self.visits.run
        prewarm = np.array([r.prewarm_s for r in self.rounds])[run]
        return np.asarray(self.line.changeover_s + self._load_index() * begun[-1] + begun[run] + prewarm)

    def dwell_s(self) -> Floats:
        """How long each visit (v) is measured, s."""
        return np.tile(np.concatenate([done.dwell_s for done in self.rounds]), len(self.part.units))

    def dwells(self, rate_hz: Floats) -> Scene:
        """The samples of the dwells; rate_hz (U): true sample rates."""
        since = [self._grid(float(stay_s), rate) for rate in rate_hz for done in self.rounds for stay_s in done.dwell_s]
        return self.scene(np.repeat(np.arange(len(self.visits)), [len(s) for s in since]), np.concatenate(since))

    def scene(self, visit: RowIndex, since_arrival_s: Floats) -> Scene:
        """Samples (n) at visits; since_arrival_s (n) is negative on the way there."""
        time_s = self.arrival_s()[visit] + since_arrival_s
        run = self.visits.run[visit]
        powered = np.array([r.prewarm_s for r in self.rounds])[run] + self.line.power_lead_s
        clamped = np.full(len(visit), self.line.clamp_lead_s)
        offset = np.array([r.offset_degC for r in self.rounds])[run]
        swing = Swing(*np.array([(r.swing_degC, r.duration_s) for r in self.rounds])[run].T)
        started_s = self.started_s()[visit]
        known = climate(time_s, started_s, powered, clamped, offset, swing, line=self.line, seed=self.seed)
        since = np.maximum(since_arrival_s, 0.0)
        return Scene(self.recipe, self.visits, visit, time_s, since, motor=self._motor_level()[visit], **known)

    def _grid(self, dwell_s: float, rate_hz: float) -> Floats:
        """Sample times of one dwell, s since arrival."""
        return self.recipe.settle.time_s + np.arange(max(1, round(dwell_s * rate_hz))) / rate_hz

    def _load_index(self) -> Array:
        """Which load of the fixture each visit (v) belongs to."""
        return self.part.number()[self.visits.unit.code] // self.line.nests

    def _motor_level(self) -> Floats:
        """Drive level (v) of the line's motors: another at each visit, the same for all units of a fixture load."""
        visits = self.visits
        on = np.array([r.motors for r in self.rounds])[visits.run]
        key, inverse = np.unique(np.stack([self._load_index(), visits.run, visits.visit]), axis=1, return_inverse=True)
        level = np.array([motor_level(self.seed, *k) for k in key.T])
        return np.where(on, level[inverse], 0.0)


def campaign_of(
    recipe: Recipe, units: Sequence[str] | FleetPart, seed: int, line: SimulatedLine | None = None
) -> Campaign:
    """The campaign that a recipe plans for these units."""
    line = line or SimulatedLine()
    part = units if isinstance(units, FleetPart) else FleetPart(tuple(units))
    rounds = tuple(run_timeline(recipe, run, line) for run in range(len(recipe.runs)))
    visits = _visits(recipe, part, rounds, line)
    if not recipe.pose_known:
        visits = replace(visits, nest_R=_random_orientations(visits, seed))
    return Campaign(recipe, part, line, seed, rounds, visits)


def scene_of_plan(recipe: Recipe, units: Sequence[str], seed: int, line: SimulatedLine | None = None) -> Scene:
    """The dwells of a planned campaign whose devices sample at the rate of their data sheet."""
    return campaign_of(recipe, units, seed, line).dwells(np.full(len(units), recipe.device.rate_hz))


def _visits(recipe: Recipe, part: FleetPart, rounds: Sequence[RunTimeline], line: SimulatedLine) -> VisitTable:
    """Every visit of every unit, with who worked where."""
    units = len(part.units)
    counts = [len(done.position) for done in rounds]
    unit = Labels(part.units, np.repeat(np.arange(units, dtype=np.int32), sum(counts)))
    run = np.tile(np.repeat(np.arange(len(rounds), dtype=np.int32), counts), units)
    visit = np.tile(np.concatenate([np.arange(n, dtype=np.int32) for n in counts]), units)
    at = part.number()[unit.code]
    labels = {
        "position": Labels.of(np.tile(np.concatenate([done.position for done in rounds]), units)),
        "seating": Labels.of(np.tile(np.repeat([done.seating for done in rounds], counts), units)),
        "station": _numbered("S", at // line.nests % line.stations),
        "nest": _numbered("N", (at + run) % line.nests),
        "lot": _numbered("L", part.lot(line.lots)[unit.code]),
        "operator": _numbered("O", (at // line.nests + run) % line.operators),
    }
    return visit_table(recipe, unit, run, visit, labels)


def _numbered(letter: str, number: Array) -> Labels:
    """S1, S2, …"""
    return Labels.of([f"{letter}{int(n) + 1}" for n in number])


def _random_orientations(visits: VisitTable, seed: int) -> Floats:
    """Any orientation at each visit (v, 3, 3): a person turned the part."""
    _, names = visits.group("visit", 1)
    q = np.array([random_stream(seed, "hand", name).standard_normal(4) for name in names])
    return np.array([rotation.from_quaternion(one) for one in q])
