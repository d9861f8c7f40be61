"""Files with one pose each: the visits of one unit, not so many units of one pose."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from station.domain.core.types import Floats
from station.wiring.sample_files import read_samples
from tests.fakes.command import station
from tests.integration.test_import import G

AXES = ("x-up", "x-down", "y-up", "y-down", "z-up", "z-down")
MATRIX = np.array([[1.03, 0.004, -0.002], [0.003, 0.96, 0.005], [-0.004, 0.001, 1.01]])


def write_faces(
    folder: Path,
    rng: np.random.Generator,
    *,
    prefix: str = "",
    scale: float = G,
    zero: float = 0.0,
    readings: int = 500,
    unit: str = "",
) -> list[str]:
    """A file a face, as (time, x, y, z [unit]); in counts where the scale is 1,000 or more."""
    folder.mkdir(exist_ok=True)
    written = []
    for i, name in enumerate(AXES):
        true = np.zeros(3)
        true[i // 2] = 1 - 2 * (i % 2)
        y: Floats = zero + scale * (MATRIX @ true + [0.02, -0.01, 0.03] + 3e-4 * rng.standard_normal((readings, 3)))
        y = np.round(y) if scale >= 1000 else y
        table = pd.DataFrame(
            np.c_[np.arange(readings) / 100, y], columns=["time_s", *(f"a{axis}{unit}" for axis in "xyz")]
        )
        table.to_csv(folder / f"{prefix}{name}.csv", index=False)
        written.append(str(folder / f"{prefix}{name}.csv"))
    return written


def recordings(capsys: pytest.CaptureFixture[str], files: Sequence[str], *options: str) -> list[dict[str, object]]:
    code = station("import", *files, *options, "--json")
    shown = capsys.readouterr()
    assert code == 0, shown.err
    return list(json.loads(shown.out)["recordings"])


@pytest.mark.parametrize(
    ("scale", "zero", "readings"), [(G, 0.0, 500), (16384.0, 0.0, 500), (16384.0, 32768.0, 500), (1.0, 0.0, 90)]
)
def test_a_file_a_face_is_one_unit_on_one_scale(
    rng: np.random.Generator,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    scale: float,
    zero: float,
    readings: int,
) -> None:
    files, out = write_faces(tmp_path, rng, scale=scale, zero=zero, readings=readings), str(tmp_path / "s.parquet")
    (one,) = recordings(capsys, files, "--recipe", "six-point", "--serial", "SN7", "--out", out)
    assert (one["unit"], one["visits"], one["visits_by"], one["poses"]) == ("SN7", 6, "files", 6)
    assert one["remarks"][0]["id"] == "files-of-one-unit"  # type: ignore[index]
    table = read_samples(Path(out))
    assert (len(table.unit.names), len(np.unique(table.visit))) == (1, 6)
    assert station("calibrate", "--samples", out, "--recipe", "six-point", "--json", "-") in (0, 1)
    (unit,) = json.loads(capsys.readouterr().out)["units"]
    # The gains stay in the readings, for one scale holds for all files.
    assert np.diag(unit["matrix"]) == pytest.approx(np.diag(MATRIX), abs=5e-4)


@pytest.mark.parametrize(("unit", "scale"), [(" [m/s^2]", 1.0), (" [g]", G), (" [g]", 16384.0)])
def test_all_faces_together_contradict_their_headers(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str, scale: float
) -> None:
    files = write_faces(tmp_path, rng, scale=scale, unit=unit)
    (one,) = recordings(capsys, files)
    assert (one["scale"], one["poses"]) == (pytest.approx(1 / scale), 6)
    assert [r["id"] for r in one["remarks"]][:1] == ["header-unit-wrong"]  # type: ignore[attr-defined]
    (held,) = recordings(capsys, files, "--unit", unit.strip(" []"))
    assert "header-unit-wrong" not in [r["id"] for r in held["remarks"]]  # type: ignore[attr-defined]


def test_files_of_two_units_are_told_apart_by_their_names_or_folders(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = [f for serial in ("SN1", "SN2") for f in write_faces(tmp_path, rng, prefix=f"{serial}_")]
    assert [r["unit"] for r in recordings(capsys, named)] == ["SN1", "SN2"]
    filed = [f for serial in ("A", "B") for f in write_faces(tmp_path / serial, rng)]
    assert [(r["unit"], r["visits"]) for r in recordings(capsys, filed)] == [("A", 6), ("B", 6)]


def test_a_unit_a_file_where_that_is_stated_and_what_is_made_of_it(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, out = write_faces(tmp_path, rng), str(tmp_path / "s.parquet")
    assert len(recordings(capsys, files, "--units", "--out", out)) == 6
    for command in ("calibrate", "diagnose"):
        assert station(command, "--samples", out, "--recipe", "hand-held") == 2
        assert "they look like one unit that was turned" in capsys.readouterr().err


def test_files_in_one_orientation_are_units(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    face = write_faces(tmp_path, rng)[4]
    same = [face, *(str(tmp_path / f"unit-{i}.csv") for i in range(3))]
    for copy in same[1:]:
        Path(copy).write_bytes(Path(face).read_bytes())
    assert station("import", *same) == 2
    assert "at rest in one stretch" in capsys.readouterr().err
    assert len(recordings(capsys, same, "--recipe", "one-point")) == 4


def test_short_files_that_move_hold_no_still_pose(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Slides of three seconds along each axis begin and end level: too short to look for rest in, but no poses."""
    files = []
    for i, tilt in enumerate(np.radians([[0, 0], [15, 0], [0, 15]])):
        t = np.arange(60) / 20
        pushed = 0.3 * np.sin(2 * np.pi * t / 3)[:, None] * np.eye(3)[i]
        y = np.array([np.sin(tilt[0]), np.sin(tilt[1]), 1.0]) + pushed + 0.005 * rng.standard_normal((60, 3))
        files.append(str(tmp_path / f"slide-{i}.csv"))
        np.savetxt(files[-1], np.c_[1000 * t, y], "%.3f", ",", header="ms,ax,ay,az", comments="")
    assert station("import", *files) == 2
    assert "too short" in capsys.readouterr().err


def test_six_faces_by_hand_need_no_recipe_stated_and_meet_no_other_device_s_sheet(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Steps and rate of another sensor than six-point states: they were found wrong, and limits of nobody's failed."""
    files, out = write_faces(tmp_path / "faces", rng, prefix="acc_raw_", scale=256.0), str(tmp_path / "s.parquet")
    for file in files:
        table = pd.read_csv(file).round({"ax": 0, "ay": 0, "az": 0})
        table.assign(time_s=table["time_s"] * 4).to_csv(file, index=False)
    assert station("import", *files, "--out", out) == 0
    said = capsys.readouterr().out
    assert "lie on the six faces" in said
    assert f"Next: station calibrate --samples {out} --recipe six-faces" in said
    assert read_samples(Path(out)).position.names == AXES
    assert station("calibrate", "--samples", out, "--recipe", "six-faces", "--json", "-") == 0
    (unit,) = json.loads(capsys.readouterr().out)["units"]
    assert np.diag(unit["matrix"]) == pytest.approx([1.03, 0.96, 1.01], abs=3e-3)
    station("diagnose", "--samples", out, "--recipe", "six-faces", "--json", "-")
    shown = json.loads(capsys.readouterr().out)
    assert {"quantization", "clock-error"}.isdisjoint(cause["effect"] for cause in shown["causes"])


def test_visits_that_are_called_after_the_faces_keep_their_names_unremarked(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, out = write_faces(tmp_path / "faces", rng), str(tmp_path / "s.parquet")
    assert station("import", *files, "--out", out) == 0
    said = capsys.readouterr().out
    assert "called after them" not in said
    assert "--recipe six-faces" in said
