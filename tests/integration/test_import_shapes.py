"""Files in the shapes that other people's loggers write: preambles, lines of units, odd clocks, names and values."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from station.domain.core.types import Floats
from tests.fakes.command import station
from tests.integration.test_import import FACES, G, check, tumble, understood

Shape = Callable[[Floats, Floats], str]


def joined(rows: Any, by: str) -> str:
    return "".join(by.join(f"{v:.6f}" if isinstance(v, float) else str(v) for v in row) + "\n" for row in rows)


def rows(y: Floats, turn: Floats, stamp: Callable[[int], Any]) -> list[list[Any]]:
    return [[stamp(i), *turn[i].tolist(), *(y[i] * G).tolist()] for i in range(len(y))]


def euroc(y: Floats, turn: Floats) -> str:
    head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    head += "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
    return head + joined(rows(y, turn, lambda i: 1403636579758555392 + i * 10_000_000), ",")


def ticks(y: Floats, turn: Floats) -> str:
    """A counter of 100 µs that wraps at 2³², and a preamble of comments that states the rate."""
    head = (
        "// General information:\n// Update Rate: 100.0Hz\nSampleTimeFine\tGyr_X\tGyr_Y\tGyr_Z\tAcc_X\tAcc_Y\tAcc_Z\n"
    )
    return head + joined(rows(y, turn, lambda i: (4_294_900_000 + 100 * i) % 2**32), "\t")


def units_row(y: Floats, turn: Floats) -> str:
    names = ["Unix_CAL", *(f"Gyro_{a}_CAL" for a in "XYZ"), *(f"Accel_LN_{a}_CAL" for a in "XYZ")]
    units = ["ms", *["deg/s"] * 3, *["m/(s^2)"] * 3]
    head = '"sep=\t"\n' + joined([["Shimmer_Timestamp_" + names[0], *names[1:]], units], "\t")
    return head + joined(rows(y, turn, lambda i: 1.6e12 + 10.0 * i), "\t")


def trailing(y: Floats, turn: Floats) -> str:
    head = "sep=,\nDeviceTag:,Dot1\n\nPacketCounter,SampleTimeFine,Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z,\n"
    return head + joined([[i, *row, ""] for i, row in enumerate(rows(y, turn, lambda i: 10_000 * i))], ",")


def sparse(y: Floats, turn: Floats) -> str:
    """A last column that is empty but at the end."""
    told = rows(y, turn, lambda i: 10 * i)
    lines = [[*row, "127.1" if i > len(told) - 30 else ""] for i, row in enumerate(told)]
    return "# begun at 1609460646\nms,gx,gy,gz,ax,ay,az,wind_deg\n" + joined(lines, ",")


def spoken(y: Floats, turn: Floats) -> str:
    head = "Initializing I2C devices...\nMPU6050 connection successful\n"
    counts = np.c_[np.round(16384 * y), np.round(131 * turn)].astype(int).tolist()
    return head + "".join("a/g:\t" + "\t".join(map(str, row)) + "\n" for row in counts)


def keyed(y: Floats, turn: Floats) -> str:
    return "".join(f"t:{i / 100:.2f}, ax:{a:.4f}, ay:{b:.4f}, az:{c:.4f}\n" for i, (a, b, c) in enumerate(y * G))


def wrapping(y: Floats, turn: Floats) -> str:
    return "ms,ax,ay,az\n" + joined([[10 * i % 65536, *(row * G).tolist()] for i, row in enumerate(y)], ",")


def keyed_rate(y: Floats, turn: Floats) -> str:
    counts = np.c_[np.round(16384 * y), np.round(131 * turn)].astype(int).tolist()
    return "Fs,100\nLogging Type,0\nWaiting time,3\nax,ay,az,gx,gy,gz\n" + joined(counts, ",")


def power_cut(y: Floats, turn: Floats) -> str:
    """A logger that lost power: a run of NUL bytes where a block of the card was never written."""
    lines = joined([[i / 100, *row] for i, row in enumerate((y * G).tolist())], ",")
    return "t,ax,ay,az\n" + "\0" * 700 + "\n" + lines + "\0" * 90


def unknown_language(y: Floats, turn: Floats) -> str:
    """Time by its steps where its name says nothing."""
    return "Aika;kiiht X;kiiht Y;kiiht Z\n" + joined([[i / 100, *r] for i, r in enumerate((y * G).tolist())], ";")


def clock_text(y: Floats, turn: Floats) -> str:
    lines = [f"10:{21 + i // 6000:02d}:{i % 6000 / 100:06.3f}".replace(".", ",") for i in range(len(y))]
    cells = [";".join(f"{v:.5f}" for v in row).replace(".", ",") for row in (y * G).tolist()]
    return "time;ax;ay;az\n" + "".join(f"{a};{b}\n" for a, b in zip(lines, cells, strict=True))


def colons_to_the_end(y: Floats, turn: Floats) -> str:
    """A time of day whose milliseconds stand behind a colon, as phones' loggers write it."""
    lines = [f"10:{21 + i // 6000:02d}:{i % 6000 // 100:02d}:{10 * (i % 100):03d}" for i in range(len(y))]
    return "time,gFx,gFy,gFz,TgF\n" + joined(
        [[s, *row, 1.0] for s, row in zip(lines, (y * G).tolist(), strict=True)], ","
    )


def past_noon(y: Floats, turn: Floats) -> str:
    """A clock of twelve hours that goes from 12:59:40 to 1:00 in the afternoon."""
    seconds = 59 * 60 + 40 + np.arange(len(y)) / 100
    lines = [f"5/1/2024 {12 if s < 3600 else 1}:{int(s // 60) % 60:02d}:{s % 60:06.3f} PM" for s in seconds.tolist()]
    return "Date,X,Y,Z\n" + joined([[s, *row] for s, row in zip(lines, (y * G).tolist(), strict=True)], ",")


def grouped(mark: str, delimiter: str, quote: str) -> Shape:
    """Counts whose thousands are set apart by a mark."""

    def shape(y: Floats, turn: Floats) -> str:
        counts = np.round(16384 * y).astype(int).tolist()
        cells = [delimiter.join(f"{quote}{c:,}{quote}".replace(",", mark) for c in row) for row in counts]
        stamps = [f"{i / 100:.2f}".replace(".", "," if mark == "." else ".") for i in range(len(y))]
        head = delimiter.join(["t", "ax", "ay", "az"])
        return head + "\n" + "".join(f"{s}{delimiter}{c}\n" for s, c in zip(stamps, cells, strict=True))

    return shape


def json_lines(y: Floats, turn: Floats) -> str:
    return "".join(
        f'{{"t": {10 * i}, "ax": {a:.4f}, "ay": {b:.4f}, "az": {c:.4f}}}\n' for i, (a, b, c) in enumerate(y * G)
    )


def said_in_turn(y: Floats, turn: Floats) -> str:
    """A line a sensor, behind the time at which a terminal received it."""
    lines = ["MPU found!"]
    for i, (a, b) in enumerate(zip((y * G).tolist(), turn.tolist(), strict=True)):
        stamp = f"10:{21 + i // 6000:02d}:{i % 6000 / 100:06.3f} -> "
        lines.append(stamp + "Acceleration X: {:.3f}, Y: {:.3f}, Z: {:.3f} m/s^2".format(*a))
        lines.append(stamp + "Rotation X: {:.3f}, Y: {:.3f}, Z: {:.3f} rad/s".format(*b))
        lines.append(stamp + "Temperature: 28.3 degC")
    return "\n".join(lines)


def a_row_a_sensor(y: Floats, turn: Floats) -> str:
    """Rows of several sensors among each other, told by a word."""
    rows = [
        f"{10 * i},{kind},{row[0]:.5f},{row[1]:.5f},{row[2]:.5f}\n"
        for i in range(len(y)) for kind, row in (("GYR", turn[i]), ("ACC", y[i] * G))
    ]  # fmt: skip
    return "timestamp_ms,sensor,x,y,z\n" + "".join(rows)


def flight_log(y: Floats, turn: Floats) -> str:
    """Formats, settings, then rows of several kinds; two sensors of one kind."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
             "FMT, 129, 50, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"]  # fmt: skip
    lines += [f"PARM, {i}, SETTING_{i}, 1.5" for i in range(600)]
    for i in range(len(y)):
        for sensor in (0, 1):
            numbers = [*turn[i].tolist(), *((y[i] + 0.05 * sensor) * G).tolist()]
            lines.append(f"IMU, {5_000_000 + 10_000 * i}, {sensor}, " + ", ".join(f"{v:.5f}" for v in numbers))
        lines.append(f"ATT, {5_000_000 + 10_000 * i}, 0.0, 1.2")
    return "\n".join(lines)


def echoed(y: Floats, turn: Floats) -> str:
    """What `rostopic echo` prints."""
    text = []
    for i, (a, b) in enumerate(zip((y * G).tolist(), turn.tolist(), strict=True)):
        text.append(
            f"header: \n  seq: {i}\n  stamp: \n    secs: {1714550000 + i // 100}\n    nsecs: {i % 100 * 10**7}\n"
        )
        for name, row in (("angular_velocity", b), ("linear_acceleration", a)):
            text.append(f"{name}: \n" + "".join(f"  {axis}: {v:.6f}\n" for axis, v in zip("xyz", row, strict=True)))
        text.append("---\n")
    return "".join(text)


def start_and_rate(y: Floats, turn: Floats) -> str:
    """The start and the rate of every column above the readings, as wrist bands write them."""
    counts = np.round(64 * y).astype(int).tolist()
    return "1714550000.00,1714550000.00,1714550000.00\n100.000000,100.000000,100.000000\n" + joined(counts, ",")


@pytest.mark.parametrize(
    ("shape", "raw_unit", "time_unit"),
    [
        (euroc, "m/s²", "ns"),
        (ticks, "m/s²", "none"),
        (units_row, "m/s²", "ms"),
        (trailing, "m/s²", "us"),
        (sparse, "m/s²", "ms"),
        (spoken, "LSB", "none"),
        (keyed, "m/s²", "s"),
        (wrapping, "m/s²", "ms"),
        (clock_text, "m/s²", "s"),
        (keyed_rate, "LSB", "none"),
        (power_cut, "m/s²", "s"),
        (unknown_language, "m/s²", "s"),
        (colons_to_the_end, "m/s²", "s"),
        (past_noon, "m/s²", "s"),
        (grouped(",", ",", '"'), "LSB", "s"),
        (grouped(".", ";", ""), "LSB", "s"),
        (json_lines, "m/s²", "ms"),
        (said_in_turn, "m/s²", "s"),
        (a_row_a_sensor, "m/s²", "ms"),
        (flight_log, "m/s²", "us"),
        (echoed, "m/s²", "ns"),
        (start_and_rate, "LSB", "none"),
    ],
)
def test_shapes_of_other_loggers(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    shape: Shape, raw_unit: str, time_unit: str,
) -> None:  # fmt: skip
    y = tumble(rng)
    turn = 0.02 + 0.1 * rng.standard_normal(y.shape) + 40 * np.gradient(y, axis=0)
    path = tmp_path / "log.txt"
    path.write_text(shape(y, turn), encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, rate_hz=100.0, raw_unit=raw_unit, time_unit=time_unit, visits=8, poses=8, gaps=0)
    assert one["magnitude"]["median"] == pytest.approx(1.0, abs=0.01)


def test_a_matlab_file_of_version_7_3_holds_a_matrix_whose_first_column_is_time(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = tumble(rng)
    path = tmp_path / "buffer.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["accelBuffer"] = np.c_[np.arange(len(y)) / 100, y].T
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + bytes([0, 2]) + b"IM"
    path.write_bytes(content)
    check(understood(capsys, str(path)), rate_hz=100.0, time_unit="s", raw_unit="g", visits=8, poses=8)


def sphere(rng: np.random.Generator, readings: int) -> Floats:
    """Directions (n, 3) all round."""
    y = rng.standard_normal((readings, 3))
    return np.asarray(y / np.linalg.norm(y, axis=1, keepdims=True))


@pytest.mark.parametrize("readings", [60, 450])
def test_a_list_of_readings_all_round_is_a_pose_each(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], readings: int
) -> None:
    iron = (
        sphere(rng, readings) @ np.diag([1.1, 0.95, 1.0]) * 400
        + np.array([120, -260, 40])
        + rng.normal(0, 6, (readings, 3))
    )
    path = tmp_path / "compass.txt"
    np.savetxt(path, np.round(iron), fmt="%d", delimiter="\t")
    check(understood(capsys, str(path)), visits=readings, visits_by="readings")
    one = understood(capsys, str(path), "--blocks", "1")
    check(one, visits=readings, visits_by="blocks")


def test_a_unit_near_one_g_in_any_place_is_in_g(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "poses.csv"
    np.savetxt(path, sphere(rng, 150) + np.array([0.02, -0.01, 0.03]), delimiter=",")
    check(understood(capsys, str(path)), raw_unit="g", visits=150)


def test_a_unit_that_changes_on_the_way_is_refused_with_its_row(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Half of it would never be at rest beside the other half, and be left out."""
    one = tumble(rng)
    path = tmp_path / "two.csv"
    np.savetxt(path, np.r_[one, one * 1000], delimiter=",")
    assert station("import", path, "--rate", "100", "--out", tmp_path / "out.parquet") == 2
    said = capsys.readouterr().err
    assert "are 1000 times as large, as in another unit" in said
    row = int(said.split("row ")[1].split()[0])
    assert abs(row - len(one)) <= len(one) / 20


def test_readings_that_no_sensor_made_are_left_out_and_missing_ones_change_no_rate(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bus that fails for one transfer gives -32768 or 9999; a logger that is busy loses rows."""
    y = tumble(rng) * G
    y[50, 1], y[900, 2], y[2000, 0] = 9999, -32768, 655.35
    rows_ = np.c_[np.arange(len(y)) / 100, y][np.sort(rng.choice(len(y), round(0.92 * len(y)), replace=False))]
    path = tmp_path / "glitches.csv"
    np.savetxt(path, rows_, "%.5f", ",", header="t,ax,ay,az", comments="")
    one = understood(capsys, str(path))
    check(one, raw_unit="m/s²", visits=8, poses=8)
    assert one["rate_hz"] == pytest.approx(100, rel=1e-3)
    assert [r["id"] for r in one["remarks"]] == ["readings-impossible"]
    assert one["magnitude"]["greatest"] < 1.05


def test_linear_acceleration_is_no_tumble(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Phones take gravity out: what is left at rest is offset and noise."""
    y = (tumble(rng) - np.repeat(FACES, 500, axis=0)[: len(tumble(rng))] + [0.02, 0.03, -0.01]) * G
    path = tmp_path / "linear.csv"
    head = ",".join(["Time (s)", *(f"Linear Acceleration {a} (m/s^2)" for a in "xyz")])
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, y], "%.5f", ",", header=head, comments="")
    assert station("import", str(path)) == 2
    assert "gravity is not in them" in capsys.readouterr().err


def test_a_list_that_scatters_as_widely_as_it_is_large_never_rests(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "compass.txt"
    np.savetxt(path, np.round(sphere(rng, 600) * [500, 460, 300] + rng.normal(0, 45, (600, 3))), fmt="%d")
    code = station("import", str(path), "--unit", "LSB")
    assert code == 0 or "never at rest" in capsys.readouterr().err


def test_shaking_is_no_list_of_poses(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "shaken.csv"
    np.savetxt(path, rng.standard_normal((300, 3)) + np.array([0, 0, 1]), delimiter=",")
    assert station("import", str(path)) == 2
    assert "300 readings stand off the nearest ellipsoid by" in capsys.readouterr().err
