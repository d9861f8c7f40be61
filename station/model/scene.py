"""What was done, when, and under which conditions: the visits, and the covariates of every sample.

A scene is made from a plan (`campaign.scene_of_plan`) or from a measured table (`scene_of_table`); the forward
simulation cannot tell which. Its rows may also stand for blocks of samples at their mean times.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats, Labels, SampleTable
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError
from station.model.likely_courses import TemperatureCourse
from station.model.temperature_course import temperature_courses
from station.model.turning_temperature import own_rates, with_own_rates
from station.model.visit_table import VisitTable, visit_table

#: Covariates of a sample, None in a scene where nobody recorded them.
COVARIATES = (
    "since_arrival_s",
    "temperature_degC",
    "temperature_rate",
    "since_power_s",
    "since_clamp_s",
    "motor",
    "started_s",
)


#: Two runs whose power-on is the same to within this belong to one power cycle, s.
POWER_ON_TOLERANCE_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Rows (n) at `visits` (v); visit (n) is the row's visit, time_s (n) counts from the start of the run.

    since_arrival_s (n) counts from the arrival at the visit; temperature_degC, temperature_rate (degC/s),
    since_power_s, since_clamp_s, motor (drive level), started_s (n), or None where not known.
    """

    recipe: Recipe
    visits: VisitTable
    visit: NDArray[np.intp]
    time_s: Floats
    since_arrival_s: Floats | None = None
    temperature_degC: Floats | None = None
    temperature_rate: Floats | None = None
    since_power_s: Floats | None = None
    since_clamp_s: Floats | None = None
    motor: Floats | None = None
    started_s: Floats | None = None

    def __len__(self) -> int:
        return len(self.visit)

    @staticmethod
    def of_units(recipe: Recipe, units: tuple[str, ...]) -> "Scene":
        """A scene of one visit for each unit, no samples taken: for what is known before anything is measured."""
        count = len(units)
        one = Labels((recipe.positions[0].name if recipe.positions else "any",), np.zeros(count, np.int32))
        code, zero = np.arange(count, dtype=np.int32), np.zeros(count, np.int32)
        visits = visit_table(recipe, Labels(units, code), zero, zero, {"position": one})
        return Scene(recipe, visits, np.zeros(0, np.intp), np.zeros(0))

    def of_rows(self, rows: slice) -> "Scene":
        """Some of the rows, at all visits."""
        covariates = {name: getattr(self, name) for name in ("visit", "time_s", *COVARIATES)}
        return replace(self, **{name: x[rows] for name, x in covariates.items() if x is not None})

    def of_runs(self, there: NDArray[np.bool_]) -> "Scene":
        """Some whole runs, by their visits, there (v), and their rows."""
        rows = there[self.visit]
        covariates = {name: getattr(self, name) for name in ("time_s", *COVARIATES)}
        kept = {name: x[rows] for name, x in covariates.items() if x is not None}
        visit = (np.cumsum(there) - 1)[self.visit[rows]]
        return replace(self, visits=self.visits.of_runs(there), visit=visit, **kept)

    def without_rows(self) -> "Scene":
        """The same visits and no samples: what is worth keeping of a part of a fleet."""
        return Scene(self.recipe, self.visits, np.zeros(0, np.intp), np.zeros(0))

    def group(self, level: str) -> tuple[NDArray[np.int32], tuple[str, ...]]:
        """Group codes (v) of the visits and the groups' names as docs/formats.md writes them: ("unit:SN1", …).

        level: common, unit, run, power-on, visit, run-of-recipe, nest, position, station, lot or operator. Where a
        table does not say the nest, station, lot or operator, all visits are one group, "common".
        """
        if level == "power-on":
            return power_cycles(self)
        return self.visits.group(level, len(self.recipe.runs))

    def codes(self, level: str) -> NDArray[np.int32]:
        """Group codes (v) alone, without the names, which take long to write."""
        return power_cycles(self)[0] if level == "power-on" else self.visits.codes(level, len(self.recipe.runs))

    def is_recorded(self, name: str) -> bool:
        """Whether this covariate, this label of the visits, or the gold was recorded."""
        if name == "gold":
            return self.visits.gold is not None
        return name in self.visits.groups if name not in COVARIATES else getattr(self, name) is not None

    def require(self, covariate: str) -> Floats:
        """A covariate (n); SamplesError when nobody recorded it."""
        values: Floats | None = getattr(self, covariate)
        if values is None:
            raise SamplesError("covariate-missing", column=covariate)
        return values


@dataclass(frozen=True, eq=False)
class Signal:
    """What the sensor feels: true (n, 3) in the device's frame; at_visit (v, 3) the resting vector of each visit.

    moving: whether any row differs from the resting vector of its visit; known_step (v, 3): see `step_of_visit`, where
    it is known already.
    """

    scene: Scene
    true: Floats
    at_visit: Floats
    moving: bool = False
    known_step: Floats | None = None

    def of_rows(self, rows: slice) -> "Signal":
        """What is felt at some of the rows."""
        return Signal(self.scene.of_rows(rows), self.true[rows], self.at_visit, self.moving, self.step_of_visit)

    @property
    def at_rest(self) -> "Signal":
        """What would be felt if nothing moved within the visits."""
        return Signal(self.scene, self.at_visit[self.scene.visit], self.at_visit, known_step=self.step_of_visit)

    @cached_property
    def step_of_visit(self) -> Floats:
        """Previous visit's resting vector minus this one's (v, 3); zero at the first visit of a run."""
        if self.known_step is not None:
            return self.known_step
        previous = self.scene.visits.previous
        return np.where(previous[:, None] >= 0, self.at_visit[previous] - self.at_visit, 0.0)

    @cached_property
    def step(self) -> Floats:
        """The same of each row (n, 3)."""
        return np.asarray(self.step_of_visit[self.scene.visit])


def power_cycles(scene: Scene) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Power cycle (v) of each visit and their names, "power-on:SN1/0", counted within a unit.

    A new one begins where `since_power_s` falls back, and with each run whose power-on is not the last run's by the
    clock of the campaign; where nobody recorded when a unit was powered, each run is one.
    """
    visits = scene.visits
    unit, first = visits.unit.code, visits.previous < 0
    begins = first.copy()
    if scene.since_power_s is not None and len(scene):
        rows = np.unique(scene.visit, return_index=True)[1]
        since = np.full(len(visits), np.nan)
        since[scene.visit[rows]] = scene.since_power_s[rows]
        begins[1:] |= ~first[1:] & (np.diff(since) < 0)
        if scene.started_s is not None:
            powered = np.full(len(visits), np.nan)
            powered[scene.visit[rows]] = (scene.started_s + scene.time_s - scene.since_power_s)[rows]
            same = np.abs(np.diff(powered)) < POWER_ON_TOLERANCE_S
            begins[1:] &= ~(first[1:] & same & (unit[1:] == unit[:-1]))
    code = np.cumsum(begins) - 1
    new_unit = np.flatnonzero(np.diff(unit, prepend=-1))
    within = code - np.repeat(code[new_unit], np.diff(np.append(new_unit, len(unit))))
    names = tuple(f"power-on:{visits.unit.names[unit[i]]}/{within[i]}" for i in np.flatnonzero(begins))
    return code.astype(np.int32), names


def scene_of_table(recipe: Recipe, table: SampleTable) -> Scene:
    """The scene of measured samples. SamplesError when a position or seating is not in the recipe."""
    scene = visits_scene_of_table(recipe, table)
    arrived = np.full(len(scene.visits), np.inf)
    np.minimum.at(arrived, scene.visit, table.time_s)
    known: dict[str, Any] = {k: table.values[k] for k in COVARIATES if k in table.values}
    if "temperature_degC" in known:
        rate = estimate_temperature_rate(known["temperature_degC"], scene)
        known["temperature_rate"] = rate
    since = table.time_s - arrived[scene.visit] + recipe.settle.time_s
    return replace(scene, since_arrival_s=since, **known)


def visits_scene_of_table(recipe: Recipe, table: SampleTable) -> Scene:
    """The same without covariates: what was done, and when."""
    first, visit = _first_rows(_key(np.stack([table.unit.code, table.run, table.visit])))
    at = table[first]
    labels = {name: label.used() for name, label in at.labels.items()}
    visits = visit_table(recipe, at.unit, at.run, at.visit, {**labels, "position": at.position})
    if recipe.reference.source == "gold" and table.gold is not None:
        visits = visits.with_gold(recipe, _means(table.gold, visit, len(visits)))
    return Scene(recipe, visits, visit, table.time_s)


def _key(codes: Array) -> NDArray[np.int64]:
    """One integer for each column of small non-negative integers (k, n), in lexical order."""
    key = np.zeros(codes.shape[1], np.int64)
    for row in codes:
        key = key * (int(row.max(initial=0)) + 1) + row
    return key


def _first_rows(key: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First row of each key (v) in the order of the keys, and the number of each row's (n)."""
    step = np.diff(key, prepend=key[0] - 1 if len(key) else 0)
    if np.all(step >= 0):
        return np.flatnonzero(step), np.cumsum(step > 0) - 1
    _, first, visit = np.unique(key, return_index=True, return_inverse=True)
    return first, visit


def _means(values: Floats, visit: NDArray[Any], visits: int) -> Floats:
    """Mean of the rows (n, k) of each visit (v, k)."""
    count = np.bincount(visit, minlength=visits)
    return np.stack([np.bincount(visit, column, visits) / count for column in values.T], 1)


def estimate_temperature_rate(temperature_degC: Floats, scene: Scene) -> Floats:
    """dT/dt (n) in degC/s: the slope of a smooth course through the visits' mean temperatures, and where it turns
    within a visit what the samples show."""
    count = len(scene.visits)
    mean = _means(np.stack([scene.time_s, temperature_degC], 1), scene.visit, count)
    slope = np.concatenate([c.slope for c in fit_temperature_courses(scene, mean[:, 0], mean[:, 1])])
    own = own_rates(temperature_degC, scene.time_s, scene.visit, count)
    return np.asarray(with_own_rates(slope, own)[scene.visit])


def fit_temperature_courses(
    scene: Scene, time_s: Floats, temperature_degC: Floats, since_power_s: Floats | None = None
) -> list[TemperatureCourse]:
    """The temperature's course in each run of a scene, from times and means (v) of its visits."""
    return temperature_courses(*runs_of_temperature(scene, time_s, temperature_degC, since_power_s))


def runs_of_temperature(
    scene: Scene, time_s: Floats, temperature_degC: Floats, since_power_s: Floats | None
) -> tuple[list[tuple[Floats, Floats]], list[Floats] | None, list[bool]]:
    """Times and means (v) of a scene's visits run by run, times since power-on, and whether the recipe makes the
    temperature rise and fall in it."""
    places = list(scene.visits.run_slices())
    since = None if since_power_s is None else [since_power_s[rows] for rows in places]
    swings = np.array([run.temperature_swing_degC != 0 for run in scene.recipe.runs])
    turning = swings[scene.codes("run-of-recipe")]
    runs = [(time_s[rows], temperature_degC[rows]) for rows in places]
    return runs, since, [bool(turning[rows.start]) for rows in places]
