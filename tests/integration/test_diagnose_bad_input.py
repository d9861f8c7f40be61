"""Samples tables that nothing can be told from: one sentence, never a traceback, never a name."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from station.cli import _diagnosis_samples
from station.cli.app import main

UP = {"z-up": (0, 0, 1), "z-down": (0, 0, -1), "x-up": (1, 0, 0), "x-down": (-1, 0, 0), "y-up": (0, 1, 0)}
HEAD = "unit,run,visit,position,time_s,x,y,z"


def table(path: Path, positions: list[str], rows: int, noise_g: float, rng: np.random.Generator) -> Path:
    lines = [HEAD]
    for visit, name in enumerate(positions):
        for k in range(rows):
            x, y, z = np.array(UP[name]) + noise_g * rng.standard_normal(3)
            lines.append(f"A,0,{visit},{name},{2 * visit + 0.01 * k:.2f},{x},{y},{z}")
    path.write_text("\n".join(lines) + "\n")
    return path


def diagnosed(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", "--recipe", "six-point", "--samples", str(path), "--json", "-"])
    out, err = capsys.readouterr()
    return int(str(ended.value.code)), out or err


@pytest.mark.parametrize(
    ("positions", "rows", "noise_g", "words"),
    [
        (["z-up"], 100, 1e-3, "of one visit: measure at least two positions"),
        (["z-up"] * 3, 1, 0.0, "the same in every row"),
    ],
)
def test_too_little_is_one_sentence(
    positions: list[str],
    rows: int,
    noise_g: float,
    words: str,
    tmp_path: Path,
    rng: np.random.Generator,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = table(tmp_path / "few.csv", positions, rows, noise_g, rng)
    code, shown = diagnosed(path, capsys)
    assert code == 2
    assert f"{path}: " in shown
    assert words in shown
    assert shown.count("\n") == 1


def test_units_of_one_visit_each_are_told_so(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "each.csv", list(UP)[:3], 50, 1e-3, rng)
    rows = pd.read_csv(path)
    rows.assign(unit=[f"SN000{visit}" for visit in rows["visit"]], visit=0).to_csv(path, index=False)
    code, shown = diagnosed(path, capsys)
    assert (code, shown.count("\n")) == (2, 1)
    assert "Each of the 3 units has one visit" in shown


@pytest.mark.parametrize(("positions", "rows"), [(list(UP)[:2], 100), (list(UP), 1), (list(UP), 3)])
def test_little_more_names_nothing_and_says_what_it_could_not_test(
    positions: list[str], rows: int, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    code, shown = diagnosed(table(tmp_path / "little.csv", positions, rows, 1e-3, rng), capsys)
    document = json.loads(shown)
    assert (code, document["verdict"], document["causes"]) == (0, "none", [])
    assert {"offset-temperature", "motor-tone"} <= set(document["not_testable"])


def test_one_stop_left_of_a_unit_tells_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "clipped.csv"
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "--recipe", "six-point", "--units", "6", "--seed", "3", "--effect", "clipping",
              "--out", str(path)])  # fmt: skip
    assert ended.value.code == 0
    capsys.readouterr()
    # Each face puts an axis at 1 g, so only a fixture's tilt spares a stop here and there.
    code, shown = diagnosed(path, capsys)
    assert code == 2
    assert "34 of 36 visits are clipped, and nothing can be told from the rest" in shown
    assert shown.count("\n") == 1


@pytest.mark.parametrize(
    ("command", "words"),
    [("calibrate", "the readings do not lie on an ellipsoid"), ("diagnose", "at rest in 6 orientations only")],
)
def test_a_compass_that_was_only_turned_level_is_refused(
    command: str, words: str, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    turn = np.linspace(0, 4 * np.pi, 60)
    tilt = 0.12 + 0.07 * np.sin(2.5 * turn)
    field = np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)], axis=1)
    reading = field + [0.1, -0.2, 4.5] + 0.01 * rng.standard_normal(field.shape)
    assert words in refusal(command, reading, tmp_path, capsys)


@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
def test_a_part_of_a_sphere_that_many_an_ellipsoid_is_near_is_refused(
    command: str, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    """A diagnosis told of gains of a million."""
    way = rng.standard_normal((60, 3))
    way[:, 0] = 0.3 + 0.8 * np.abs(way[:, 0])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    reading = way * (1 + 0.06 * rng.standard_normal((60, 1))) + [0.1, -0.2, 0.3]
    assert "the readings do not lie on an ellipsoid" in refusal(command, reading, tmp_path, capsys)


@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
def test_axes_in_different_units_are_told_by_the_odd_one(
    command: str, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    pose = rng.standard_normal((30, 3))
    pose /= np.linalg.norm(pose, axis=1, keepdims=True)
    reading = pose * [0.2, 0.2, 1.96] + 1e-4 * rng.standard_normal(pose.shape)
    assert "Unit A: axis z responds 9.8 times" in refusal(command, reading, tmp_path, capsys)
    # So large an axis hides that the unit was turned at all.
    reading = pose * [1.0, 1000.0, 1.0] + 1e-3 * rng.standard_normal(pose.shape)
    assert "Unit A: axis y responds" in refusal(command, reading, tmp_path, capsys)


@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
@pytest.mark.parametrize(("shaken", "words"), [(True, "this is shaking or noise"), (False, "visits move by")])
def test_what_is_no_tumble_is_told_with_its_file(
    shaken: bool, words: str, command: str, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    samples, row = faces(rng), np.arange(200)
    moved = 3 * rng.standard_normal((200, 3)) if shaken else np.sin(0.3 * row)[:, None] * [1.0, 0.7, 0.2]
    path = tmp_path / "driven.csv"
    samples.assign(**{axis: samples[axis] + moved[:, i] for i, axis in enumerate("xyz")}).to_csv(path, index=False)
    with pytest.raises(SystemExit) as ended:
        main([command, "--recipe", "six-point", "--samples", str(path)])
    out, err = capsys.readouterr()
    assert (ended.value.code, out, err.count("\n")) == (2, "", 1)
    assert f"{path}: " in err
    assert words in err


def refusal(command: str, reading: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says of single readings (v, 3) in a hand."""
    rows = [f"A,0,{i},p{i},{i},{x},{y},{z}" for i, (x, y, z) in enumerate(reading)]
    path = tmp_path / "compass.csv"
    path.write_text("\n".join([HEAD, *rows]) + "\n")
    with pytest.raises(SystemExit) as ended:
        main([command, "--recipe", "hand-held", "--samples", str(path)])
    out, err = capsys.readouterr()
    assert (ended.value.code, out) == (2, "")
    assert (err.count("\n"), err.count(str(path))) == (1, 1)
    return err


def faces(rng: np.random.Generator) -> pd.DataFrame:
    """Two units at five faces, twenty samples a stop."""
    rows = [
        {"unit": unit, "run": 0, "visit": v, "position": name, "time_s": 2 * v + 0.01 * k, "seating": "home",
         **dict(zip("xyz", np.array(up) + 1e-3 * rng.standard_normal(3), strict=True)), "since_power_s": 2.0 + v}
        for unit in "AB" for v, (name, up) in enumerate(UP.items()) for k in range(20)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def changed(table: pd.DataFrame, column: str, value: object, rows: slice = slice(None)) -> pd.DataFrame:
    table = table.astype({column: object})
    table.loc[table.index[rows], column] = value
    return table.infer_objects()


@pytest.mark.parametrize("kind", ["csv", "parquet"])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.drop(columns="z"), " has no column z; a samples table needs "),
        (lambda t: t[["seating"]], " has none of the columns of a samples table (unit, run, "),
        (lambda t: t.rename(columns={"seating": "seatin"}), "did you mean 'seating'?"),
        (lambda t: changed(t, "y", np.inf, slice(7, 8)), "@7, column y: inf is not a finite number"),
        (
            lambda t: changed(t, "position", "z-upp", slice(40, 60)),
            "@40, column position: 'z-upp' is not in recipe",
        ),
        (lambda t: changed(t, "seating", "sideways"), "@0, column seating: 'sideways' is not in recipe six-point"),
        (lambda t: t.sample(frac=1, random_state=1), "rows; sort the rows by unit, run and time"),
        (lambda t: t.assign(z=1000 * t["z"]), "Unit A: column z is in another unit of measure than the others"),
        (lambda t: t.assign(x=0.5), "The readings of x are the same in every row"),
        (lambda t: t.assign(x=np.where(t["unit"] == "B", 0.5, t["x"])), "Unit B: the readings of x are the same"),
        (lambda t: t.assign(time_s=0.0), "time_s does not advance within any visit"),
        (lambda t: t.assign(visit=0), "unit A, run 0, visit 0 is at two positions, z-up and z-down: number the stops"),
        (lambda t: t.assign(run=-1), "column run: -1 is not a whole number from 0"),
        (lambda t: t.assign(since_power_s=-1.0), "since_power_s is -1, but a time elapsed cannot be negative"),
        (
            lambda t: t.assign(started_s=np.where(t.unit == "B", 1e12, 0.0)),
            "more than a century: give seconds on one clock",
        ),
    ],
)
def test_a_table_that_is_wrong_is_one_sentence(
    kind: str,
    change: Callable[[pd.DataFrame], pd.DataFrame],
    words: str,
    tmp_path: Path,
    rng: np.random.Generator,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, table = tmp_path / f"wrong.{kind}", change(faces(rng))
    table.to_csv(path, index=False) if kind == "csv" else table.to_parquet(path, index=False)
    code, shown = diagnosed(path, capsys)
    row = words.partition(",")[0][1:] if words.startswith("@") else ""
    place = f"line {int(row) + 2}" if row and kind == "csv" else f"row {int(row) + 1}" if row else ""
    assert code == 2
    assert (f"{path}, {place}{words[len(row) + 1 :]}" if row else words) in shown
    assert (shown.count("\n"), shown.count(str(path))) == (1, 1)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_more_rows_than_fit_are_refused_before_they_are_read(
    kind: str,
    tmp_path: Path,
    rng: np.random.Generator,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, table = tmp_path / f"large.{kind}", faces(rng)
    table.to_csv(path, index=False) if kind == "csv" else table.to_parquet(path, index=False)
    monkeypatch.setattr(_diagnosis_samples, "MOST_ROWS", 150)
    code, shown = diagnosed(path, capsys)
    assert code == 2
    assert "holds about 20" in shown
    assert "the limit is 150: diagnose some of the units" in shown


def test_a_gap_in_a_covariate_is_said(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "gap.csv"
    faces(rng).assign(temperature_degC=np.where(np.arange(200) % 2 == 1, np.nan, 25.0)).to_csv(path, index=False)
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", "--recipe", "six-point", "--samples", str(path), "--json", "-"])
    out, err = capsys.readouterr()
    assert ended.value.code == 0
    assert "temperature_degC is not known in every row, so no cause is attributed to it" in err
    assert "offset-temperature" in json.loads(out)["not_testable"]


def test_corrupt_values_cost_no_visit_and_are_said(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    table = faces(rng).assign(temperature_degC=25.0)
    table.loc[45, ["x", "temperature_degC"]] = 16.0, -127.0
    table.loc[130, "time_s"] = 1e9
    path = tmp_path / "corrupt.csv"
    table.to_csv(path, index=False)
    for command in ("diagnose", "calibrate"):
        with pytest.raises(SystemExit):
            main([command, "--recipe", "six-point", "--samples", str(path), "--json", "-"])
        out, _ = capsys.readouterr()
        checked = json.loads(out)["preflight"]
        assert [remark["id"] for remark in checked["remarks"]][:3] == [
            "reading-outliers", "stamp-outliers", "values-filled",
        ]  # fmt: skip
        assert (checked["left_out"], checked["temperature_degC"]) == ([], [25.0, 25.0])
