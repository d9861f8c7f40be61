"""Which sensor a file holds, and how many: counts of compasses, sensors in turn, converters, other programs' forms."""

import json
from pathlib import Path

import numpy as np
import pytest

from station.domain.core.types import Floats
from tests.fakes.command import captured, station
from tests.integration.test_import import check, tumble, understood
from tests.integration.test_import_shapes import sphere

Capture = pytest.CaptureFixture[str]


def swept(rng: np.random.Generator, readings: int = 1500) -> Floats:
    """Directions (n, 3) on a slow way all round."""
    way = np.cumsum(rng.standard_normal((readings, 3)), axis=0)
    turn = 0.05 * np.arange(readings)
    tilt = np.linspace(-1.5, 1.5, readings)
    along = np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)], axis=1)
    noisy = along + 1e-4 * (way - way.mean(axis=0))
    return np.asarray(noisy / np.linalg.norm(noisy, axis=1, keepdims=True))


@pytest.mark.parametrize(("size", "iron"), [(540.0, (160, -20, -420)), (3400.0, (-800, 2200, -900))])
def test_counts_far_off_their_centre_are_a_compass(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, size: float, iron: tuple[int, int, int]
) -> None:
    path = tmp_path / "sensor_data.txt"
    np.savetxt(path, np.round(sphere(rng, 300) * size + iron + rng.normal(0, 4, (300, 3))), fmt="%d", delimiter=" ")
    one = understood(capsys, str(path))
    check(one, reading_unit="uT", visits=300, visits_by="readings")
    assert one["poses"] > 40  # about their centre
    field = size * one["scale"]
    assert 20 < field < 90


@pytest.mark.parametrize("rate_hz", [100, 20])
def test_counts_that_rest_are_an_accelerometer_however_large_its_offset(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, rate_hz: int
) -> None:
    y = np.concatenate([np.repeat(pose[None], 4 * rate_hz, axis=0) for pose in sphere(rng, 30)])
    y = np.round((y + [0.01, 0.42, 0.5] + 0.002 * rng.standard_normal(y.shape)) * 2048)
    path = tmp_path / "caldata.csv"
    np.savetxt(path, np.c_[np.arange(len(y)) / rate_hz, y], "%.6g", ",")
    check(understood(capsys, str(path)), reading_unit="g", scale=1 / 2048, visits=30)


@pytest.mark.parametrize("size", [3400, 330])
def test_a_compass_of_unknown_counts_is_said_to_be_scaled_by_an_assumption(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, size: int
) -> None:
    """330 may be milligauss, or steps of .15 uT in a field of 50 uT."""
    path = tmp_path / "mag.csv"
    np.savetxt(path, np.round(sphere(rng, 300) * size + [90, -80, 40]), fmt="%d", delimiter=",")
    assert station("import", path) == 0
    said = capsys.readouterr().out
    assert "which makes the magnitude 50 uT" in said.replace("\n    ", " ")


@pytest.mark.parametrize("iron", [0.9, 1.0, 1.02, 3.0])
def test_a_compass_with_any_hard_iron_is_calibrated(rng: np.random.Generator, tmp_path: Path, iron: float) -> None:
    """Where the offset is as large as the field, zero lies on the ellipsoid itself."""
    offset = np.array([2.0, -1.0, 2.0]) / 3 * 48 * iron
    path, out = tmp_path / "mag.csv", tmp_path / "mag.parquet"
    readings = sphere(rng, 260) * 48 @ np.diag([1.05, 0.97, 1.0]) + offset + rng.normal(0, 0.4, (260, 3))
    np.savetxt(path, readings, "%.3f", ",", header="mx,my,mz", comments="")
    assert captured("import", path, "--out", out).returncode == 0
    answer = tmp_path / "answer.json"
    done = captured("calibrate", "--samples", out, "--recipe", "magnetometer-hand-held", "--json", answer)
    assert (done.returncode, done.stderr) == (0, "")
    (unit,) = json.loads(answer.read_text())["units"]
    assert unit["offset"] == pytest.approx(offset, abs=0.5)


def test_a_compass_turned_all_round_with_few_stops_gives_a_visit_a_reading(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    way = swept(rng)
    still = np.repeat(way[[0, 700]], 150, axis=0)
    y = np.concatenate([still[:150], way, still[150:]]) * 47 + rng.normal(0, 0.2, (1800, 3)) + [9, -4, 3]
    path = tmp_path / "compass.csv"
    np.savetxt(path, np.c_[np.arange(1800) / 100, y], "%.3f", ",", header="t,mx,my,mz", comments="")
    check(understood(capsys, str(path)), visits_by="readings", reading_unit="uT")


@pytest.mark.parametrize("iron", [(60, -75, 410), (-20, 15, 30)])
def test_a_compass_is_found_beside_the_offsets_that_its_device_holds(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, iron: tuple[int, int, int]
) -> None:
    """Without a header, with some rests; offsets of as constant a size, which the device improves now and then."""
    way = swept(rng)
    still = [np.repeat(way[[k]], 150, axis=0) for k in (0, 500, 900, 1200, -1)]
    y = np.concatenate([still[0], way[:500], still[1], way[500:900], still[2], way[900:1200], *still[3:]])
    own = np.repeat(np.array(iron) + rng.normal(0, 1, (15, 3)), len(y) // 15 + 1, axis=0)[: len(y)]
    path = tmp_path / "magnetometer.txt"
    rows = np.c_[np.arange(len(y)) / 50, y * 46 + rng.normal(0, 0.4, y.shape) + iron, own]
    np.savetxt(path, rows, "%.4f")
    one = understood(capsys, str(path), "--recipe", "magnetometer-hand-held")
    check(one, visits_by="readings", raw_unit="uT")
    assert one["axes"] == ["column 1", "column 2", "column 3"]


def test_an_accelerometer_read_while_it_is_turned_is_remarked(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "acc.csv"
    np.savetxt(path, swept(rng) * 9.8 + rng.normal(0, 0.2, (1500, 3)), "%.3f", ",", header="ax,ay,az", comments="")
    one = understood(capsys, str(path))
    check(one, visits_by="readings", raw_unit="m/s²")
    assert "readings-in-motion" in [r["id"] for r in one["remarks"]]


def test_sensors_that_take_turns_are_units(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = tumble(rng)
    turned = [y, y[:, [1, 2, 0]] * [1, -1, -1], y[:, [2, 0, 1]]]
    rows = [(i / 100, k, *own[i] + 0.01 * k) for i in range(len(y)) for k, own in zip((0, 2, 7), turned, strict=True)]
    path, out = tmp_path / "glove.csv", tmp_path / "glove.parquet"
    np.savetxt(path, np.array(rows), ["%.2f", "%d", "%.5f", "%.5f", "%.5f"], ",")
    assert station("import", path, "--json", "--out", out) == 0
    found = json.loads(capsys.readouterr().out)["recordings"]
    assert [(one["unit"], one["visits"], one["poses"]) for one in found] == [(f"glove-{k}", 8, 8) for k in (0, 2, 7)]


def test_a_counter_that_goes_round_tells_no_sensors(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = tumble(rng)
    path = tmp_path / "counted.csv"
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, np.arange(len(y)) % 16, y], "%.5f", ",")
    check(understood(capsys, str(path), "--columns", "0,2,3,4"), unit="counted", visits=8)


def test_poses_that_come_round_again_are_no_sensors(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Six faces, one reading each, twenty times over: the number of the face is no sensor's."""
    face = np.tile(np.arange(6), 20)
    y = np.concatenate([np.eye(3), -np.eye(3)])[face] * 1.01 + 0.02 + 0.002 * rng.standard_normal((120, 3))
    path = tmp_path / "faces.csv"
    np.savetxt(path, np.c_[face, y], ["%d", "%.5f", "%.5f", "%.5f"], ",", header="face,ax,ay,az", comments="")
    done = captured("import", path, "--json", "--blocks", "1")
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["recordings"]) == 1


def test_counts_that_wrap_below_zero_are_signed_though_some_axis_reaches_the_middle(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng) + np.array([0.01, -0.02, 0.48])
    path = tmp_path / "raw.txt"
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, np.round(y * 16384) % 65536], "%.6g", "\t")
    one = understood(capsys, str(path), "--zero", "0", "--scale", str(1 / 16384))
    check(one, visits=8, poses=8)
    assert "counts-unsigned" in [r["id"] for r in one["remarks"]]
    assert one["magnitude"]["greatest"] < 1.6


def test_a_turn_rate_is_not_taken_for_gravity_in_counts(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """An accelerometer's offset makes its magnitude less steady than that of a gyroscope with an offset, at rest."""
    y = tumble(rng)
    turn = 40 * np.gradient(y, axis=0) * 131 + [330, -12, -160] + rng.normal(0, 5, y.shape)
    acceleration = np.round((y + np.array([0, 0, 0.45])) * 16384)
    path = tmp_path / "imu.txt"
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, acceleration, np.round(turn)], "%.6g", "\t")
    check(understood(capsys, str(path)), axes=["column 1", "column 2", "column 3"], visits=8)


def test_a_compass_that_an_aircraft_turns_is_found_beside_the_field_of_the_map(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Columns without names: time, the compass, pitch, roll and yaw, and the field of the place, which hardly moves."""
    n = 3000
    leg = np.arange(n) // 150
    yaw = np.deg2rad(137.0 * leg)
    pitch, roll = (np.deg2rad(8 * np.sin(k * leg)) for k in (1.7, 2.9))
    place = np.array([17700.0, -3950.0, 50820.0]) + np.linspace(0, 60, n)[:, None]
    z = np.zeros(n)
    about_z = np.stack([np.cos(yaw), np.sin(yaw), z, -np.sin(yaw), np.cos(yaw), z, z, z, z + 1], axis=1).reshape(
        n, 3, 3
    )
    level = np.einsum("nij,nj->ni", about_z, place)
    body = level + np.cross(np.stack([roll, pitch, z], axis=1), level)
    body = body + rng.normal(0, 5, (n, 3)) + np.array([300.0, -200.0, 900.0])
    path = tmp_path / "flight.txt"
    angles = np.rad2deg(np.stack([pitch, roll, yaw % (2 * np.pi)], axis=1))
    np.savetxt(path, np.column_stack([46370 + 0.1 * np.arange(n), body, angles, place]), fmt="%.6f", delimiter="\t")
    one = understood(capsys, str(path))
    check(one, reading_unit="uT", visits_by="rest")
    assert one["axes"] == ["column 1", "column 2", "column 3"]


def test_counts_about_the_middle_of_a_converter_are_found_beside_a_compass(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    poses = sphere(rng, 60)
    field = sphere(rng, 60) * 800 + [2110, 2135, 1890] + rng.normal(0, 25, (60, 3))
    rows = np.c_[24800 + rng.normal(0, 15, (60, 3)), poses * 6600 + 32768 + rng.normal(0, 30, (60, 3)), field]
    path = tmp_path / "poses.csv"
    np.savetxt(path, np.round(rows), fmt="%d", delimiter=",")
    check(understood(capsys, str(path)), axes=["column 3", "column 4", "column 5"], zero=32768.0, reading_unit="g")


def test_other_axes_of_the_same_kind_are_named(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = tumble(rng)
    path = tmp_path / "two.csv"
    head = "t," + ",".join(f"acc{k}_{a}" for k in (1, 2) for a in "xyz")
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, y, y[:, [1, 0, 2]]], "%.5f", ",", header=head, comments="")
    (remark,) = understood(capsys, str(path))["remarks"]
    assert remark["id"] == "axes-of-others"


def test_numbers_of_no_unit_are_not_called_counts(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "acc.csv"
    np.savetxt(path, sphere(rng, 80) * 19.3 + 0.1, "%.6f", ",", header="acc_x,acc_y,acc_z", comments="")
    assert station("import", path) == 0
    assert "unknown; 19." in capsys.readouterr().out


def test_a_compass_beside_an_accelerometer_that_never_rested_is_taken(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """The log of a compass's calibration: turned all round by hand, with all sensors written down."""
    turned = sphere(rng, 600)
    shaken = turned + 1.5 * rng.standard_normal(turned.shape)
    field = 48.0 * turned + [20.0, -31.0, 12.0] + 0.2 * rng.standard_normal(turned.shape)
    rows = np.c_[9.81 * shaken, 90 * rng.standard_normal(turned.shape), field]
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, "%.4f", ",", header="ax,ay,az,gx,gy,gz,mx,my,mz", comments="")
    shown = understood(capsys, str(path))
    check(shown, axes=["mx", "my", "mz"], reading_unit="uT")
    (remark,) = (r for r in shown["remarks"] if r["id"] == "compass-beside")
    assert remark["reason"]["id"] == "gravity-not-shown"
    assert station("import", path, "--recipe", "hand-held") == 2
    assert station("import", path, "--columns", "ax,ay,az") == 2


def test_counts_of_gravity_beside_named_turn_rates_are_the_accelerometers(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """X, Y, Z say nothing, and WX, WY, WZ are turn rates."""
    y = tumble(rng)
    rows = np.round(np.c_[16384 * y, 300 + 9 * rng.standard_normal(y.shape)])
    path = tmp_path / "six.csv"
    np.savetxt(path, rows, "%d", ",", header="X,Y,Z,WX,WY,WZ", comments="")
    check(understood(capsys, str(path)), axes=["X", "Y", "Z"], scale=1 / 16384, poses=8)


def test_stamps_without_a_name_are_time_where_a_travel_time_falls(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """An index of dates, as data frames write it, beside an echo's travel time: time went back in that."""
    path = tmp_path / "log.csv"
    start = np.datetime64("2024-05-02T08:00:00.000")
    rows = [
        f"{str(start + np.timedelta64(20 * i, 'ms')).replace('T', ' ')}+02:00,{echo:.3f},{x:.4f},{y:.4f},{z:.4f}"
        for i, (echo, (x, y, z)) in enumerate(
            zip(rng.uniform(5, 9, 1200), np.repeat(sphere(rng, 12), 100, 0), strict=True)
        )
    ]
    path.write_text("\n".join([",TWO_WAY_TIME,acc_x,acc_y,acc_z", *rows]))
    shown = understood(capsys, str(path))
    assert shown["time_unit"] != "none"
    assert shown["rate_hz"] == pytest.approx(50, rel=1e-3)


def test_a_file_of_angular_rates_holds_no_linear_acceleration(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Columns called after the spin say nothing of the quantity; the file does."""
    path = tmp_path / "measured_angular_rates.csv"
    spin = np.repeat([0.0, 1.0, 0.0, -1.0, 0.0], 400)[:, None] * [0.4, 0.2, 90.0]
    head = "z_rotation_0,z_rotation_1,z_rotation_2"
    np.savetxt(path, spin + 0.3 * rng.standard_normal(spin.shape), "%.5f", ",", header=head, comments="")
    assert understood(capsys, str(path))["reading_unit"] == "deg/s"


def test_a_list_of_turn_rates_is_no_list_of_poses(rng: np.random.Generator, tmp_path: Path) -> None:
    path = tmp_path / "gyro.csv"
    np.savetxt(path, np.round(sphere(rng, 160) * 800 + 2000), fmt="%d", delimiter=",")
    assert captured("import", path).returncode == 2


@pytest.mark.parametrize(
    ("beginning", "said"),
    [
        (b"#ROSBAG V2.0\n", "a ROS bag"),
        (b"\x89MCAP0\r\n", "an MCAP recording"),
        (b"SQLite format 3\0", "an SQLite database"),
        (b"PK\x03\x04", "a spreadsheet"),
        (b"ULog\x01\x12\x35", "a PX4 log"),
        (b"\xa3\x95\x80", "an ArduPilot log"),
        (b"\x1f\x8b\x08", "a compressed file"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:7d72\n", "a Git LFS pointer"),
        (b"\xef\xbb\xbf\n<!DOCTYPE html>\n<html><body>1,2,3</body></html>", "a web page"),
    ],
)
def test_recordings_of_other_programs_are_named_with_what_to_do(tmp_path: Path, beginning: bytes, said: str) -> None:
    path = tmp_path / "log.bin"
    path.write_bytes(beginning + bytes(range(256)) * 20)
    done = captured("import", path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") <= 3


def test_single_readings_claim_neither_noise_nor_rate(rng: np.random.Generator, tmp_path: Path) -> None:
    path, out = tmp_path / "means.csv", tmp_path / "means.parquet"
    np.savetxt(path, sphere(rng, 24) * 9.8 + 0.1, "%.6f", ",", header="acc_x,acc_y,acc_z", comments="")
    assert "show no noise" in captured("import", path, "--out", out).stdout
    said = captured("calibrate", "--samples", out, "--recipe", "hand-held").stdout
    assert "tells no rate and no noise" in said
    assert "rate 1" not in said


def one_row_an_axis(y: Floats, sensor: str, decimal: str) -> str:
    names = ["time", *(["sensor"] if sensor else []), "axis", "value"]
    lines = [";".join(names)]
    for i, reading in enumerate(y * 9.80665):
        for axis, value in zip("XYZ", reading, strict=True):
            cells = [f"{10 * i}", *([sensor] if sensor else []), axis, f"{value:.4f}".replace(".", decimal)]
            lines.append(";".join(cells))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(("sensor", "decimal"), [("", "."), ("acc", ",")])
def test_a_row_an_axis_is_a_table_of_readings(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, sensor: str, decimal: str
) -> None:
    path = tmp_path / "tidy.csv"
    path.write_text(one_row_an_axis(tumble(rng), sensor, decimal))
    check(understood(capsys, str(path)), raw_unit="m/s²", rate_hz=100.0, visits=8, axes=["X", "Y", "Z"])


def test_a_row_an_axis_of_two_sensors_tells_them_apart(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng)
    turn = 40 * np.gradient(y, axis=0) + 0.1 * rng.standard_normal(y.shape)
    rows = [
        f"{i / 100:.2f},{name},{axis},{own[i, k]:.4f}"
        for i in range(len(y))
        for name, own in (("gyr", turn), ("acc", y))
        for k, axis in enumerate("xyz")
    ]
    path = tmp_path / "tidy.csv"
    path.write_text("\n".join(["t,sensor,axis,value", *rows]) + "\n")
    check(understood(capsys, str(path)), axes=["acc x", "acc y", "acc z"], visits=8, rate_hz=100.0)


@pytest.mark.parametrize("stamped", [True, False])
def test_a_transposed_table_is_read(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, *, stamped: bool
) -> None:
    y = tumble(rng) if stamped else sphere(rng, 24) * 1.02
    lines = {f"a{axis}": column for axis, column in zip("xyz", y.T, strict=True)}
    if stamped:
        lines = {"time": np.arange(len(y)) / 100, **lines}
    path = tmp_path / "transposed.csv"
    path.write_text("".join(",".join([name, *(f"{v:.4f}" for v in values)]) + "\n" for name, values in lines.items()))
    check(understood(capsys, str(path)), axes=["ax", "ay", "az"], visits=8 if stamped else 24)


def test_axes_with_a_clock_each_are_read_on_one(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    from asammdf import MDF, Signal

    y = tumble(rng)
    path = tmp_path / "clocks.mf4"
    with MDF() as mdf:
        for k, axis in enumerate("XYZ"):
            stamps = np.arange(len(y)) / 100 + 0.002 * k
            mdf.append([Signal(y[:, k] * 9.80665, stamps, name=f"Acceleration{axis}", unit="m/s^2")])
        mdf.append([Signal(np.full(60, 25.0), np.arange(60.0), name="Temperature", unit="degC")])
        mdf.save(path, overwrite=True)
    one = understood(capsys, str(path))
    check(one, axes=[f"Acceleration{a}" for a in "XYZ"], raw_unit="m/s²", rate_hz=100.0, visits=8, poses=8)


def test_means_with_the_name_of_a_pose_each_are_visits_of_that_name(rng: np.random.Generator, tmp_path: Path) -> None:
    names = ["+X", "-X", "+Y", "-Y", "+Z", "-Z"]
    faces = np.repeat(np.eye(3), 2, axis=0) * np.tile([1, -1], 3)[:, None] * 1.01 + 0.01
    path, out = tmp_path / "six.csv", tmp_path / "six.parquet"
    rows = (",".join([n, *(str(round(v * 16384)) for v in f)]) for n, f in zip(names, faces, strict=True))
    path.write_text("\n".join(["face,x,y,z", *rows]) + "\n")
    done = captured("import", path, "--recipe", "six-point", "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    answer = tmp_path / "answer.json"
    done = captured("calibrate", "--samples", out, "--recipe", "six-point", "--json", answer)
    assert (done.returncode, done.stderr) == (0, "")
    (unit,) = json.loads(answer.read_text())["units"]
    assert unit["offset"] == pytest.approx([0.01] * 3, abs=1e-4)


@pytest.mark.parametrize("order", ["backwards", "shuffled"])
def test_rows_in_another_order_than_time_are_sorted_and_it_is_said(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, order: str
) -> None:
    y = tumble(rng)
    rows = np.c_[np.arange(len(y)) / 100, y]
    rows = rows[::-1] if order == "backwards" else rng.permutation(rows)
    path = tmp_path / "rows.csv"
    np.savetxt(path, rows, "%.5f", ",", header="t,ax,ay,az", comments="")
    one = understood(capsys, str(path))
    check(one, visits=8, rate_hz=100.0)
    assert [r["id"] for r in one["remarks"]] == ["rows-sorted"]


def test_an_axis_that_stands_still_while_others_turn_is_refused(rng: np.random.Generator, tmp_path: Path) -> None:
    y = tumble(rng)
    y[:, 2] = 0
    path = tmp_path / "dead.csv"
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, y], "%.5f", ",", header="t,ax,ay,az", comments="")
    done = captured("import", path)
    assert done.returncode == 2
    assert "column az: every reading is 0 while the other axes turn" in done.stderr


@pytest.mark.parametrize("end", [0.9, 0.7])
def test_an_axis_that_is_cut_off_still_rests(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, end: float
) -> None:
    y = np.clip(tumble(rng), -1.0, end)
    path = tmp_path / "cut.csv"
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, y], "%.5f", ",", header="t,ax,ay,az", comments="")
    check(understood(capsys, str(path), "--unit", "g"), visits=8)


def test_marks_of_thousands_may_be_apostrophes_and_names_chinese(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng) * 16384
    swiss = tmp_path / "swiss.csv"
    marked = ((f"{round(v):,}".replace(",", "'") for v in row) for row in y)
    swiss.write_text("t;ax;ay;az\n" + "".join(f"{i / 100:.2f};{';'.join(r)}\n" for i, r in enumerate(marked)))
    check(understood(capsys, str(swiss)), raw_unit="LSB", scale=1 / 16384, visits=8)
    page = tmp_path / "page.csv"
    head = "时间(s),加速度X(m/s2),加速度Y(m/s2),加速度Z(m/s2)\n"
    rows = "".join(f"{i / 100:.2f},{a:.4f},{b:.4f},{c:.4f}\n" for i, (a, b, c) in enumerate(y / 16384 * 9.80665))
    page.write_bytes((head + rows).encode("gb18030"))
    check(understood(capsys, str(page)), axes=["加速度X", "加速度Y", "加速度Z"], raw_unit="m/s²", visits=8)


@pytest.mark.parametrize(("head", "stated"), [("temp", False), ("temp [°C]", True), ("temp_degC", True)])
def test_degrees_that_no_header_states_are_said_to_be_inferred(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, head: str, *, stated: bool
) -> None:
    y = tumble(rng)
    path = tmp_path / "warm.csv"
    rows = np.c_[np.arange(len(y)) / 100, y, np.linspace(68, 86, len(y))]
    np.savetxt(path, rows, "%.5f", ",", header=f"t,ax,ay,az,{head}", comments="", encoding="utf-8")
    assert ("temperature" in understood(capsys, str(path))["inferred"]) != stated


def turned_slowly(rng: np.random.Generator, rate_hz: int) -> Floats:
    """Gravity (n, 3) in a unit that a hand turns all round without a rest, a quarter turn in some three seconds."""
    about = np.cumsum(rng.standard_normal((60, 3)), axis=0)
    way = np.stack([np.interp(np.arange(120 * rate_hz) / rate_hz, 2.0 * np.arange(60), a) for a in about.T], axis=1)
    first, second, third = way.T
    along = np.stack([np.sin(first) * np.cos(second), np.sin(first) * np.sin(second + third), np.cos(first)], axis=1)
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


def test_an_accelerometer_turned_slowly_is_read_on_its_way(rng: np.random.Generator, tmp_path: Path) -> None:
    """It was refused; and where parts of the turn are quieter than the rest of it they are no rests."""
    path, out, answer = tmp_path / "turned.csv", tmp_path / "turned.parquet", tmp_path / "answer.json"
    offset_g, gain = np.array([0.02, -0.03, 0.05]), np.array([1.02, 0.98, 1.01])
    reading = turned_slowly(rng, 50) * gain + offset_g + 0.004 * rng.standard_normal((6000, 3))
    rows = np.c_[np.arange(6000) / 50, 9.80665 * reading]
    np.savetxt(path, rows, "%.5f", ",", header="t,ax,ay,az", comments="")
    done = captured("import", path, "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert "was read while it was being turned" in done.stdout.replace("\n    ", " ")
    done = captured("calibrate", "--samples", out, "--recipe", "hand-held", "--json", answer)
    assert (done.returncode, done.stderr) == (0, "")
    (unit,) = json.loads(answer.read_text())["units"]
    assert unit["offset"] == pytest.approx(offset_g, abs=0.002)
    assert np.diagonal(unit["matrix"]) == pytest.approx(gain, abs=0.005)


def test_driving_is_told_as_such_and_gravity_is_no_offset(rng: np.random.Generator, tmp_path: Path) -> None:
    """Smooth accelerations draw a small sphere about gravity, which was taken for an offset in an unknown unit."""
    path = tmp_path / "drive.csv"
    pushes = [np.interp(np.arange(6000) / 50, 0.7 * np.arange(172), rng.standard_normal(172)) for _ in "xyz"]
    reading = [0, 0, 9.81] + 1.5 * np.stack(pushes, axis=1) + 0.1 * rng.standard_normal((6000, 3))
    np.savetxt(path, np.c_[np.arange(6000) / 50, reading], "%.4f", ",", header="t,ax,ay,az", comments="")
    done = captured("import", path)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{path}: " in done.stderr
    assert "driving" in done.stderr


def test_a_list_of_six_means_is_a_pose_a_row(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "means.csv"
    rows = np.vstack([np.eye(3), -np.eye(3)]) + np.array([0.1, 0.05, -0.25])
    np.savetxt(path, rows, "%.4f", ",", header="x_mean (g),y_mean (g),z_mean (g)", comments="")
    check(understood(capsys, str(path)), visits=6, visits_by="readings", reading_unit="g")
    check(understood(capsys, str(path), "--recipe", "six-point"), visits=6)


def test_turn_rates_in_counts_about_a_converters_middle_are_asked_for(rng: np.random.Generator, tmp_path: Path) -> None:
    path = tmp_path / "omega.csv"
    turns = np.repeat(np.sin(np.arange(200))[:, None] * [9000, 4000, 2000] * (np.arange(200) % 2)[:, None], 100, axis=0)
    reading = np.round(32768 + turns + rng.normal(0, 25, (20000, 3)))
    np.savetxt(path, np.c_[np.arange(20000) / 100, reading], "%.6g", ",", header="t,gx,gy,gz", comments="")
    done = captured("import", path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "State --zero" in done.stderr
    assert captured("import", path, "--zero", "32768", "--scale", "0.06").returncode == 0


@pytest.mark.parametrize(
    ("beside", "shown"),
    [
        ("attempts", "attempts"), ("template_id", "count"), ("temporal_x", "wave"), ("temp_status", "zero"),
        ("temp_setpoint", "still"), ("temp_raw", "count"), ("cpu_temp", "warmer"), ("tempo", "wave"),
        ("BMP_temp", "warmer"),
    ],
)  # fmt: skip
def test_a_column_that_only_looks_like_a_temperature_hides_no_thermometer(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], beside: str, shown: str
) -> None:
    y = tumble(rng)
    n = len(y)
    other = {
        "attempts": rng.integers(0, 5, n), "count": np.arange(n), "wave": 90 * np.sin(np.arange(n) * 40.0),
        "zero": np.zeros(n), "still": np.full(n, 25.0), "warmer": 41 + 0.001 * np.arange(n),
    }[shown]  # fmt: skip
    warm = 22 + 2e-4 * np.arange(n) + 0.05 * rng.standard_normal(n)
    path = tmp_path / "log.csv"
    header = f"time_s,ax,ay,az,{beside},temperature"
    np.savetxt(path, np.c_[np.arange(n) / 100, y, other, warm], "%.5f", ",", header=header, comments="")
    one = understood(capsys, str(path))
    check(one, axes=["ax", "ay", "az"], rate_hz=100.0, visits=8)
    assert one["temperature_degC"] == pytest.approx([22.0, 22.9], abs=0.4)
    said = [r for r in one["remarks"] if r["id"] == "thermometers-of-others"]
    assert bool(said) == (shown == "warmer")


@pytest.mark.parametrize(
    ("name", "scale", "zero"), [("temp_F", 1.8, 32.0), ("T [°C]", 1.0, 0.0), ("tempK", 1.0, 273.15)]
)
def test_the_unit_of_a_temperature_may_stand_in_its_name(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, scale: float, zero: float
) -> None:
    y = tumble(rng)
    path = tmp_path / "log.csv"
    warm = np.full(len(y), 23.0) * scale + zero
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, y, warm], "%.5f", ",", header=f"temps,ax,ay,az,{name}", comments="")
    one = understood(capsys, str(path))
    check(one, rate_hz=100.0, visits=8)
    assert one["temperature_degC"] == pytest.approx([23.0, 23.0], abs=0.01)
    assert "temperature" not in one["inferred"]


def test_gravity_is_no_field_of_a_compass(rng: np.random.Generator, tmp_path: Path) -> None:
    """Gains of .02 were said without a word."""
    y = rng.standard_normal((60, 3))
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    table = np.c_[np.arange(60), np.arange(60) / 10, y + 0.002 * rng.standard_normal(y.shape)]
    rows = "".join(f"A,0,{v:.0f},p{v:.0f},{t},{a},{b},{c}\n" for v, t, a, b, c in table.tolist())
    path = tmp_path / "g.csv"
    path.write_text("unit,run,visit,position,time_s,x,y,z\n" + rows, encoding="utf-8")
    done = captured("calibrate", "--samples", path, "--recipe", "magnetometer-hand-held")
    assert "Readings are 0.0204 times the stimulus: check range and unit." in done.stdout


def spun(off: tuple[float, float, float] = (0.4, -0.7, 0.2)) -> Floats:
    """Readings (n, 3) of six spins of 2 s at 100 deg/s, at rest in between, at 100 Hz."""
    rates = 100 * np.kron(np.eye(3), [[1.0], [-1.0]])
    still = [np.concatenate([np.zeros((100, 3)), np.tile(rate, (200, 1))]) for rate in rates]
    return np.concatenate(still) * [1.01, 0.992, 1.004] + off


@pytest.mark.parametrize(
    ("scale", "whole", "unit"),
    [
        (np.pi / 180, False, "rad/s"),
        (1.0, False, "deg/s"),
        (2.0, False, "deg/s"),
        (16.4, True, "LSB"),
        (131, True, "LSB"),
    ],
)
def test_turn_rates_without_a_unit_are_told_by_the_speeds_of_the_recipe(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, scale: float, whole: bool, unit: str
) -> None:
    path = tmp_path / "table.csv"
    y = (spun() + 0.05 * rng.standard_normal((1800, 3))) * scale
    np.savetxt(path, np.c_[np.arange(1800) / 100, np.round(y) if whole else y], "%.7g", ",", header="t,gx,gy,gz")
    one = understood(capsys, str(path), "--recipe", "gyroscope-six-point")
    check(one, reading_unit="deg/s", raw_unit=unit, visits=6)
    assert one["scale"] * scale == pytest.approx(
        2.0 if scale == 2.0 else 1.0, rel=0.02
    )  # A range that is set wrong stays.


def test_a_compass_rests_in_the_positions_of_a_recipe_beside_any_hard_iron(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """By the direction of what is left about their centre, not about zero."""
    faces = np.repeat(50 * np.kron(np.eye(3), [[1.0], [-1.0]]), 300, axis=0)
    path = tmp_path / "coils.csv"
    y = faces + [60.0, -45.0, 20.0] + 0.1 * rng.standard_normal(faces.shape)
    np.savetxt(path, np.c_[np.arange(1800) / 100, y], "%.5g", ",", header="t,mx,my,mz")
    check(understood(capsys, str(path), "--recipe", "magnetometer-six-point"), reading_unit="uT", visits=6, poses=6)


def test_a_compass_in_gauss_whose_iron_makes_it_as_large_as_gravity(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither name nor stamp: readings of .4 about a middle .77 away are near 1 in the middle, and no accelerometer."""
    d = rng.standard_normal((600, 3))
    y = (
        0.41 * d / np.linalg.norm(d, axis=1, keepdims=True)
        + [-0.25, 0.27, -0.68]
        + 0.01 * rng.standard_normal((600, 3))
    )
    np.savetxt(tmp_path / "a.csv", y, "%.5f", ",", header="x,y,z", comments="")
    one = understood(capsys, str(tmp_path / "a.csv"))
    check(one, reading_unit="uT", raw_unit="gauss", visits_by="readings")


@pytest.mark.parametrize(("names", "unit"), [("mag_x,mag_y,mag_z", "uT"), ("ax,ay,az", "g"), ("u,v,w", "g")])
def test_names_of_given_columns_tell_the_quantity_before_counts_do(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, names: str, unit: str
) -> None:
    """Counts near a power of two, which an accelerometer's would be."""
    path = tmp_path / "log.csv"
    counts = np.round(sphere(rng, 300) * 4096 + [9, -8, 4])
    np.savetxt(path, counts, "%d", ",", header=names, comments="")
    check(understood(capsys, str(path), "--columns", names), reading_unit=unit)


@pytest.mark.parametrize("row", ["Mx %d My %d Mz %d", "mx: %d, my: %d, mz: %d", "mx=%d my=%d mz=%d"])
def test_names_in_front_of_each_number_name_the_columns(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, row: str
) -> None:
    path = tmp_path / "log.txt"
    counts = np.round(sphere(rng, 300) * 530 + [9, -80, -24])
    path.write_text("\n".join(row % tuple(r) for r in counts.astype(int).tolist()))
    check(understood(capsys, str(path)), reading_unit="uT", visits=300)


def test_named_turn_rates_of_given_columns_are_no_gravity(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Of some 1 rad/s in the middle, as gravity is of 1 g."""
    path = tmp_path / "log.csv"
    y = np.repeat(rng.normal(0, 0.65, (60, 3)), 200, axis=0)
    y += rng.normal(0, 0.001, y.shape)
    np.savetxt(path, y, "%.5f", ",", header="gyr_x,gyr_y,gyr_z", comments="")
    one = understood(capsys, str(path), "--columns", "gyr_x,gyr_y,gyr_z")
    check(one, reading_unit="deg/s")


def test_a_compass_that_lies_on_no_ellipsoid_is_not_named_in_its_stead(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Nine tenths of the rows say again what a slower compass said, the others are of a machine that starts."""
    path = tmp_path / "magnetometer.csv"
    turned = np.round(sphere(rng, 90) * 50, 1)
    started = np.round(sphere(rng, 90) * rng.uniform(5, 120, (90, 1)), 1)
    np.savetxt(path, np.r_[np.repeat(turned, 60, axis=0), started], "%.1f", ",")
    assert station("import", path) == 2
    said = capsys.readouterr().err
    assert "--columns" not in said
