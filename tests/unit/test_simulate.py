"""Campaigns: noise, counters, clocks, bus and bookkeeping; what stays the same when something is added."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.errors import InputError, UsageError
from station.model import truth
from station.model.effect import Effect
from station.model.forward import forward
from station.model.model_file import Model
from station.model.noise import Noise, flicker_at
from station.model.simulate import (
    SimulatedCampaign,
    SimulationJob,
    by_data_sheet,
    parse_effect,
    simulate,
    simulate_in_parts,
)
from tests.unit.tilt_recipe import THREE_RUNS, tilt

UNITS = ("A", "B", "C")


def job(*effects: str | Effect, units: tuple[str, ...] = UNITS, seed: int = 6, **changes: Any) -> SimulationJob:
    recipe = tilt(**changes)
    return SimulationJob(
        recipe, units, seed, tuple(parse_effect(e, recipe) if isinstance(e, str) else e for e in effects)
    )


def quiet(one: SimulationJob) -> SimulationJob:
    return replace(one, model=Model.model_validate({"noise": {"density": 0.0, "flicker": 0.0}}))


def counters(made: SimulatedCampaign) -> Any:
    """Steps of the counter between rows that follow each other within a stop."""
    table = made.table
    keys = np.stack([table.unit.code, table.run, table.visit])
    inside = (np.diff(keys, axis=1) == 0).all(axis=0)
    return np.diff(table.values["counter"])[inside] % 256


def test_without_a_cause_readings_are_calibration_and_noise() -> None:
    """measured − (matrix · true + offset) is white: density · √(rate/2) is 707 µg, within four standard errors."""
    made = simulate(job(device={"noise_density": 1e-4, "rate_hz": 100}))
    noise = made.table.reading - forward(made.scene, made.base)
    sigma = 1e-4 * np.sqrt(50)
    assert noise.std() == pytest.approx(sigma, rel=4 / np.sqrt(2 * noise.size) + 1e-3)
    assert np.abs(noise.mean(axis=0)).max() < 4 * sigma / np.sqrt(len(noise)) + 1e-5
    neighbours = np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]
    assert abs(neighbours) < 4 / np.sqrt(len(noise))


def test_noise_free_readings_are_exact() -> None:
    made = simulate(quiet(job(units=("A",))))
    np.testing.assert_array_equal(made.table.reading, forward(made.scene, made.base))


def test_flicker_has_its_rms_and_falls_with_frequency() -> None:
    rng = np.random.default_rng(8)
    slow = np.concatenate([Noise(0.0, 1e-5).slow(500.0, rng) for _ in range(60)])
    assert slow.std() == pytest.approx(1e-5, rel=0.05)
    power = np.mean(np.abs(np.fft.rfft(slow)) ** 2, axis=0)
    assert power[8:16].mean() / power[64:128].mean() == pytest.approx(8.0, rel=0.3)
    points = flicker_at(slow[:3], np.array([0.5, 0.75, 1.0]))
    np.testing.assert_allclose(points[1], (points[0] + points[2]) / 2)


def test_units_spread_as_data_sheets_say() -> None:
    """25 mg and 1 %: four standard errors of a standard deviation from 1200 numbers are 8 %."""
    base = job().base([f"U{i}" for i in range(400)])
    assert base.offset.std() == pytest.approx(0.025, rel=0.085)
    gains = np.einsum("uii->ui", base.matrix)
    assert gains.std() == pytest.approx(0.01, rel=0.085)
    off = base.matrix - gains[:, :, None] * np.eye(3)
    assert not off.any()


def test_a_unit_is_the_same_in_any_company() -> None:
    alone, together = simulate(job("package-rotation", units=("B",))), simulate(job("package-rotation"))
    np.testing.assert_array_equal(together.base.offset[1], alone.base.offset[0])
    ours, theirs = (next(iter(made.active.values())).coefficients for made in (alone, together))
    np.testing.assert_array_equal(theirs[1], ours[0])


def test_fleet_in_parts_is_the_fleet() -> None:
    one = job("quadratic", "nest-tilt", "lost-frames", "clock-error", "step", "repeatability", units=tuple("ABCDE"))
    whole, pieces = simulate(one), list(simulate_in_parts(one, 2))
    assert [p.units for p in pieces] == [("A", "B"), ("C", "D"), ("E",)]
    hit = {p["of"] for e in truth.document(one, pieces)["effects"] if e["effect"] == "step" for p in e["parameters"]}
    assert hit
    keep = np.concatenate([p.table.time_s for p in pieces])
    np.testing.assert_array_equal(keep, whole.table.time_s)
    first = len(pieces[0].table)
    without_step = replace(one, effects=tuple(e for e in one.effects if e.id != "step"))
    whole, pieces = simulate(without_step), list(simulate_in_parts(without_step, 2))
    np.testing.assert_array_equal(pieces[0].table.reading, whole.table.reading[:first])


def test_parts_hold_about_so_many_samples_whatever_the_fleet(monkeypatch: pytest.MonkeyPatch) -> None:
    one = job("quadratic", units=tuple("ABCDEFG"))
    of_a_unit = len(simulate(replace(one, units=("A",))).table)
    for wanted, units in ((of_a_unit // 2, 1), (3 * of_a_unit, 3), (100 * of_a_unit, 7)):
        monkeypatch.setattr("station.model.simulate.SAMPLES_PER_PART", wanted)
        found = list(simulate_in_parts(one))
        assert [len(p.units) for p in found] == [units] * (7 // units) + [7 % units] * (7 % units > 0)


def test_equal_seeds_are_equal_and_others_differ() -> None:
    one, two, other = (simulate(job("settling", seed=s)).table.reading for s in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert np.abs(one - other).max() > 1e-3


# --- clock, counter, bus -------------------------------------------------------------------------------------------


def test_counter_counts_every_frame_and_through_the_moves() -> None:
    made = simulate(job(units=("A",)))
    assert set(counters(made)) == {1}
    table = made.table
    rate = 1 / np.diff(table.time_s)[0]
    whole = np.rint((table.time_s - table.time_s[0]) * rate)
    turns = (table.values["counter"] - table.values["counter"][0] - whole) % 256
    assert np.minimum(turns, 256 - turns).max() <= 1
    assert table.values["counter"].max() < 256 and table.values["counter"].min() >= 0


def test_counter_has_the_bits_of_the_data_sheet() -> None:
    counter = simulate(job(units=("A",), device={"counter_bits": 4})).table.values["counter"]
    assert set(counter) == set(range(16))


def test_a_good_clock_keeps_its_tolerance_and_a_wrong_one_does_not() -> None:
    def rates(*effects: str | Effect) -> Any:
        table = simulate(job(*effects, dwell={"time_s": 1.0})).table
        same = np.diff(table.unit.code * 1000 + table.visit) == 0
        return [1 / np.diff(table.time_s)[same & (table.unit.code[1:] == u)].mean() for u in range(3)]

    assert np.abs(np.array(rates()) / 100 - 1).max() <= 100e-6
    off = np.abs(np.array(rates(replace(parse_effect("clock-error", tilt()), size=0.05))) / 100 - 1)
    np.testing.assert_allclose(off, 0.05, atol=2e-4)


def test_wrong_clock_changes_how_many_samples_fit_into_a_dwell() -> None:
    fast = job(replace(parse_effect("clock-error", tilt()), size=0.1), dwell={"time_s": 1.0})
    table = simulate(fast).table
    count = np.bincount(table.unit.code) / 24
    assert set(count) <= {90, 110}


def test_lost_frames_leave_gaps_in_counter_and_time() -> None:
    plain, made = simulate(job()), simulate(job(replace(parse_effect("lost-frames", tilt()), size=0.1)))
    n = len(plain.table)
    # Binomial: four standard deviations.
    assert n - len(made.table) == pytest.approx(0.1 * n, abs=4 * np.sqrt(0.09 * n))
    steps = counters(made)
    assert (steps > 1).mean() == pytest.approx(0.1, abs=0.03) and steps.min() == 1
    assert np.isin(made.table.time_s, plain.table.time_s).all()


def test_duplicated_frames_repeat_counter_and_payload() -> None:
    made = simulate(job(replace(parse_effect("duplicated-frames", tilt()), size=0.1)))
    table = made.table
    again = np.flatnonzero(np.diff(table.values["counter"]) == 0)
    assert len(again) == pytest.approx(0.1 * 3 * 24 * 20, abs=4 * np.sqrt(0.09 * 1440))
    np.testing.assert_array_equal(table.reading[again], table.reading[again + 1])
    np.testing.assert_allclose(table.time_s[again + 1] - table.time_s[again], 0.00025, atol=1e-9)


def test_reordered_frames_swap_payloads_while_time_runs_on() -> None:
    plain, made = simulate(job()), simulate(job(replace(parse_effect("reordered-frames", tilt()), size=0.1)))
    np.testing.assert_array_equal(made.table.time_s, plain.table.time_s)
    moved = np.flatnonzero(made.table.values["counter"] != plain.table.values["counter"])
    assert len(moved) % 2 == 0 and len(moved) > 100
    first, second = moved[::2], moved[1::2]
    np.testing.assert_array_equal(made.table.reading[first], plain.table.reading[second])
    np.testing.assert_array_equal(plain.table.visit[first], plain.table.visit[second])
    assert (counters(made) == 255).any()


def test_bus_faults_together_keep_rows_in_the_order_of_time() -> None:
    table = simulate(job("lost-frames", "duplicated-frames", "reordered-frames", runs=THREE_RUNS)).table
    same = (np.diff(table.unit.code) == 0) & (np.diff(table.run) == 0)
    assert np.diff(table.time_s)[same].min() > 0


# --- data sheet, gold, other sensors -------------------------------------------------------------------------------


def test_data_sheet_gives_grid_and_full_scale() -> None:
    recipe = tilt(device={"lsb": 0.01, "full_scale": 0.9})
    np.testing.assert_allclose(by_data_sheet(recipe, np.array([[0.014, 0.016, 2.0]])), [[0.01, 0.02, 0.9]])
    reading = simulate(job(device={"lsb": 0.01, "full_scale": 0.9})).table.reading
    np.testing.assert_allclose(reading / 0.01, np.round(reading / 0.01), atol=1e-9)
    assert reading.max() == 0.9


def test_gold_sits_in_the_nest_and_knows_nothing_of_seat_and_unit() -> None:
    """In the turned run the gold still reads Rᵀ·(0, 0, 1) of the position; a tilted nest tilts it."""
    one = replace(quiet(job("package-rotation", runs=THREE_RUNS)), gold=True)
    made = simulate(one)
    visits = made.scene.visits
    plain = np.einsum("vji,vj->vi", visits.nest_R, visits.stimulus)[made.scene.visit]
    assert made.table.gold is not None
    np.testing.assert_allclose(made.table.gold, plain, atol=1e-12)
    tilted = simulate(replace(one, effects=(parse_effect("nest-tilt", one.recipe),))).table.gold
    assert np.abs(tilted - plain).max() > 5e-4


def test_gold_is_written_where_it_is_the_reference_or_drifts() -> None:
    assert simulate(job()).table.gold is None
    drifting = quiet(job("gold-drift"))
    table = simulate(drifting).table
    plain = simulate(replace(quiet(job()), gold=True)).table
    assert table.gold is not None and plain.gold is not None
    off = table.gold - plain.gold
    np.testing.assert_allclose(off, np.tile(off[0], (len(off), 1)), atol=1e-12)
    assert np.sqrt(np.mean(off[0] ** 2)) == pytest.approx(5e-4)
    np.testing.assert_array_equal(table.reading, plain.reading)


def test_magnetometer_and_gyroscope_are_simulated_too() -> None:
    field = {"source": "field", "vector": [20.0, 0.0, -45.0]}
    made = simulate(job("nest-tilt", sensor="magnetometer", unit="uT", reference=field))
    np.testing.assert_allclose(np.linalg.norm(made.scene.visits.stimulus, axis=1), np.hypot(20, 45))
    assert np.linalg.norm(made.table.reading, axis=1).mean() == pytest.approx(49.2, rel=0.1)
    rates = [{"name": f"r{i}", "rate": [0, 0, 50.0 * i]} for i in range(-2, 3)]
    turned = job(sensor="gyroscope", unit="deg/s", reference={"source": "rate"}, positions=rates, runs=THREE_RUNS)
    made = simulate(quiet(turned))
    # Turned 180° about z, a rate about z stays what it is.
    np.testing.assert_array_equal(made.table.reading, forward(made.scene, made.base))
    assert np.ptp(made.table.reading[:, 2]) == pytest.approx(200, rel=0.05)


def test_stops_by_hand_point_anywhere() -> None:
    by_hand = {"source": "gravity", "magnitude": 1.0, "pose": "unknown"}
    made = simulate(quiet(job(reference=by_hand, method="norm", positions=[])))
    assert len(made.scene.visits) == 3 * 24
    true = np.einsum("vji,vj->vi", made.scene.visits.nest_R, made.scene.visits.stimulus)
    np.testing.assert_allclose(np.linalg.norm(true, axis=1), 1.0)
    # Evenly over the sphere: mean of 72 components of variance 1/3, four standard errors.
    assert np.abs(true.mean(axis=0)).max() < 4 / np.sqrt(3 * 72)


# --- truth and model files -----------------------------------------------------------------------------------------


def test_truth_tells_units_and_coefficients() -> None:
    one = job("offset-temperature", "settling", "step", "bias-walk")
    made = simulate(one)
    shown = truth.document(one, [made])
    assert shown["schema"] == "station.truth/1" and shown["seed"] == 6
    assert [u["serial"] for u in shown["units"]] == list(UNITS)
    np.testing.assert_array_equal(shown["units"][1]["offset"], made.base.offset[1])
    effects = {e["effect"]: e["parameters"] for e in shown["effects"]}
    first = effects["offset-temperature"][0]
    assert (first["name"], first["axis"], first["of"], first["unit"]) == ("coefficient", "x", "unit:A", "g/degC")
    assert len(effects["offset-temperature"]) == 9
    assert effects["settling"][-2:] == [
        {"name": "time_constant", "axis": None, "of": "common", "value": 0.1, "unit": "s"},
        {"name": "frequency", "axis": None, "of": "common", "value": 0.0, "unit": "Hz"},
    ]
    hit = {p["of"] for p in effects["step"]} - {"common"}
    assert 1 <= len(hit) < 3 and all(of.startswith("run:") for of in hit)
    assert effects["step"][-1]["name"] == "at"
    assert effects["bias-walk"] == [{"name": "step_std", "axis": None, "of": "common", "value": 1e-5, "unit": "g"}]


def _as_model(one: SimulationJob, made: SimulatedCampaign) -> Model:
    effects = truth.document(one, [made])["effects"]
    return Model.model_validate({"noise": {"density": 0.0, "flicker": 0.0}, "effects": effects})


@pytest.mark.parametrize(
    "name", ["quadratic", "nest-tilt", "settling", "index-error", "step", "axis-permutation", "lost-frames"]
)
def test_truth_read_back_as_a_model_simulates_the_same(name: str) -> None:
    """The parameter form of docs/formats.md loses nothing: for the same units the samples are the same."""
    one = quiet(job(name))
    made = simulate(one)
    again = simulate(replace(one, effects=(), model=_as_model(one, made)))
    np.testing.assert_allclose(again.table.reading, made.table.reading, atol=1e-12)


def test_model_gives_new_units_the_spread_of_the_known_ones() -> None:
    one = quiet(job("quadratic"))
    model = _as_model(one, simulate(one))
    strangers = simulate(replace(one, units=tuple(f"N{i}" for i in range(300)), effects=(), model=model))
    c = next(iter(strangers.active.values())).coefficients
    known = np.sqrt(np.mean([p.value**2 for p in model.effects[0].parameters if not isinstance(p.value, str)]))
    assert np.sqrt(np.mean(c**2)) == pytest.approx(known, rel=0.08)


def test_a_floor_in_a_model_is_drawn() -> None:
    """`repeatability` of common is a standard deviation: the visits draw it."""
    parameters = [{"name": "angle", "of": "common", "value": 1e-3, "unit": "rad"}]
    model = Model.model_validate({"effects": [{"effect": "repeatability", "parameters": parameters}]})
    made = simulate(replace(job(), model=model))
    acting = next(iter(made.active.values()))
    assert acting.of == "visit"
    assert acting.coefficients.std() == pytest.approx(1e-3, rel=4 / np.sqrt(2 * 216))


@pytest.mark.parametrize(
    ("effect", "printed"),
    [
        ({"effect": "quadratc"}, "quadratc"),
        (
            {"effect": "settling", "shape": {"tau": 1.0}},
            "settling has no shape parameter 'tau'; it has time_constant_s",
        ),
        (
            {"effect": "quadratic", "parameters": [{"name": "coefficient", "axis": "w", "value": 1.0}]},
            "quadratic has no axis 'w'; it has x, y, z",
        ),
    ],
)
def test_models_that_cannot_be_are_sentences(effect: Any, printed: str) -> None:
    model = Model.model_validate({"effects": [effect]})
    with pytest.raises((InputError, UsageError), match=printed):
        simulate(replace(job(), model=model))
