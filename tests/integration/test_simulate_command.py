"""`station simulate` and `station effects` as a person uses them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.adapters.annotations import read_marks
from station.adapters.bus import read_log
from station.adapters.samples import read_samples
from station.config.recipes import recipe_path
from station.model.effects.axis_permutation import MAPPINGS
from tests.fakes.command import station


def truth_of(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_a_table_and_its_truth(ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Readings of the table are what the truth says: matrix · true + offset + c · a², to the noise of a mean."""
    out = tmp_path / f"s.{ending}"
    assert (
        station("simulate", "--recipe", "six-point", "--units", "2", "--effect", "quadratic=0.01", "--out", str(out))
        == 0
    )
    assert capsys.readouterr().out.startswith("2 units with quadratic, seed 1")
    table, truth = read_samples(out), truth_of(tmp_path / "s.truth.json")
    assert len(table) == 2 * 6 * 100
    for unit in truth["units"]:
        mine = (table.unit.text() == unit["serial"]) & (table.position.text() == "x-up")
        c = [p["value"] for p in truth["effects"][0]["parameters"] if p["of"] == f"unit:{unit['serial']}"]
        wanted = np.array(unit["matrix"])[:, 0] + unit["offset"] + np.array([c[0], 0, 0])
        # 71 µg of noise in a mean of 100, five standard deviations.
        np.testing.assert_allclose(table.reading[mine].mean(axis=0), wanted, atol=3.6e-4)
    assert set(table.labels) >= {"nest", "operator", "lot", "station", "seating"}
    assert set(table.values) >= {"temperature_degC", "since_power_s", "since_clamp_s", "motor", "started_s", "counter"}


def test_equal_seeds_write_equal_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written = []
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        args = ("--recipe", "six-point", "--units", "1", "--seed", seed, "--effect", "nest-tilt")
        assert station("simulate", *args, "--out", str(tmp_path / f"{name}.csv")) == 0
        written.append((tmp_path / f"{name}.csv").read_bytes())
    assert written[0] == written[1] != written[2]
    assert capsys.readouterr().out.startswith("1 unit with nest-tilt, seed 3")


def test_frames_and_marks_replay_to_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "f.log"
    assert station("simulate", "--recipe", "six-point", "--units", "3", "--out", str(out), "--json") == 0
    assert json.loads(capsys.readouterr().out)["schema"] == "station.simulation/1"
    truth = truth_of(tmp_path / "f.truth.json")
    assert len(read_marks(tmp_path / "f.log.marks.csv").marks) == 3 * 6
    assert np.diff(read_log(out).time_ns).min() >= 0
    station("replay", str(out), "--recipe", "six-point", "--json")
    found = {u["serial"]: u for u in json.loads(capsys.readouterr().out)["units"]}
    for unit in truth["units"]:
        # A face's mean is good to 71 µg and half a step of 62 µg; five standard deviations of offset and gain.
        np.testing.assert_allclose(found[unit["serial"]]["offset"], unit["offset"], atol=5e-4)
        np.testing.assert_allclose(found[unit["serial"]]["matrix"], unit["matrix"], atol=5e-4)


def test_lost_frames_reach_the_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, holed = tmp_path / "a.log", tmp_path / "b.log"
    assert station("simulate", "--recipe", "six-point", "--units", "1", "--out", str(whole)) == 0
    args = ("--recipe", "six-point", "--units", "1", "--effect", "lost-frames=0.2")
    assert station("simulate", *args, "--out", str(holed)) == 0
    sent, came = (len(read_log(path)) for path in (whole, holed))
    assert sent - came == pytest.approx(0.2 * sent, abs=5 * np.sqrt(0.16 * sent) + 25)
    capsys.readouterr()


def test_a_model_file_is_simulated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "m.yaml"
    model.write_text(
        "schema: station.model/1\n"
        "noise: {density: 0.0, flicker: 0.0}\n"
        "spread: {offset_std: 0.0, gain_std: 0.0}\n"
        "effects:\n"
        "  - effect: group-offset\n"
        "    parameters: [{name: offset, axis: x, of: 'operator:O1', value: 0.25, unit: g}]\n",
        encoding="utf-8",
    )
    out = tmp_path / "s.csv"
    args = ("--recipe", "six-point", "--units", "1", "--operators", "1", "--model", str(model))
    assert station("simulate", *args, "--out", str(out)) == 0
    table = read_samples(out)
    up = table.position.text() == "z-up"
    np.testing.assert_allclose(table.reading[up], [[0.25, 0.0, 1.0]] * 100, atol=3.2e-5)
    capsys.readouterr()


@pytest.mark.parametrize(
    ("args", "printed"),
    [
        (["--out", "s.csv", "--effect", "quadratc"], "There is no effect 'quadratc'; the nearest are quadratic, "),
        (["--out", "s.csv", "--effect", "quadratic=big"], "Size 'big' of quadratic is not a number"),
        (["--out", "s.csv", "--effect", "quadratic="], "Size '' of quadratic is not a number"),
        (["--out", "s.csv", "--effect", "axis-permutation=x,y"], "must name each axis once"),
        (["--out", "s.csv", "--effect", "step", "--effect", "step=2"], "Effect step is given 2 times"),
        (["--out", "s.xlsx"], "the file's ending must be one of .parquet, .csv, .log, .blf"),
        (["--out", "s"], "ending must be one of .parquet"),
        (["--out", "nowhere/s.csv"], "the folder nowhere does not exist"),
        (["--out", "s.csv", "--model", "none.yaml"], "none.yaml cannot be read"),
        (["--out", "s.csv", "--units", "none"], "--units"),
        (["--out", "s.csv", "--seed", "-1"], "--seed"),
        ([], "--out"),
    ],
)
def test_mistakes_are_one_sentence(
    args: list[str], printed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert station("simulate", *args) == 2
    shown = capsys.readouterr()
    assert printed in shown.err and shown.err.count("\n") == 1 and not shown.out
    assert not list(tmp_path.iterdir())


def test_a_recipe_of_no_product_has_no_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recipe = tmp_path / "nobodys.yaml"
    printed = recipe_path("tilt-24").read_text(encoding="utf-8")
    recipe.write_text(printed.replace("product: accelerometer\n", ""), encoding="utf-8")
    assert station("simulate", "--out", str(tmp_path / "s.log"), "--recipe", str(recipe)) == 2
    assert "names no product, so its frames are unknown: add --product" in capsys.readouterr().err


def test_a_folder_in_the_way_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s.csv").mkdir()
    assert station("simulate", "--units", "1", "--out", str(tmp_path / "s.csv")) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_every_cause_can_be_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All 36 at once, by the ids that `station effects` lists."""
    assert station("effects", "--json") == 0
    listed = [row["effect"] for row in json.loads(capsys.readouterr().out)["effects"]]
    requested = [part for name in listed for part in ("--effect", name)]
    out = tmp_path / "s.parquet"
    assert station("simulate", "--units", "2", *requested, "--out", str(out)) == 0
    truth = truth_of(tmp_path / "s.truth.json")
    assert [e["effect"] for e in truth["effects"]] == listed
    mapping = next(e for e in truth["effects"] if e["effect"] == "axis-permutation")["parameters"][0]["value"]
    assert mapping in MAPPINGS
    assert read_samples(out).gold is not None
    capsys.readouterr()


def test_effects_lists_ids_and_sizes(capsys: pytest.CaptureFixture[str]) -> None:
    assert station("effects") == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("nest-tilt ") and "0.002 rad" in line for line in lines)
