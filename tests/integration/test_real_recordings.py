"""Real sensors, recorded by others: what this calibration makes of them, beside what their own tools make of them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from station.config.recipes import load_recipe
from station.domain.capture import rest_segments
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.evaluation import model_comparison
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble
from tests.fakes.command import station
from tests.fakes.tumble import TODAY, coefficients

#: m/s² where the Xsens recording was made, by its authors; counts per m/s² of its data sheet; counts at rest.
XSENS_G, XSENS_SCALE, XSENS_ZERO = 9.81744, 415.0, 32768.0
#: What imucal assumes.
IMUCAL_G = 9.81


def by_hand() -> Recipe:
    return tumble.recipe("norm", reference={"source": "gravity", "magnitude": 1.0, "pose": "unknown"}, positions=[])


@pytest.fixture(scope="module")
def xsens(reference_data: Path) -> Any:
    raw = np.loadtxt(reference_data / "xsens_mti_tumble" / "xsens_acc.mat")
    reading = (raw[:, 1:] - XSENS_ZERO) / XSENS_SCALE / XSENS_G
    found = rest_segments.find(raw[:, 0], reading)
    names = [f"still-{i:02d}" for i in range(len(found))]
    return found, tumble.calibrate_unit(by_hand(), rest_segments.table(raw[:, 0], reading, found, "MTi", names), TODAY)


def test_39_rests_are_found_in_the_xsens_recording(xsens: Any) -> None:
    assert len(xsens[0]) == 39


def test_the_xsens_magnitudes_are_right_to_a_tenth_of_a_milli_g(xsens: Any) -> None:
    calibration = xsens[1].calibration
    assert calibration.residual_rms < 0.105e-3
    assert not calibration.disturbed.any()
    # 3.4, 9.1 and 21 mrad of non-orthogonality, as others found.
    assert calibration.matrix[0, 1:] == pytest.approx([3.4e-3, 9.1e-3], abs=3e-4)
    assert calibration.matrix[1, 2] == pytest.approx(21e-3, abs=4e-4)


def test_no_bend_is_needed_for_the_xsens_and_a_pose_left_out_is_met_to_018_milli_g(xsens: Any) -> None:
    quadratic, cubic = model_comparison.of_unit(by_hand(), xsens[1])
    assert quadratic.rms_left_out < 0.18e-3
    for one in (quadratic, cubic):
        assert not one.pays
        assert one.p > 0.4
        assert one.larger_rms_left_out > 1.5 * one.rms_left_out


def test_the_xsens_floor_is_covered_by_its_own_uncertainty(xsens: Any) -> None:
    """White noise predicts 0.03 mg where 0.117 mg are seen; the dwells themselves tell of the slow part."""
    result = xsens[1]
    assert result.budget.scatter == 0
    predicted = np.sqrt(np.einsum("vii->vi", result.visits.cov).mean())
    white = (result.visits.std / np.sqrt(result.visits.count[:, None])).mean()
    assert predicted > 2.5 * white


#: The recording as `station segment` takes it, and nothing known of how it was held.
BY_HAND = """\
schema: station.recipe/1
name: by-hand
version: 1
sensor: accelerometer
unit: g
reference: {source: gravity, magnitude: 1.0, pose: unknown}
device: {rate_hz: 100}
settle: {time_s: 0}
method: norm
"""


def diagnosed(folder: Path, reference_data: Path, *more: str) -> dict[str, Any]:
    """What `station segment` and `station diagnose` make of the Xsens recording."""
    recording = str(reference_data / "xsens_mti_tumble" / "xsens_acc.mat")
    scale, samples, recipe = repr(1 / XSENS_SCALE / XSENS_G), str(folder / "xsens.parquet"), folder / "by-hand.yaml"
    recipe.write_text(BY_HAND, encoding="utf-8")
    assert station("segment", recording, "--zero", str(XSENS_ZERO), "--scale", scale, "--out", samples) == 0
    shown = folder / "told.json"
    station("diagnose", "--samples", samples, "--recipe", str(recipe), "--json", str(shown), *more)
    found: dict[str, Any] = json.loads(shown.read_text(encoding="utf-8"))
    return found


def test_the_xsens_axes_are_not_square_and_nothing_else(reference_data: Path, tmp_path: Path) -> None:
    """With offset and gain alone: cross-axis, 3.42 → 0.102 mg, held out 0.157 mg, as good as the whole calibration."""
    model = str(tmp_path / "model.yaml")
    shown = diagnosed(tmp_path, reference_data, "--extend", model)
    (cause,) = shown["causes"]
    assert (shown["verdict"], cause["effect"], cause["indistinguishable_from"]) == ("named", "cross-axis", [])
    assert shown["baseline"]["residual_rms"] == pytest.approx(3.42e-3, abs=0.02e-3)
    assert shown["extended"]["residual_rms"] == pytest.approx(0.102e-3, abs=0.002e-3)
    assert cause["gain"]["rms_after"] <= 0.18e-3
    assert cause["gain"]["accepted"]
    # Half of what others found (3.4, 9.1, 21 mrad) is the symmetric part.
    found = {p["axis"]: p["value"] for p in cause["parameters"]}
    assert found == pytest.approx({"xy": 1.7e-3, "xz": 4.6e-3, "yz": 10.6e-3}, abs=3e-4)
    again = diagnosed(tmp_path, reference_data, "--model", model)
    assert (again["verdict"], again["causes"]) == ("none", [])


def test_no_bend_is_found_in_the_xsens(reference_data: Path, tmp_path: Path) -> None:
    """The control: quadratic and cubic terms make a pose left out worse, so they must be refused."""
    whole = tmp_path / "matrix.yaml"
    whole.write_text("schema: station.model/1\ncalibration: matrix\n", encoding="utf-8")
    shown = diagnosed(tmp_path, reference_data, "--model", str(whole))
    assert (shown["verdict"], shown["causes"]) == ("none", [])
    evidence = {c["effect"]: c["log_evidence"] for c in shown["considered"]}
    assert {"quadratic", "cubic"} <= set(evidence)
    assert max(evidence["quadratic"], evidence["cubic"]) < 1.0


def faces(table: pd.DataFrame, unit: float) -> SampleTable:
    """Labelled sections (`part`: x_p … z_a) as a samples table; imucal calls the axis that points up positive."""
    names = {"x_p": "x-up", "x_a": "x-down", "y_p": "y-up", "y_a": "y-down", "z_p": "z-up", "z_a": "z-down"}
    rows = table[table["part"].isin(names)]
    visit = rows["part"].map({part: i for i, part in enumerate(names)}).to_numpy(np.int32)
    order = np.argsort(visit, kind="stable")
    reading: Floats = rows[["acc_x", "acc_y", "acc_z"]].to_numpy(float)[order] / unit
    return SampleTable(
        unit=Labels(("imu",), np.zeros(len(rows), np.int32)),
        run=np.zeros(len(rows), np.int32),
        visit=visit[order],
        position=Labels(tuple(names.values()), visit[order]),
        time_s=np.arange(len(rows)) / 102.4,
        reading=reading,
    )


def session(reference_data: Path) -> pd.DataFrame:
    folder = reference_data / "imucal_ferraris"
    table = pd.read_csv(folder / "example_ferraris_session.csv")
    parts = json.loads((folder / "example_ferraris_session_list.json").read_text())
    table["part"] = ""
    for name, span in parts.items():
        table.loc[span["start"] : span["end"] - 1, "part"] = name
    return table


def imucals(table: pd.DataFrame) -> Floats:
    """imucal's own offset (in g) and matrix (12) of a labelled recording."""
    from imucal import FerrarisCalibration, FerrarisSignalRegions

    axes = {"acc": ["acc_x", "acc_y", "acc_z"], "gyr": ["gyr_x", "gyr_y", "gyr_z"]}
    parts = {
        f"{kind}_{part}": table.loc[table["part"] == part, columns].to_numpy(float)
        for kind, columns in axes.items()
        for part in ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a", "x_rot", "y_rot", "z_rot")
    }
    found: Any = FerrarisCalibration(grav=IMUCAL_G).compute(
        FerrarisSignalRegions(**parts), sampling_rate_hz=102.4, from_acc_unit="m/s^2", from_gyr_unit="deg/s"
    )
    return np.concatenate([found.b_a / IMUCAL_G, (found.K_a @ found.R_a).ravel()])


def test_six_faces_of_a_real_sensor_agree_with_imucal(reference_data: Path) -> None:
    """Within the uncertainty of both: imucal takes two of six readings for an offset, so its is 1.7 times ours."""
    table = session(reference_data)
    recipe = tumble.recipe("six-point")
    ours = tumble.calibrate_unit(recipe, faces(table, IMUCAL_G), TODAY)
    assert ours.budget is not None
    std = ours.budget.std()
    theirs = imucals(table)
    # The difference of two estimates from the same readings: the pair's offset less the mean of all six, 0.58 σ.
    own = std.copy()
    own[:3] = std[:3] * np.sqrt(3)
    assert (np.abs(coefficients(ours) - theirs) < 1.96 * np.hypot(own, std)).all()
    assert (std[:3] < own[:3]).all()


def test_the_recipe_that_ships_takes_a_recording_by_hand(reference_data: Path) -> None:
    found = tumble.calibrate_unit(load_recipe("six-point"), faces(session(reference_data), 9.80665), TODAY)
    assert found.calibration is not None
    assert str(found.verdict.outcome) == "PASS"
    assert any(note.id == "visits-scatter" for note in found.calibration.notes)
