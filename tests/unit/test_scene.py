"""Scenes: one from a plan and one from the table it makes are the same; bad tables are sentences."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.planning.forecast import forecast
from station.errors import SamplesError
from station.model.campaign import campaign_of, scene_of_plan
from station.model.scene import scene_of_table
from station.model.simulate import SimulationJob, simulate
from station.model.simulated_line import SimulatedLine
from station.model.timeline import FleetPart, run_timeline
from tests.unit.tilt_recipe import THREE_RUNS, tilt


@pytest.fixture(scope="module")
def made() -> Any:
    return simulate(SimulationJob(tilt(runs=THREE_RUNS), ("A", "B", "C"), 4))


def test_plan_and_table_give_the_same_scene(made: Any) -> None:
    """What a diagnosis rebuilds from the table is what the simulation acted on, but for the thermometer's noise."""
    planned, measured = made.scene, scene_of_table(made.scene.recipe, made.table)
    for name in ("visit", "time_s", "since_power_s", "since_clamp_s", "motor", "started_s"):
        np.testing.assert_array_equal(getattr(measured, name), getattr(planned, name))
    assert measured.since_arrival_s is not None
    np.testing.assert_allclose(measured.since_arrival_s, planned.since_arrival_s, atol=1e-12)
    for name in ("nest_R", "seat_R", "stimulus", "previous", "run"):
        np.testing.assert_array_equal(getattr(measured.visits, name), getattr(planned.visits, name))
    for level in ("unit", "run", "visit", "nest", "position", "operator", "lot", "run-of-recipe"):
        codes, names = measured.group(level)
        planned_codes, planned_names = planned.group(level)
        assert [names[c] for c in codes] == [planned_names[c] for c in planned_codes]
    # Mean of 20 samples, straight line over the stops of a minute: a slope good to about 0.02/√(20·12)/18 s.
    assert measured.temperature_rate is not None
    off = measured.temperature_rate - planned.temperature_rate
    assert np.abs(off).max() < 2e-3
    assert np.corrcoef(measured.temperature_rate, planned.temperature_rate)[0, 1] > 0.8


def test_order_of_rows_and_units_does_not_matter(made: Any) -> None:
    """Four nests tumble at once, so the rows of several units come interleaved by time."""
    rows = np.lexsort([made.table.time_s, made.table.run])
    mixed, plain = (scene_of_table(made.scene.recipe, table) for table in (made.table[rows], made.table))
    np.testing.assert_array_equal(mixed.visits.previous, plain.visits.previous)
    np.testing.assert_array_equal(mixed.visit, plain.visit[rows])
    assert mixed.since_arrival_s is not None and plain.since_arrival_s is not None
    np.testing.assert_allclose(mixed.since_arrival_s, plain.since_arrival_s[rows])


def test_first_stop_of_a_run_has_no_previous(made: Any) -> None:
    visits = made.scene.visits
    np.testing.assert_array_equal(visits.previous < 0, visits.visit == 0)
    after = visits.previous >= 0
    np.testing.assert_array_equal(visits.previous[after], np.flatnonzero(after) - 1)


def test_groups_read_as_the_contracts_write_them(made: Any) -> None:
    scene = made.scene
    assert scene.group("unit")[1] == ("unit:A", "unit:B", "unit:C")
    assert scene.group("run")[1][:4] == ("run:A/0", "run:A/1", "run:A/2", "run:B/0")
    assert scene.group("visit")[1][25] == "visit:A/1/1"
    assert scene.group("common") == (pytest.approx(np.zeros(len(scene.visits))), ("common",))
    assert "nest:N2" in scene.group("nest")[1]
    assert scene.is_recorded("nest") and scene.is_recorded("motor") and not scene.is_recorded("gold")


def test_what_nobody_recorded_is_not_known(made: Any) -> None:
    """Without labels all visits are one group, seated as the recipe's runs say; without a covariate a cause that needs
    it says so."""
    bare = scene_of_table(made.scene.recipe, replace(made.table, labels={}, values={}))
    codes, names = bare.group("nest")
    assert names == ("common",)
    np.testing.assert_array_equal(codes, np.zeros(len(bare.visits)))
    assert not bare.is_recorded("nest") and not bare.is_recorded("temperature_rate")
    np.testing.assert_array_equal(bare.visits.seat_R, made.scene.visits.seat_R)
    with pytest.raises(SamplesError, match="no column motor; record it"):
        bare.require("motor")


def _one(position: str, seating: str = "home") -> SampleTable:
    zero = np.zeros(1, np.int32)
    labels = {"seating": Labels.of([seating])}
    return SampleTable(Labels.of(["U"]), zero, zero, Labels.of([position]), np.zeros(1), np.zeros((1, 3)), labels)


def test_unknown_names_are_sentences_with_the_nearest() -> None:
    with pytest.raises(
        SamplesError, match="Position 'p99' of the samples is not in the recipe; the nearest one there is 'p"
    ):
        scene_of_table(tilt(), _one("p99"))
    with pytest.raises(
        SamplesError, match=r"Seating 'turnd' of the samples is not in the recipe; the nearest .* 'turned'"
    ):
        scene_of_table(tilt(), _one("p1", "turnd"))


def test_unknown_pose_takes_any_label() -> None:
    by_hand = tilt(reference={"source": "gravity", "magnitude": 1.0, "pose": "unknown"}, method="norm", positions=[])
    scene = scene_of_table(by_hand, _one("anything"))
    assert np.isnan(scene.visits.nest_R).all()
    np.testing.assert_array_equal(scene.visits.stimulus, [[0, 0, 1]])


def test_gold_is_corrected_by_its_own_calibration() -> None:
    """measured = 2 · true + 0.1: a reading of (0.1, 0.1, 2.1) is (0, 0, 1)."""
    gold = {"serial": "G", "due": "2030-01-01", "offset": [0.1] * 3, "matrix": [[2, 0, 0], [0, 2, 0], [0, 0, 2]]}
    table = replace(_one("p0"), gold=np.array([[0.1, 0.1, 2.1]]))
    scene = scene_of_table(tilt(reference={"source": "gold", "gold": gold}), table)
    assert scene.visits.gold is not None
    np.testing.assert_allclose(scene.visits.gold, [[0, 0, 1]], atol=1e-15)


# --- the plan as it is lived through -------------------------------------------------------------------------------


def test_moves_follow_the_trapezium() -> None:
    """45 degrees at 90 deg/s and 180 deg/s²: the ramps alone take it, 2·√(45/180) = 1 s; 90 take 1.5, 180 take 2.5."""
    line = SimulatedLine()
    assert [line.move_s(a) for a in (0, 45, 90, 180)] == pytest.approx([0.0, 1.0, 1.5, 2.5])
    went = run_timeline(tilt(dwell={"time_s": 1.0}, settle={"time_s": 0.5}), 0, line)
    assert went.arrival_s[0] == pytest.approx(1.5)
    np.testing.assert_allclose(np.diff(went.arrival_s)[:7], 1.0 + 1.5)
    assert went.duration_s == pytest.approx(went.arrival_s[-1] + 1.5)


def test_conditions_follow_the_runs() -> None:
    """+10 degC in run 1; 600 s of power before run 2, whose motors stand still; clamping knows nothing of power."""
    scene = scene_of_plan(tilt(runs=THREE_RUNS), ("A",), 3)
    run = scene.visits.run[scene.visit]
    mean = [scene.require("temperature_degC")[run == r].mean() for r in range(3)]
    assert mean[1] - mean[0] == pytest.approx(10, abs=1.5)
    assert scene.require("since_power_s")[run == 2].min() > 600 > scene.require("since_power_s")[run == 1].max()
    np.testing.assert_allclose(scene.require("since_clamp_s"), scene.time_s + 5.0)
    assert scene.require("motor")[run == 2].max() == 0 < scene.require("motor")[run == 0].std()
    begun = [np.unique(scene.require("started_s")[run == r]) for r in range(3)]
    assert all(len(b) == 1 for b in begun)
    assert begun[0] < begun[1] < begun[2]


def test_rate_of_temperature_is_its_derivative() -> None:
    scene = scene_of_plan(tilt(dwell={"time_s": 1.0}), ("A",), 3)
    slope = np.gradient(scene.require("temperature_degC"), scene.time_s)
    same = np.diff(scene.visit, prepend=-1) == 0
    np.testing.assert_allclose(slope[same][1:-1], scene.require("temperature_rate")[same][1:-1], atol=1e-6)


def test_parts_of_a_fleet_are_numbered_through() -> None:
    whole = scene_of_plan(tilt(), [f"U{i}" for i in range(6)], 3)
    part = campaign_of(tilt(), FleetPart(("U2", "U3"), 2, 6), 3).dwells(np.full(2, 100.0))
    rows = (whole.visits.unit.code[whole.visit] >= 2) & (whole.visits.unit.code[whole.visit] < 4)
    for name in ("time_s", "temperature_degC", "started_s", "motor"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[rows])
    for name, labels in part.visits.groups.items():
        stored = (whole.visits.unit.code >= 2) & (whole.visits.unit.code < 4)
        np.testing.assert_array_equal(labels.text(), whole.visits.groups[name][stored].text())


def test_dwell_until_the_noise_is_low_enough() -> None:
    """As long as the coefficients need by the sheet's noise, at each stop as much as it matters, within the limits."""
    sheet = {"noise_density": 1e-4, "rate_hz": 100}

    def dwells(wanted: float) -> Floats:
        return run_timeline(tilt(dwell={"until_std": wanted}, device=sheet), 0).dwell_s

    assert dwells(1e-3) == pytest.approx(0.2)
    assert 4 < np.median(dwells(1e-6)) < dwells(1e-6).max() <= 5
    shown = forecast(tilt(dwell={"until_std": 4e-5}, device=sheet), np.zeros(12))
    assert shown.dwell_s == pytest.approx(dwells(4e-5), rel=0.01)
    assert shown.budget.std("noise").max() == pytest.approx(4e-5, rel=0.02)
    went = run_timeline(tilt(dwell={"until_std": 4e-5}, device=sheet), 0)
    assert went.duration_s == pytest.approx(went.arrival_s[-1] + went.dwell_s[-1] + tilt().settle.time_s)
