"""What was measured, as a plan of the next run sees it, and how it would go on."""

from dataclasses import dataclass, field, replace

import numpy as np

from station.diagnosis.data.visit_means import visit_means
from station.diagnosis.data.visit_noise import MAD_PER_SIGMA
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.planning.bench import WarmingBench, warming_bench_of
from station.diagnosis.planning.plan import (
    PLANNING_RATE_HZ,
    PlannedCampaign,
    PlannedRuns,
    plan_runs,
    planned_problem,
    simulated_runs,
)
from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.search.alarm import NullDistribution
from station.domain.core.types import Array, Floats, Labels, SampleTable
from station.domain.recipe import plan
from station.domain.recipe.recipe import Recipe
from station.model.climate import Swing
from station.model.simulated_line import SimulatedLine

#: Units that a plan needs at most to know what more units would show.
MAX_PLANNED_UNITS = 6
#: How long units are away between the runs that were measured and the next, s.
AWAY_S = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredCampaign:
    """What was measured: the recipe, how many units through how many nests, the floor found, the bench, and samples of
    the runs, a few a second; None where they are not one pass of each of the recipe's runs.

    spread (3, 3): covariance of the floor's variances; alone: whether the tied causes are all that is in the readings;
    hidden: ids of the causes that these cannot show; null: what scores look like where nothing is wrong, None where
    any is beyond chance.
    """

    recipe: Recipe
    units: int
    nests: int
    floor: NoiseFloor
    bench: WarmingBench = field(default_factory=WarmingBench)
    samples: SampleTable | None = None
    spread: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    alone: bool = True
    hidden: tuple[str, ...] = ()
    null: NullDistribution | None = None
    #: Longer campaigns that were asked for already: what is rated is simulated next, and promised last.
    _longer: dict[tuple[int, bool], tuple[PlannedRuns, PlannedCampaign]] = field(
        default_factory=dict, init=False, repr=False
    )
    _drifting: "list[MeasuredCampaign]" = field(default_factory=list, init=False, repr=False)

    @property
    def known_runs(self) -> int:
        """How many runs are measured whose readings show one cause of a tie and nothing else."""
        return len(self.recipe.runs) if self.samples is not None and self.alone else 0

    @property
    def line(self) -> SimulatedLine:
        """The bench of a plan. A room that wanders would part what the next room, which stays calm, does not."""
        return replace(self.bench.line, nests=self.nests, wander_degC=0.0)

    @property
    def on_drifting_bench(self) -> "MeasuredCampaign | None":
        """The same on a bench that goes on as its room drifts; None where several runs say whether it begins anew with
        each power-on, or where none says how it warms."""
        if len(self.recipe.runs) > 1 or not len(self.bench.since_power_s):
            return None
        if not self._drifting:
            # One for all who ask: what was planned on it stays planned.
            self._drifting.append(replace(self, bench=replace(self.bench, goes_on=True)))
        return self._drifting[0]

    @property
    def in_one_nest(self) -> bool:
        """Whether nothing was measured in a second nest, and it is known in which one all was."""
        return self.nests == 1 and self.samples is not None and "nest" in self.samples.labels

    @property
    def elsewhere(self) -> bool:
        """Whether the plan reckons with a nest in which nothing was measured."""
        nest = None if self.samples is None else self.samples.labels.get("nest")
        return nest is not None and self.nests > len(nest.names)

    def gone_on(self, runs: PlannedRuns, *, exact: bool = False) -> PlannedCampaign:
        """The campaign with more runs: what was measured where and when it was, the rest as it is planned; exact: with
        a thermometer that shows the planned runs as warm as they are."""
        key = id(runs), exact
        if key not in self._longer:
            # The runs are kept, so that no other ones get their place.
            self._longer[key] = runs, self._planned(runs, exact=exact)
        return self._longer[key][1]

    def _planned(self, runs: PlannedRuns, *, exact: bool) -> PlannedCampaign:
        """The same, simulated anew."""
        if self.samples is None:
            return PlannedCampaign.of(plan_runs(runs, self.units, self.line).problem, self.floor)
        done = len(self.recipe.runs)
        before_s, all_s = (float(np.mean([d.longest_s for d in runs.dwells[:n]])) for n in (done, None))
        density = self.floor.noise * float(np.sqrt(2 * before_s))
        new = simulated_runs(runs, done, self.samples.unit.names, density, self.line) if runs.dwells[done:] else []
        if self.samples.values.get("temperature_degC") is not None:
            std = 0.0 if exact else _thermometer_std(self.samples)
            new = [_read_by_thermometer(part, self.bench, runs.recipe, std) for part in new]
        planned = [_next_of(self.samples, part, self.nests) for part in new]
        problem = planned_problem(runs.recipe, [self.samples, *planned])
        # The noise is that of a visit of usual length.
        return PlannedCampaign.of(
            problem, replace(self.floor, noise=self.floor.noise * float(np.sqrt(before_s / all_s)))
        )


def measured_campaign(d: Diagnosis) -> MeasuredCampaign:
    """What was measured, as a plan sees it."""
    visits = d.last.view.scene.visits
    nests = len(visits.group("nest", 1)[1]) if "nest" in visits.groups else 1
    units = min(len(d.samples.units), MAX_PLANNED_UNITS)
    # Scatter that is tied with a cause is none where the cause is true.
    tied = any(c.estimate is None and c.finding.indistinguishable_from for c in d.causes)
    fitted = d.search_result.first.fit() if tied else d.floor
    alone = len(d.causes) == 1 and not d.search_result.first.accepted
    bench = warming_bench_of(d.last.view.scene)
    spread, null = fitted.covariance, d.search_result.null
    return MeasuredCampaign(
        d.recipe, units, nests, fitted.floor, bench, _few_samples(d), spread, alone, d.not_testable, null
    )


def _few_samples(d: Diagnosis) -> SampleTable | None:
    """Means of the samples of the first units, a few a second."""
    table = next(iter(d.inspection.samples.portions()))
    table = table[table.unit.code < MAX_PLANNED_UNITS].used()
    begins = np.flatnonzero(_visit_begins(table))
    visits = np.array([len(plan.names(d.recipe, run)) for run in range(len(d.recipe.runs))])
    passes = len(np.unique(np.stack([table.unit.code[begins], table.run[begins]]), axis=1).T)
    whole = int(table.run.max()) + 1 == len(visits) and passes == len(visits) * len(table.unit.names)
    if not whole or np.any(table.visit >= visits[table.run]):
        return None
    within = np.arange(len(table)) - np.repeat(begins, np.diff(np.append(begins, len(table))))
    step_s = float(np.median(np.diff(table.time_s)[np.diff(within) > 0])) if len(table) > len(begins) else 1.0
    together = max(round(1 / max(step_s * PLANNING_RATE_HZ, 1e-9)), 1)
    if together == 1:
        return table
    # Means say of slow causes what all samples do.
    first = within % together == 0
    means = visit_means(table, np.cumsum(first) - 1)
    return replace(means, values={name: v[first] for name, v in table.values.items()} | dict(means.values))


def _visit_begins(table: SampleTable) -> Array:
    """Whether each row (n) is the first of a visit."""
    rows = np.stack([table.unit.code, table.run, table.visit])
    return np.asarray(np.any(np.diff(rows, axis=1, prepend=-1) != 0, axis=0))


def _next_of(samples: SampleTable, part: SampleTable, nests: int) -> SampleTable:
    """Simulated samples of later runs of the units: each goes on to the next of so many nests, after the last of what
    there is, and stays otherwise what it is."""
    last = np.array([np.flatnonzero(samples.unit.code == u)[-1] for u in range(len(samples.unit.names))])
    unit = np.array([samples.unit.names.index(name) for name in part.unit.names])[part.unit.code]
    labels = {k: Labels(v.names, v.code[last][unit]) for k, v in samples.labels.items()}
    if "nest" in labels:
        steps = part.run - samples.run[last][unit]
        nest = samples.labels["nest"]
        names = (*nest.names, *(f"nest {i + 1}" for i in range(len(nest.names), nests)))
        labels["nest"] = Labels(names, ((nest.code[last][unit] + steps) % len(names)).astype(np.int32))
    if "seating" in labels:
        labels["seating"] = part.labels["seating"]
    values = dict(part.values)
    if "started_s" in values and "started_s" in samples.values:
        end_s = float(np.max(samples.values["started_s"] + samples.time_s)) + AWAY_S
        values["started_s"] = values["started_s"] - float(np.min(values["started_s"])) + end_s
    return replace(part, labels=labels, values=values)


def _read_by_thermometer(part: SampleTable, bench: WarmingBench, recipe: Recipe, std_degC: float) -> SampleTable:
    """Simulated samples as warm as the bench is, which warms alone in a calm room, and a thermometer is off by from
    visit to visit."""
    heated = bench.warmed_degC(part.values["since_power_s"])
    offsets = np.array([run.temperature_offset_degC for run in recipe.runs])
    visit = np.cumsum(_visit_begins(part)) - 1
    error = std_degC * np.random.default_rng(1).standard_normal(int(visit[-1]) + 1)
    length_s = np.zeros(len(recipe.runs))
    np.maximum.at(length_s, part.run, part.time_s)
    swing = Swing(np.array([run.temperature_swing_degC for run in recipe.runs])[part.run], length_s[part.run])
    warm = bench.line.room_degC + offsets[part.run] + heated + swing.value(part.time_s) + error[visit]
    return replace(part, values={**part.values, "temperature_degC": warm})


def _thermometer_std(samples: SampleTable) -> float:
    """What the thermometer is off by from visit to visit, degC: by the second differences of the visits' means, which a
    room that warms evenly does not have."""
    begins = _visit_begins(samples)
    first, visit = np.flatnonzero(begins), np.cumsum(begins) - 1
    mean = np.bincount(visit, samples.values["temperature_degC"]) / np.bincount(visit)
    bend = np.abs(np.diff(mean, 2))[samples.visit[first][2:] >= 2]
    return float(np.median(bend)) / MAD_PER_SIGMA / float(np.sqrt(6)) if len(bend) else 0.0
