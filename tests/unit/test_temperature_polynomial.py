"""Offset and gain that follow the temperature by a polynomial, and offsets of power cycles."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from station.errors import StationError
from station.model import truth
from station.model.campaign import scene_of_plan
from station.model.model_file import Model, ModelEffect
from station.model.scene import power_cycles
from station.model.simulate import SimulationJob, parse_effect, parse_effects, simulate
from tests.unit.tilt_recipe import THREE_RUNS, tilt


@pytest.mark.parametrize("name", ["offset-temperature", "gain-temperature"])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_readings_change_by_the_polynomial_that_the_truth_states(name: str, degree: int) -> None:
    recipe = tilt(runs=THREE_RUNS)
    job = SimulationJob(recipe, ("A", "B"), 3, (parse_effect(name, recipe, "2e-4", {"degree": str(degree)}),))
    made, plain = simulate(job), simulate(replace(job, effects=()))
    rows = truth.document(job, [made])["effects"][0]["parameters"]
    c = {(r["name"], r["of"], r["axis"]): r["value"] for r in rows}
    if degree > 1:
        assert c["degree", "common", None] == degree and c["about", "common", None] == 25.0
    off = made.scene.require("temperature_degC") - 25.0
    visits = made.scene.visits
    true = np.einsum("vji,vj->vi", np.einsum("vij,vjk->vik", visits.nest_R, visits.seat_R), visits.stimulus)
    felt = true[made.scene.visit] if name == "gain-temperature" else np.ones((len(off), 3))
    unit = np.array(visits.unit.names)[visits.unit.code][made.scene.visit]
    for i, axis in enumerate("xyz"):
        for serial in ("A", "B"):
            powers = ("coefficient", "coefficient2", "coefficient3")[:degree]
            slope = sum(c[p, f"unit:{serial}", axis] * off ** (n + 1) for n, p in enumerate(powers))
            change = (made.table.reading - plain.table.reading)[:, i]
            here = unit == serial
            np.testing.assert_allclose(change[here], (slope * felt[:, i])[here], atol=1e-12)


def test_a_model_file_carries_degree_and_middle() -> None:
    recipe = tilt(runs=THREE_RUNS)
    job = SimulationJob(recipe, ("A", "B"), 3, (parse_effect("offset-temperature", recipe, "2e-4", {"degree": "3"}),))
    made = simulate(job)
    rows = truth.document(job, [made])["effects"][0]["parameters"]
    again = Model(effects=(ModelEffect(effect="offset-temperature", parameters=tuple(rows)),))
    loaded = Model.model_validate(again.document())
    same = simulate(replace(job, effects=(), model=loaded))
    np.testing.assert_allclose(same.table.reading, made.table.reading, atol=1e-12)


def test_units_that_a_model_does_not_know_get_coefficients_of_the_same_size() -> None:
    recipe = tilt(runs=THREE_RUNS)
    job = SimulationJob(recipe, ("A",), 3, (parse_effect("offset-temperature", recipe, "2e-4", {"degree": "2"}),))
    rows = truth.document(job, [simulate(job)])["effects"][0]["parameters"]
    model = Model(effects=(ModelEffect(effect="offset-temperature", parameters=tuple(rows)),))
    other = simulate(SimulationJob(recipe, ("B",), 4, model=model))
    c = other.active["0/offset-temperature"].coefficients
    assert np.sqrt(np.mean(c[:, :3] ** 2)) == pytest.approx(2e-4)


@pytest.mark.parametrize(
    ("requested", "words"),
    [
        ("offset-temperature=1e-4,degree=4", "degree of offset-temperature is '4'; write a number from 1 to 3"),
        ("warm-up=5e-4,tau=3", "warm-up has no form parameter 'tau'; it has time_constant_s"),
        ("warm-up,time_constant=soon", "time_constant_s of warm-up is 'soon'"),
    ],
)
def test_a_form_that_is_none_is_refused_in_one_sentence(requested: str, words: str) -> None:
    with pytest.raises(StationError, match=words):
        parse_effects([requested], tilt())


def test_forms_stand_behind_the_size() -> None:
    slow, turned = parse_effects(["warm-up=5e-4,time_constant_s=60", "axis-permutation=-y,x,z"], tilt())
    assert (slow.size, getattr(slow, "time_constant_s")) == (5e-4, 60.0)  # noqa: B009
    assert turned.value_of(turned.size) == "-y,x,z"


def test_a_power_cycle_ends_where_the_device_was_powered_anew() -> None:
    scene = scene_of_plan(tilt(runs=THREE_RUNS), ("A", "B"), seed=1)
    code, names = power_cycles(scene)
    assert names == tuple(f"power-on:{u}/{r}" for u in "AB" for r in range(3))
    np.testing.assert_array_equal(code, scene.codes("run"))
    since = scene.require("since_power_s").copy()
    late = (scene.visits.unit.code[scene.visit] == 0) & (scene.visits.run[scene.visit] == 1)
    late &= scene.visits.visit[scene.visit] >= 12
    since[late] = scene.time_s[late] - scene.time_s[late].min() + 5.0
    code, names = power_cycles(replace(scene, since_power_s=since))
    assert len(names) == 7
    assert np.unique(code[scene.visit[late]]).tolist() == [2]
    powered_once = replace(scene, since_power_s=scene.require("started_s") + scene.time_s + 100.0)
    assert power_cycles(powered_once)[1] == ("power-on:A/0", "power-on:B/0")


def test_physics_and_remedy_stand_without_docstrings() -> None:
    program = (
        "from station.model import catalogue; rows = catalogue.rows(); "
        "assert len(rows) > 35; print(all(r['physics'] and r['remedy'] for r in rows))"
    )
    done = subprocess.run([sys.executable, "-OO", "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"
