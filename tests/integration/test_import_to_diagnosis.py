"""Real recordings from the file to the story: import or segment, calibrate, diagnose; by commands alone."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.fakes.command import station

HAND_HELD = "hand-held"


def calibrated(samples: str, recipe: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    code = station("calibrate", "--samples", samples, "--recipe", recipe, "--json", "-")
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err
    return code, json.loads(shown.out) if shown.out else {"sentence": shown.err}


def diagnosed(samples: str, recipe: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    code = station("diagnose", "--samples", samples, "--recipe", recipe, "--json", "-")
    shown = capsys.readouterr()
    assert shown.err == ""
    found: dict[str, Any] = json.loads(shown.out)
    assert code == (0 if found["verdict"] == "none" else 1)
    return found


def effects(shown: dict[str, Any]) -> list[str]:
    return [cause["effect"] for cause in shown["causes"]]


@pytest.mark.parametrize("command", ["import", "segment"])
def test_the_xsens_recording_needs_nothing_stated(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    out = str(tmp_path / "s.parquet")
    assert station(command, str(reference_data / "xsens_mti_tumble" / "xsens_acc.mat"), "--out", out) == 0
    capsys.readouterr()
    code, shown = calibrated(out, HAND_HELD, capsys)
    assert code == 0
    (unit,) = shown["units"]
    # Non-orthogonality as its authors found it: 3.4, 9.1 and 21 mrad.
    assert unit["matrix"][0][1:] == pytest.approx([3.4e-3, 9.1e-3], abs=3e-4)
    assert unit["matrix"][1][2] == pytest.approx(21e-3, abs=4e-4)
    checked = shown["preflight"]
    assert (checked["visits"], checked["left_out"]) == (39, [])
    assert checked["rate_hz"] == pytest.approx(100, rel=1e-3)
    assert set(checked["inferred"]) == {"rate_hz", "lsb", "noise_density"}
    found = diagnosed(out, HAND_HELD, capsys)
    assert "quantization" not in effects(found)
    assert "cross-axis" in effects(found)


def test_the_hand_held_blocks_calibrate_and_no_data_sheet_is_held_against_them(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "s.parquet")
    assert station("import", str(reference_data / "ck_handheld" / "acc_log.csv"), "--out", out) == 0
    capsys.readouterr()
    code, shown = calibrated(out, HAND_HELD, capsys)
    assert code == 0
    (unit,) = shown["units"]
    assert unit["residual_rms"] < 1.3e-3
    # One block moves within itself by two degrees: said, and out of both.
    assert len(shown["preflight"]["left_out"]) <= 2
    found = diagnosed(out, HAND_HELD, capsys)
    # What its authors' readers found in it: cross-axis and a square, 1.25 → 1.10 → .81 mg.
    assert (found["verdict"], set(effects(found))) == ("named", {"cross-axis", "quadratic"})
    assert found["extended"]["residual_rms"] < 0.85e-3
    assert found["data"]["visits"] == 160 - len(found["preflight"]["left_out"])


def test_six_faces_by_hand_are_too_few_for_a_magnitude_and_enough_for_positions(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session, out = str(reference_data / "imucal_ferraris" / "example_ferraris_session.csv"), str(tmp_path / "s.parquet")
    assert station("segment", session, "--rate", "102.4", "--out", out) == 0
    capsys.readouterr()
    code, shown = calibrated(out, HAND_HELD, capsys)
    assert code == 2
    assert "6 orientations only, and the magnitude alone needs 9" in shown["sentence"]
    assert station("segment", session, "--rate", "102.4", "--recipe", "six-point", "--out", out) == 0
    capsys.readouterr()
    code, shown = calibrated(out, "six-point", capsys)
    (unit,) = shown["units"]
    # imucal on its own labels: -10.2/9.81 … within the scatter of hand-placed faces.
    assert np.diag(unit["matrix"]) == pytest.approx([0.996, 1.003, 1.024], abs=0.01)


def test_labelled_faces_with_rotations_in_them(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labelled, out = str(reference_data / "imucal_ferraris" / "annotated_session.csv"), str(tmp_path / "s.parquet")
    assert station("import", labelled, "--recipe", "six-point", "--out", out) == 0
    capsys.readouterr()
    code, shown = calibrated(out, "six-point", capsys)
    assert code in (0, 1)
    (unit,) = shown["units"]
    assert np.linalg.norm(unit["offset"]) < 0.1


def test_a_drive_is_no_tumble(reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = reference_data / "css_canmod"
    recording, dbc = folder / "2F6913DB_00000004_00000001.MF4", folder / "canmod-gps.dbc"
    for command in ("import", "segment"):
        assert station(command, str(recording), "--dbc", str(dbc), "--out", str(tmp_path / "s.csv")) == 2
        shown = capsys.readouterr()
        assert "not a tumble" in shown.err
        assert shown.err.count("\n") == 1
    # Cut into blocks by force, it is refused before anything is fitted.
    out = str(tmp_path / "b.csv")
    assert station("import", str(recording), "--dbc", str(dbc), "--blocks", "100", "--out", out) == 0
    capsys.readouterr()
    for command in ("calibrate", "diagnose"):
        assert station(command, "--samples", out, "--recipe", HAND_HELD) == 2
        shown = capsys.readouterr()
        assert shown.err.count("\n") == 1


def test_what_replay_decodes_is_segmented(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = reference_data / "css_canmod"
    signals, dbc = str(tmp_path / "signals.csv"), str(folder / "canmod-gps.dbc")
    recording = str(folder / "2F6913DB_00000004_00000001.MF4")
    assert station("replay", recording, "--dbc", dbc, "--out", signals) == 0
    capsys.readouterr()
    assert station("import", signals, "--raw", "--json") == 0
    (one,) = json.loads(capsys.readouterr().out)["recordings"]
    assert one["axes"] == ["AccelerationX", "AccelerationY", "AccelerationZ"]
    assert one["time_unit"] == "ns"
    assert station("segment", signals, "--out", str(tmp_path / "s.csv")) == 2
    assert "not a tumble" in capsys.readouterr().err


def test_a_compass_turned_all_round_is_calibrated_by_its_magnitude(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A reading a pose; the offset is the hard iron."""
    turned = rng.standard_normal((300, 3))
    turned *= 49 / np.linalg.norm(turned, axis=1, keepdims=True)
    path, out = tmp_path / "compass.csv", str(tmp_path / "compass.parquet")
    reading = turned * [1.04, 0.98, 1.08] + [20, -35, 12] + 0.3 * rng.standard_normal(turned.shape)
    np.savetxt(path, reading, "%.2f", ",", header="mag_x,mag_y,mag_z", comments="")
    assert station("import", str(path), "--out", out) == 0
    capsys.readouterr()
    code, shown = calibrated(out, "magnetometer-hand-held", capsys)
    (unit,) = shown["units"]
    assert code == 0
    std = np.sqrt(np.diagonal(np.array(unit["covariance"])))
    assert np.all(np.abs(np.array(unit["offset"]) - [20, -35, 12]) < 4 * std[:3])
    assert np.diagonal(np.array(unit["matrix"])) == pytest.approx([1.04, 0.98, 1.08], rel=0.004)
    assert not [note for note in unit["notes"] if "too little noise" in str(note)]


def test_a_field_that_differs_on_the_hands_way_is_no_walk_of_the_bias(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Single readings of a part swept by hand past steel: what is left wanders, and nothing says why."""
    turns = Rotation.from_rotvec(rng.normal(0, 0.5, (400, 3)))
    pose, steel, field = Rotation.identity(), np.zeros(3), np.zeros((400, 3))
    for i in range(400):
        pose, steel = pose * turns[i], 0.97 * steel + rng.normal(0, 0.4, 3)
        field[i] = pose.inv().apply(np.array([0.0, 0.0, 50.0]) + steel)
    path, out = tmp_path / "swept.csv", str(tmp_path / "swept.parquet")
    reading = field * [1.02, 0.98, 1.01] + [5, -3, 8] + 0.3 * rng.standard_normal(field.shape)
    np.savetxt(path, reading, "%.2f", ",", header="mag_x,mag_y,mag_z", comments="")
    assert station("import", str(path), "--out", out) == 0
    capsys.readouterr()
    found = diagnosed(out, "magnetometer-hand-held", capsys)
    assert found["verdict"] in {"unknown", "incomplete"}
    assert "bias-walk" not in effects(found)
    assert "time" in found["unknown"]["depends_on"]
    assert found["floor"]["within_stops"] == 0.0


def test_an_axis_of_another_range_is_named_and_the_ellipsoid_not_blamed(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Readings that lie well on an ellipsoid four times as long as wide, as of a compass whose z has another step."""
    turned = rng.standard_normal((200, 3))
    turned *= 49 / np.linalg.norm(turned, axis=1, keepdims=True)
    path, out = tmp_path / "compass.csv", str(tmp_path / "compass.parquet")
    reading = turned * [1.04, 0.98, 0.24] + [3, -5, 2] + 0.05 * rng.standard_normal(turned.shape)
    np.savetxt(path, reading, "%.3f", ",", header="mag_x,mag_y,mag_z", comments="")
    assert station("import", str(path), "--out", out) == 0
    for command in ("calibrate", "diagnose"):
        capsys.readouterr()
        assert station(command, "--samples", out, "--recipe", "magnetometer-hand-held") == 2
        said = capsys.readouterr().err
        assert "axis z responds 0.2" in said
        assert "ellipsoid" not in said


def test_where_nothing_is_limited_no_pass_is_shown(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = np.repeat(rng.standard_normal((14, 3)), 60, axis=0)
    y = poses / np.linalg.norm(poses, axis=1, keepdims=True) + 0.002 * rng.standard_normal(poses.shape)
    np.savetxt(tmp_path / "held.csv", y, "%.5f", ",", header="ax,ay,az", comments="")
    out = str(tmp_path / "held.parquet")
    assert station("import", str(tmp_path / "held.csv"), "--blocks", "60", "--out", out) == 0
    capsys.readouterr()
    assert station("calibrate", "--samples", out, "--recipe", HAND_HELD) == 0
    shown = capsys.readouterr().out
    assert "PASS" not in shown
    assert "none judged" in shown


@pytest.mark.parametrize(("noise", "digits"), [(0.3, 2), (0.0, 4)])
def test_a_compass_beside_much_iron_is_diagnosed_and_a_computed_one_refused(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], noise: float, digits: int
) -> None:
    """Hard iron of six times the field, turned soft iron: the readings lie on an ellipsoid far from zero."""
    turned = rng.standard_normal((150, 3))
    turned *= 40 / np.linalg.norm(turned, axis=1, keepdims=True)
    soft = np.array([[1.05, 0.06, 0.02], [0, 0.97, -0.05], [0, 0, 0.9]])
    path, out = tmp_path / "compass.csv", str(tmp_path / "compass.parquet")
    reading = turned @ soft.T + [220, 50, -35] + noise * rng.standard_normal(turned.shape)
    np.savetxt(path, reading, f"%.{digits}f", ",", header="mag_x,mag_y,mag_z", comments="")
    assert station("import", str(path), "--out", out) == 0
    capsys.readouterr()
    if noise:
        found = diagnosed(out, "magnetometer-hand-held", capsys)
        assert effects(found)[0] == "cross-axis"
    else:
        assert station("diagnose", "--samples", out, "--recipe", "magnetometer-hand-held") == 2
        assert "were computed" in capsys.readouterr().err
