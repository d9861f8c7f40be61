"""Laws that a cause of the library imitates, and that take its place or make its name less than certain."""

import os
from dataclasses import replace

import numpy as np
import pytest

from station.diagnosis.search.alarm import TAIL_START
from station.diagnosis.search.cause_search import SearchResult
from station.domain.recipe.recipe import Recipe
from tests.blind.bench import WHITE, Array, Hidden, World, hide, world
from tests.blind.hidden import KNOWN, per_unit
from tests.blind.inspection import searched
from tests.blind.outside import OUTSIDE
from tests.blind.recipes import recipe, six_faces
from tests.portion import portion

SEED = int(os.environ.get("SEED", "1"))
#: From here on a name is certain.
SURE = 0.9
#: What a cause of the library imitates, and causes that some law resembles.
IMITATED = (
    "size under vibration", "temperature on crosstalk", "product of axes that drifts", "hysteresis across axes",
    "arrival under vibration", "nest that gives with the move", "base that gives under load", "nest that warms",
    "shock that fades", "swinging gain", "position before the last", "course of the dwell by temperature",
    "hysteresis by the length of the move",
)  # fmt: skip
RESEMBLED = ("cubic", "gain-temperature", "offset-temperature")


def test_what_fades_is_no_certain_hysteresis_at_six_faces() -> None:
    faces = six_faces("listed")
    table, _ = hide(faces, OUTSIDE["hysteresis that fades"][1], 60 + SEED, d=24.0)
    found = searched(faces, table)
    assert all(f.words or f.doubts or f.set_probability < SURE for f in found.findings)


def test_what_swings_at_six_faces_is_seen_in_time_and_no_kernel_outruns_chance() -> None:
    """A kernel of as many columns as a run has visits follows anything: its evidence in null sets was rounding."""
    faces = six_faces("listed", "reversed", "shuffled", "reversed")

    def swinging(w: World, rng: np.random.Generator) -> Array:
        at = 2 * np.pi * w.t / w.t.max() + 2.4 * (w.run + 4 * w.unit)
        return np.sin(at)

    table, _ = hide(faces, per_unit(3e-4, swinging), 50 + SEED, d=30.0)
    found = searched(faces, table)
    assert "time" in found.words
    assert found.null is not None
    # A likelihood ratio is beyond x nats by chance at most once in eˣ; nats more for σ, which is taken at its best.
    assert max(q[-1] for q in found.null.quantiles.values()) < -np.log(1 - TAIL_START) + 0.5


def test_a_switch_of_a_temperature_that_only_rises_is_no_certain_jump_in_time() -> None:
    def rising(kind: Recipe, units: int, rng: np.random.Generator) -> World:
        w = world(kind, units, rng)
        return replace(w, T=22 + 3 * (1 - np.exp(-w.t / 40)))

    switched = per_unit(3e-4, lambda w, rng: (w.T > 23.7).astype(float))
    table, _ = hide(recipe(1), switched, 70 + SEED, d=18.0, world_of=rising)
    found = searched(recipe(1), table).findings
    assert all(f.words or f.set_probability < SURE for f in found)


def test_what_a_floor_gains_by_itself_speaks_for_no_cause() -> None:
    """In noise that is not white the rest of a dwell fits better beside a kernel, with any cause or without."""
    noise = np.random.default_rng(SEED).standard_normal((288, 25, 3))
    for i in range(1, 25):
        noise[:, i] = 0.5 * noise[:, i - 1] + np.sqrt(0.75) * noise[:, i]
    table, _ = hide(recipe(), OUTSIDE["temperature on crosstalk"][1], 80 + SEED, d=30.0)
    table = replace(table, reading=table.reading + 5e-4 * noise.reshape(-1, 3))
    (found,) = searched(recipe(), table).findings
    assert set(found.words) >= {"temperature", "input"}


def found_of(hidden: Hidden, seed: int, d: float) -> SearchResult:
    """What a search finds of a hidden thing."""
    table, _ = hide(recipe(), hidden, seed, floor=WHITE, d=d)
    return searched(recipe(), table)


@pytest.mark.parametrize("name", portion(IMITATED))
def test_what_a_cause_of_the_library_imitates_is_not_named_for_certain(name: str) -> None:
    """What the imitation leaves is too weak to alarm; that another law does better in its place is not."""
    found = found_of(OUTSIDE[name][1], 1000 + SEED, 16.0)
    assert found.findings
    assert OUTSIDE[name][0] & {*found.words, *(word for f in found.findings for word in f.doubts)}
    assert all(f.words or f.probability[f.name] < 0.9 for f in found.findings)


def test_a_nest_that_creeps_is_told_as_the_nests_or_unknown() -> None:
    """A straight line is the beginning of a creep: the library has one for nests."""
    found = found_of(OUTSIDE["nest that creeps in the run"][1], 1000 + SEED, 16.0)
    levels = {f.accepted.candidate.of for f in found.findings if f.accepted is not None}
    assert found.words or levels == {"nest"}
    assert {"time", "group"} & set(found.words) or {f.name for f in found.findings} == {"clamp-creep"}


@pytest.mark.parametrize("name", portion(RESEMBLED))
def test_a_cause_that_laws_resemble_keeps_its_name(name: str) -> None:
    found = found_of(KNOWN[name], 1100 + SEED, 16.0)
    assert name in (found.findings[0].name, *found.findings[0].indistinguishable_from)
    assert not found.words


def test_a_jump_of_one_unit_in_one_run_is_a_step_and_no_walk() -> None:
    table, _ = hide(recipe(1), KNOWN["step"], 90 + SEED, units=1, d=20.0)
    (found,) = searched(recipe(1), table).findings
    assert found.name == "step"


@pytest.mark.parametrize("range_degC", [0.08, 0.15])
def test_an_offset_by_temperature_stays_in_the_set_where_a_thermometer_hardly_shows_how_that_rose(
    range_degC: float,
) -> None:
    """As it was read it bore more of the thermometer's 30 mK than of its own course, which no offset followed."""

    def rising(kind: Recipe, units: int, rng: np.random.Generator) -> World:
        w = world(kind, units, rng)
        return replace(w, T=22 + range_degC * w.t / w.t.max())

    faces = six_faces("listed")
    table, _ = hide(faces, per_unit(3e-4, lambda w, rng: w.T - 22), 90 + SEED, d=14.0, world_of=rising)
    (found,) = searched(faces, table).findings
    assert "offset-temperature" in (found.name, *found.indistinguishable_from)


def test_what_a_thermometer_may_be_off_by_ties_the_rate_of_temperature_to_no_asymmetry() -> None:
    """At six faces once, four numbers are left of a unit's axis; the rate's errors, of any size, followed all four."""
    faces = six_faces("listed")
    table, _ = hide(faces, KNOWN["asymmetry"], 92 + SEED, d=16.0)
    (found,) = searched(faces, table).findings
    assert "asymmetry" in (found.name, *found.indistinguishable_from)
    assert "temperature-rate" not in (found.name, *found.indistinguishable_from)
