"""`station calibrate`, `check` and `segment` through the command line: documents, sentences, exit codes."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from station import plugins
from station.adapters.samples import read_samples, write_samples
from station.cli.app import main
from station.config.recipes import load_recipe
from station.domain.core.types import SampleTable
from station.domain.recipe import plan
from station.domain.recipe.readings import converting_kind
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

Printed = tuple[int, str, str]
RECIPES = sorted((Path(__file__).parents[2] / "recipes").glob("*.yaml"))


@pytest.fixture
def station(capfd: pytest.CaptureFixture[str]) -> Callable[..., Printed]:
    """Runs a command; gives exit code, standard output, standard error."""

    def run(*args: Any) -> Printed:
        with pytest.raises(SystemExit) as stopped:
            main([str(a) for a in args])
        out, err = capfd.readouterr()
        return int(stopped.value.code or 0), out, err

    return run


def samples(folder: Path, name: str = "six-point", units: int = 2, seed: int = 1) -> Path:
    recipe = load_recipe(name)
    rng = np.random.default_rng(seed)
    mean = tumble.readings(tumble.units(rng, units), tumble.truths(recipe))
    path = folder / f"{name}.csv"
    write_samples(tumble.table(recipe, mean, 1e-3, 40, rng), path)
    return path


def changed(path: Path, change: Callable[[SampleTable], SampleTable]) -> Path:
    write_samples(change(read_samples(path)), path)
    return path


def test_the_document_of_the_contract(tmp_path: Path, station: Callable[..., Printed]) -> None:
    code, out, err = station("calibrate", "--samples", samples(tmp_path), "--recipe", "six-point", "--json", "-")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert (found["schema"], found["method"], found["unit"]) == ("station.calibration/1", "six-point", "g")
    unit = found["units"][0]
    assert (unit["serial"], unit["outcome"], unit["reasons"]) == ("SN00000", "PASS", [])
    assert np.shape(unit["offset"]) == (3,)
    assert np.shape(unit["matrix"]) == (3, 3)
    assert np.shape(unit["covariance"]) == (12, 12)
    assert np.linalg.eigvalsh(unit["covariance"]).min() > -1e-20
    assert {"name", "residual", "tilt_deg", "tilt_std_deg"} <= set(unit["positions"][0])
    assert 0 <= unit["false_accept"] <= 1 and 0 <= unit["false_reject"] <= 1
    assert len(unit["budget"]) == 12
    assert unit["budget"][0]["coefficient"] == "offset x"


def test_a_file_for_programs_and_a_table_for_people(tmp_path: Path, station: Callable[..., Printed]) -> None:
    args = ["calibrate", "--samples", samples(tmp_path), "--recipe", "six-point", "--budget", "--compare-models"]
    code, out, err = station(*args, "--json", tmp_path / "out.json", "--pictures", tmp_path / "pictures")
    assert (code, err) == (0, "")
    assert "2 of 2 units pass" in out and "guarded acceptance" in out and "standard uncertainty by cause" in out
    assert "quadratic and cubic terms: not compared" in out, "six faces cannot tell them"
    assert len(json.loads((tmp_path / "out.json").read_text())["units"]) == 2
    assert len(list((tmp_path / "pictures").glob("SN00001-*.svg"))) == 3
    assert not list(tmp_path.glob("*.part"))


def test_a_unit_beyond_a_limit_is_exit_code_1_with_the_reason(tmp_path: Path, station: Callable[..., Printed]) -> None:
    path = changed(
        samples(tmp_path), lambda t: replace(t, reading=t.reading + np.where(t.unit.code == 1, 0.2, 0.0)[:, None])
    )
    code, out, _ = station("calibrate", "--samples", path, "--recipe", "six-point", "--json", "-")
    assert code == 1
    units = json.loads(out)["units"]
    assert [u["outcome"] for u in units] == ["PASS", "FAIL"]
    assert any("offset x is +0." in reason and "beyond 0.08" in reason for reason in units[1]["reasons"])


def test_a_unit_without_enough_visits_does_not_stop_the_others(tmp_path: Path, station: Callable[..., Printed]) -> None:
    path = changed(samples(tmp_path), lambda t: t[(t.unit.code == 0) | (t.visit < 2)])
    code, out, err = station("calibrate", "--samples", path, "--recipe", "six-point", "--json", "-")
    assert code == 2
    units = json.loads(out)["units"]
    assert [u["outcome"] for u in units] == ["PASS", "ERROR"]
    assert units[1]["offset"] is None
    assert "Unit SN00001 cannot be calibrated: it was never at x-up" in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        (lambda t: t[t.visit == 0], "was never at"),
        (lambda t: t[:1], "was never at"),
        (
            lambda t: replace(t, position=type(t.position)(("zup", *t.position.names[1:]), t.position.code)),
            "nearest name is 'z-up'",
        ),
        (lambda t: replace(t, visit=np.where(t.visit == 1, 0, t.visit).astype(np.int32)), "is at two positions"),
    ],
)
def test_samples_that_cannot_be_used_are_one_sentence(
    tmp_path: Path, station: Callable[..., Printed], change: Callable[[SampleTable], SampleTable], shown: str
) -> None:
    path = changed(samples(tmp_path, units=1), change)
    code, out, err = station("calibrate", "--samples", path, "--recipe", "six-point")
    assert (code, out) == (2, "")
    assert shown in err and len(err.splitlines()) == 1


def test_constant_readings_fail_with_a_reason(tmp_path: Path, station: Callable[..., Printed]) -> None:
    path = changed(samples(tmp_path, units=1), lambda t: replace(t, reading=np.zeros_like(t.reading)))
    code, out, _ = station("calibrate", "--samples", path, "--recipe", "six-point", "--json", "-")
    assert code == 1
    assert any("stuck" in reason for reason in json.loads(out)["units"][0]["reasons"])


def test_an_overdue_gold_sensor_stops_the_line(tmp_path: Path, station: Callable[..., Printed]) -> None:
    gold = {"serial": "G7", "due": "2020-01-31"}
    text = yaml.safe_load((RECIPES[0].parent / "six-point.yaml").read_text())
    text |= {"reference": {"source": "gold", "gold": gold}, "product": None}
    (tmp_path / "gold.yaml").write_text(yaml.safe_dump({k: v for k, v in text.items() if v is not None}))
    code, out, err = station("calibrate", "--samples", samples(tmp_path), "--recipe", tmp_path / "gold.yaml")
    assert (code, out) == (3, "")
    assert "gold reference G7 expired on 2020-01-31" in err


def test_check_tells_what_a_recipe_will_know(station: Callable[..., Printed]) -> None:
    code, out, err = station("check", "n-point", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["schema"] == "station.check/1"
    assert len(found["predicted"]["coefficients"]) == 12
    assert found["design"]["rank"] == 4 and found["design"]["d_efficiency"] == pytest.approx(1.0)
    assert {d["kind"] for d in found["predicted"]["decisions"]} == {"offset", "gain", "cross_axis", "verification"}
    assert found["cycle_s"] > 14 * 1.3


def test_check_refuses_what_cannot_be_determined(tmp_path: Path, station: Callable[..., Printed]) -> None:
    text = (RECIPES[0].parent / "six-point.yaml").read_text().replace("method: six-point", "method: norm")
    (tmp_path / "norm.yaml").write_text(text)
    code, out, err = station("check", tmp_path / "norm.yaml")
    assert (code, out) == (2, "")
    assert "rank 6 of 9" in err and "best first" in err


def test_proposed_positions_can_be_pasted(tmp_path: Path, station: Callable[..., Printed]) -> None:
    code, out, _ = station("check", "norm", "--design", "12")
    assert code == 0
    text = yaml.safe_load((RECIPES[0].parent / "norm.yaml").read_text())
    (tmp_path / "new.yaml").write_text(yaml.safe_dump(text | yaml.safe_load(out)))
    code, out, _ = station("check", tmp_path / "new.yaml", "--json")
    assert code == 0
    assert json.loads(out)["design"]["d_efficiency"] > 0.999


@pytest.mark.parametrize("path", RECIPES, ids=lambda p: p.stem)
def test_every_recipe_that_ships_is_accepted(path: Path, station: Callable[..., Printed]) -> None:
    code, _, err = station("check", path)
    assert (code, err) == (0, "")


def sensors_and_methods() -> set[tuple[str, str]]:
    kinds = plugins.names("station.domain.recipe.sensors")
    usual = ("one-point", "three-point", "six-point", "n-point")
    own = {kind: converting_kind(kind) for kind in kinds}
    return {(k, m) for k, found in own.items() for m in (usual if found is None else found.methods)}


def test_there_is_a_recipe_for_every_sensor_with_one_three_six_and_more_points() -> None:
    found = {(r.sensor, r.method) for r in map(load_recipe, RECIPES)}
    assert sensors_and_methods() <= found


@pytest.mark.parametrize("path", [p for p in RECIPES if load_recipe(p).pose_known], ids=lambda p: p.stem)
def test_every_recipe_that_ships_calibrates_ordinary_units(
    path: Path, station: Callable[..., Printed], tmp_path: Path
) -> None:
    recipe = load_recipe(path)
    rng = np.random.default_rng(4)
    size = max(float(np.linalg.norm(tumble.truths(recipe), axis=1).max()), 1.0)
    theta = tumble.units(rng, 2, size)
    theta[:, 3:] = np.eye(3).ravel()
    theta[:, recipe.axes : 3] = 0.0
    noise = max(recipe.device.lsb, 1e-4 * size)
    write_samples(
        tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), noise, 30, rng), tmp_path / "t.parquet"
    )
    code, out, _ = station("calibrate", "--samples", tmp_path / "t.parquet", "--recipe", path, "--json", "-")
    found = json.loads(out)
    assert code == 0, found["units"][0]["reasons"]
    for unit, true in zip(found["units"], theta, strict=True):
        std = np.sqrt(np.diagonal(unit["covariance"]))
        off = np.abs(np.r_[unit["offset"], np.ravel(unit["matrix"])] - true)
        assert (off <= 5 * std + 1e-12).all()


def test_segment_makes_a_table_that_calibrates(tmp_path: Path, station: Callable[..., Printed]) -> None:
    """Counts from a hand-held unit, with a header; named by a recipe's positions."""
    recipe = load_recipe("six-point")
    rng = np.random.default_rng(3)
    still = np.repeat(tumble.truths(recipe), 300, axis=0)
    turning = rng.standard_normal((6, 100, 3))
    reading = np.concatenate([np.r_[still[300 * i : 300 * i + 300], turning[i]] for i in range(6)])
    counts = np.round(32768 + 4000 * (reading + 1e-3 * rng.standard_normal(reading.shape)))
    rows = "\n".join(f"{i / 100},{a:.0f},{b:.0f},{c:.0f}" for i, (a, b, c) in enumerate(counts))
    (tmp_path / "raw.csv").write_text(f"t,ax,ay,az\n{rows}\n")
    args = ["segment", tmp_path / "raw.csv", "--columns", "t,ax,ay,az", "--zero", "32768", "--scale", "0.00025"]
    code, out, err = station(*args, "--recipe", "six-point", "--serial", "SN0001", "--out", tmp_path / "t.csv")
    assert (code, err) == (0, "")
    assert "6 visits are in" in out
    code, out, _ = station("calibrate", "--samples", tmp_path / "t.csv", "--recipe", "six-point", "--json", "-")
    (unit,) = json.loads(out)["units"]
    assert unit["serial"] == "SN0001"
    assert unit["offset"] == pytest.approx([0, 0, 0], abs=5e-4)


@pytest.mark.parametrize(
    ("text", "columns", "shown"),
    [
        ("a,b,c,d\n1,2,3,4\n", "t,x,y,z", "has no column 't'; the nearest is"),
        ("1 2 3\n4 5 6\n", "0,1,2,3", "no column '3': give numbers from 0 to 2"),
        ("1 2 3 4\n", "0,1", "names 2 columns"),
        ("1 2 3 4\n2 2 3 nan\n", "0,1,2,3", "1 of 2 rows lack a reading"),
        ("1 2 3 4\n" * 5, "0,1,2,3", "every stamp is the same"),
        ("1 2 3 4\n2 2 3 4\n3 2 3 4\n", "0,1,2,3", "too short"),
        ("", "0,1,2,3", "is empty"),
    ],
)
def test_a_recording_that_is_none_is_one_sentence(
    tmp_path: Path, station: Callable[..., Printed], text: str, columns: str, shown: str
) -> None:
    (tmp_path / "raw.txt").write_text(text)
    code, out, err = station("segment", tmp_path / "raw.txt", "--columns", columns, "--out", tmp_path / "t.csv")
    assert (code, out) == (2, "")
    assert shown in err and len(err.splitlines()) == 1


def test_a_plan_and_its_recipe_agree_on_the_truth() -> None:
    """Guards the helper above: truths of a recipe are those of its plan."""
    recipe: Recipe = load_recipe("gyroscope-n-point")
    assert tumble.truths(recipe)[0] == pytest.approx(plan.planned_visits(recipe, 0)[0].true)
