"""A gold reference shows gravity and its own drift, whatever the recipe's reference is, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.data.faults import GrossFault, inspect
from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.results.extend import extend_model
from station.diagnosis.results.gold_direction import gold_directions, settle
from station.domain.recipe.recipe import Recipe
from station.model.model_file import Model
from station.model.simulate import SimulationJob, parse_effects, simulate
from tests.blind.inspection import diagnosis_of

UNITS = ("A", "B", "C", "D")
CERTIFICATE = {
    "serial": "G1",
    "due": "2030-01-01",
    "offset": (0.002, -0.001, 0.003),
    "matrix": ((1.001, 0.0, 0.0), (0.0, 0.999, 0.0005), (0.0, 0.0, 1.002)),
    "offset_std": 5e-5,
    "gain_std": 2e-5,
}


def by_gold() -> Recipe:
    """Six faces, the truth taken from a gold reference."""
    shown = load_recipe("six-point").model_dump(by_alias=True)
    return Recipe.model_validate({**shown, "reference": {"source": "gold", "magnitude": 1.0, "gold": CERTIFICATE}})


def found(recipe: Recipe, *requested: str, seed: int = 3) -> dict[str, GrossFault]:
    """What a gold beside the units shows of causes."""
    made = simulate(SimulationJob(recipe, UNITS, seed, parse_effects(requested, recipe), gold=True)).table
    return {f.effect: f for f in inspect(recipe, made).faults}


@pytest.mark.parametrize("recipe", [load_recipe("six-point"), load_recipe("tilt-24"), by_gold()], ids=lambda r: r.name)
def test_gravity_and_drift_are_named_and_sized_whatever_the_reference_is(recipe: Recipe) -> None:
    gravity = found(recipe, "local-gravity=0.0012")
    assert set(gravity) == {"local-gravity"}
    (number,) = gravity["local-gravity"].numbers
    assert number.std is not None
    assert abs(float(number.value) - 0.0012) < 3 * number.std < 2e-4
    both = found(recipe, "local-gravity=0.0012", "gold-drift=0.002")
    assert set(both) == {"local-gravity", "gold-drift"}
    size = np.sqrt(np.mean([float(n.value) ** 2 for n in both["gold-drift"].numbers]))
    assert abs(size - 0.002) < 3e-4


def test_a_gold_that_moved_by_much_is_no_gravity() -> None:
    """What it moved across its reading lengthens that by the square: 200 ppm."""
    assert set(found(load_recipe("six-point"), "gold-drift=0.02")) == {"gold-drift"}


def test_nothing_that_turns_or_still_moves_is_taken_for_either() -> None:
    recipe = load_recipe("six-point")
    causes = ("base-tilt", "nest-tilt", "index-error", "settling", "lever-arm", "repeatability")
    assert not {"local-gravity", "gold-drift"} & set(found(recipe, *causes))


def test_positions_that_do_not_tell_them_apart_give_both() -> None:
    shown = load_recipe("six-point").model_dump(by_alias=True)
    up = [p for p in shown["positions"] if p["name"] in ("x-up", "y-up", "z-up")]
    assert len(up) == 3
    recipe = Recipe.model_validate({**shown, "positions": up, "method": "three-point"})
    (fault,) = [f for f in found(recipe, "local-gravity=0.002").values() if f.effect in ("local-gravity", "gold-drift")]
    assert {fault.effect, *fault.indistinguishable_from} == {"local-gravity", "gold-drift"}


def test_a_diagnosis_names_gravity_and_is_silent_with_it_in_the_model() -> None:
    recipe = by_gold()
    table = simulate(SimulationJob(recipe, UNITS, 5, parse_effects(("local-gravity",), recipe))).table
    first = diagnosis_of(recipe, table)
    assert (first.verdict, [f.effect for f in first.faults]) == ("named", ["local-gravity"])
    assert not {"local-gravity", "gold-drift"} & set(first.not_testable)
    assert diagnosis_of(recipe, table, extend_model(Model(), first)).verdict == "none"


def test_a_gold_that_moved_does_no_harm_to_what_is_found_of_the_units() -> None:
    recipe = by_gold()
    table = simulate(SimulationJob(recipe, UNITS, 6, parse_effects(("gold-drift=0.003",), recipe))).table
    first = diagnosis_of(recipe, table)
    assert (first.verdict, [f.effect for f in first.faults], first.causes) == ("named", ["gold-drift"], ())
    assert diagnosis_of(recipe, table, extend_model(Model(), first)).verdict == "none"


def test_two_causes_of_the_device_are_found_beside_a_gold() -> None:
    """Together they left nothing, but a kernel of their many numbers was ahead by less than one part in a hundred."""
    shown = load_recipe("tilt-24").model_dump(by_alias=True)
    reference = {"source": "gold", "magnitude": 1.0, "gold": CERTIFICATE}
    recipe = Recipe.model_validate({**shown, "reference": reference})
    wanted = ("cross-axis=0.001", "package-rotation=0.001")
    table = simulate(SimulationJob(recipe, UNITS[:2], 5, parse_effects(wanted, recipe))).table
    first = diagnosis_of(recipe, table)
    assert (first.verdict, {c.finding.name for c in first.causes}) == ("named", {"cross-axis", "package-rotation"})


def test_without_a_gold_neither_can_be_shown() -> None:
    recipe = load_recipe("six-point")
    shown = diagnosis_of(recipe, simulate(SimulationJob(recipe, UNITS[:2], 12)).table).not_testable
    assert {"local-gravity", "gold-drift"} <= set(shown)


@pytest.mark.parametrize("jump", [False, True])
@pytest.mark.parametrize("recipe", [load_recipe("tilt-24"), by_gold()], ids=lambda r: r.name)
def test_a_gold_that_moves_while_the_campaign_runs_is_found_with_its_course(recipe: Recipe, jump: bool) -> None:
    requested = parse_effects(["nest-tilt=0.002", "base-tilt=0.001"], recipe)
    made = simulate(SimulationJob(recipe, (*UNITS, "E", "F"), 5, requested, gold=True)).table
    assert made.gold is not None
    t = made.time_s + made.values["started_s"]
    share = (t - t.min()) / np.ptp(t)
    moved = np.array([4e-4, -3e-4, 5e-4])
    course = (share > 0.4) * 1.0 if jump else share
    observed = {f.effect: f for f in inspect(recipe, replace(made, gold=made.gold + course[:, None] * moved)).faults}
    assert set(observed) >= {"gold-drift"}
    numbers = {(n.name, n.axis): n for n in observed["gold-drift"].numbers}
    for axis, true in zip("xyz", moved, strict=True):
        number = numbers["offset", axis]
        assert number.std is not None
        assert abs(float(number.value) - true) < 4 * number.std + 0.05 * abs(true)
    assert (("at", None) in numbers) == jump
    if jump:
        # Between the last visit before it and the first one after, as far as these are apart.
        at, starts = numbers["at", None], np.unique(t[np.flatnonzero(np.diff(made.visit, prepend=-1))])
        gap = starts[starts > t[course == 0].max()].min() - starts[starts <= t[course == 0].max()].max()
        assert at.std == pytest.approx(gap / np.sqrt(12), rel=0.01)
        assert abs(float(at.value) - (t.min() + 0.4 * np.ptp(t))) < gap
    else:
        length = float(np.linalg.norm(moved))
        rate, near = numbers["rate", None], max(float(numbers["offset", a].std or 0) for a in "xyz")
        assert 0 < float(rate.std or 0) * np.ptp(t) < 2 * near
        assert float(rate.value) * np.ptp(t) == pytest.approx(length, rel=0.1)
    assert observed["gold-drift"].gain is not None
    assert observed["gold-drift"].gain.accepted


def test_a_steady_gold_has_no_course() -> None:
    for seed in range(6):
        recipe = load_recipe("tilt-24")
        causes = parse_effects(["nest-tilt", "base-tilt", "local-gravity=0.001", "settling"], recipe)
        made = simulate(SimulationJob(recipe, UNITS, seed, causes, gold=True)).table
        assert "gold-drift" not in {f.effect for f in inspect(recipe, made).faults}


def seated_gold(seat_std_deg: float | None) -> Recipe:
    """Tilts once round, the truth taken from gravity, with a gold beside the units whose seat is known so well."""
    shown = load_recipe("tilt-24").model_dump(by_alias=True)
    gold = {"serial": "G1", "due": "2030-01-01", "seat_std_deg": seat_std_deg}
    return Recipe.model_validate(
        {**shown, "runs": shown["runs"][:1], "reference": {**shown["reference"], "gold": gold}}
    )


@pytest.fixture(scope="module")
def tied() -> Diagnosis:
    """One seating of two units, each in a tilted nest of its own: the units alone tell neither nest nor package."""
    recipe = seated_gold(None)
    job = SimulationJob(recipe, UNITS[:2], 7, parse_effects(("nest-tilt=0.003",), recipe), gold=True)
    return diagnosis_of(recipe, simulate(job).table)


@pytest.mark.parametrize(
    ("gold_tilts", "seat_std_deg", "told"),
    [
        (True, 0.02, ("nest-tilt",)),
        (False, 0.02, ("package-rotation",)),
        (True, 0.2, ("nest-tilt", "package-rotation")),
        (True, None, ("nest-tilt", "package-rotation")),
    ],
)
def test_the_gold_s_direction_tells_a_tilted_nest_from_turned_packages(
    tied: Diagnosis, gold_tilts: bool, seat_std_deg: float | None, told: tuple[str, ...]
) -> None:
    """A gold that does not tilt speaks for the packages; one whose seat is as uncertain as the tilt for nobody."""
    recipe, table = seated_gold(seat_std_deg), tied.table
    if not gold_tilts:
        table = replace(table, gold=simulate(SimulationJob(recipe, UNITS[:2], 7, gold=True)).table.gold)
    (finding,) = settle(tied.search_result, gold_directions(recipe, table)).findings
    assert (finding.name, *finding.indistinguishable_from) == told
    assert finding.set_probability == pytest.approx(tied.search_result.findings[0].set_probability)
    assert finding.accepted is not None and finding.accepted.candidate.name == told[0]
