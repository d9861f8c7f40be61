"""How the processor's time of a diagnosis grows with the visits of one unit in one run, and what many runs cost."""

import time
from dataclasses import replace

import numpy as np
from diagnosis_rows.figures import Figure, at_most

from station.config.recipes import load_recipe
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.recipe.plan import planned_visits
from station.domain.recipe.recipe import Recipe
from tests.blind.inspection import diagnosis_of

#: Visits and samples of each.
LENGTHS, SAMPLES = (720, 5000), 100
#: Goals, s of processor.
MOST_S = {720: 5.0, 5000: 40.0}
#: Visits in runs of so many each, the goal, s, and how often it is measured.
IN_RUNS, A_RUN, RUNS_MOST_S, TIMES = 720, 24, 5.0, 3
#: A cube of the input on each axis, noise of a sample, both in g.
CUBIC, NOISE = 3e-4, 7e-4
#: Visits of one reading each, of a part in a hand, and the goal, s.
SINGLE, SINGLE_MOST_S = 1200, 5.0


def long_runs(seed: int) -> list[Figure]:
    """Seconds for one unit of so many visits, null distributions kept, and the power of the visits that they follow;
    for one in many runs; and for single readings."""
    recipe, spent = load_recipe("tilt-24"), list[float]()
    figures: list[Figure] = []
    for visits in LENGTHS:
        spent.append(_seconds(recipe, _tumbled(recipe, visits, seed)))
        figures.append(_figure(f"one unit of {visits} visits", spent[-1], MOST_S[visits], "s of processor"))
    power = float(np.log(spent[1] / spent[0]) / np.log(LENGTHS[1] / LENGTHS[0]))
    figures.append(_figure("cost against visits, p", power, 1.2, "t ∝ visitsᵖ"))
    short = _in_runs(_tumbled(recipe, IN_RUNS, seed))
    several = [_seconds(recipe, short) for _ in range(TIMES)]
    goal, met = at_most(float(np.median(several)), RUNS_MOST_S)
    what = f"one unit of {IN_RUNS} visits in {IN_RUNS // A_RUN} runs"
    spread = float(np.median(several)), min(several), max(several), TIMES
    figures.append(Figure(what, *spread, goal, met, "s of processor"))
    single = _seconds(load_recipe("hand-held"), _single_readings(seed))
    return [*figures, _figure(f"{SINGLE} single readings by hand", single, SINGLE_MOST_S, "s of processor")]


def _figure(what: str, value: float, most: float, note: str) -> Figure:
    goal, met = at_most(value, most)
    return Figure(what, value, value, value, 1, goal, met, note)


def _seconds(recipe: Recipe, table: SampleTable) -> float:
    """Of the processor, the second time."""
    diagnosis_of(recipe, table)
    begun = time.process_time()
    diagnosis_of(recipe, table)
    return time.process_time() - begun


def _in_runs(table: SampleTable) -> SampleTable:
    """The visits of one run as runs of so many, each with a clock of its own."""
    run, visit = np.divmod(table.visit, A_RUN)
    first = np.flatnonzero(np.diff(run, prepend=-1))
    return replace(table, run=run, visit=visit, time_s=table.time_s - table.time_s[first][run])


def _tumbled(recipe: Recipe, visits: int, seed: int) -> SampleTable:
    """All positions again and again in another order, in a room that swings by some degrees."""
    rng, planned = np.random.default_rng(seed), planned_visits(recipe, 0)
    place = np.concatenate([rng.permutation(len(planned)) for _ in range(visits // len(planned) + 1)])[:visits]
    a = np.array([visit.true for visit in planned])[place]
    true = a * (1 + 2e-3 * rng.standard_normal(3)) + 5e-3 * rng.standard_normal(3) + CUBIC * a**3
    position = Labels(tuple(visit.position for visit in planned), np.repeat(place, SAMPLES).astype(np.int32))
    temperature = 25 + 4 * np.sin(np.linspace(0, 9, visits)) + 0.02 * rng.standard_normal(visits)
    return _table(true, position, 2.5, SAMPLES, rng, {"temperature_degC": np.repeat(temperature, SAMPLES)})


def _single_readings(seed: int) -> SampleTable:
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((SINGLE, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    position = Labels(tuple(f"hand-{i}" for i in range(SINGLE)), np.arange(SINGLE, dtype=np.int32))
    return _table(a * [1.01, 0.99, 1.02] + [0.01, -0.02, 0.03], position, 2.0, 1, rng, {})


def _table(
    true: Floats, position: Labels, every_s: float, samples: int, rng: np.random.Generator, values: dict[str, Floats]
) -> SampleTable:
    visit = np.repeat(np.arange(len(true), dtype=np.int32), samples)
    nothing = np.zeros(len(visit), np.int32)
    time_s = every_s * visit + 0.01 * np.tile(np.arange(samples), len(true))
    reading = true[visit] + NOISE * rng.standard_normal((len(visit), 3))
    home = {"seating": Labels(("home",), nothing)}
    return SampleTable(Labels(("A",), nothing), nothing, visit, position, time_s, reading, home, values)
