"""Columns in unusual places, under unusual headers, or damaged on their way through other programs."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from station.domain.core.types import Floats
from tests.fakes.command import station
from tests.integration.test_import import G, check, tumble, understood
from tests.integration.test_import_shapes import sphere

Capture = pytest.CaptureFixture[str]
RATE_HZ = 25.0


def saved(path: Path, rows: Floats, delimiter: str = ",", form: str = "%.5f") -> str:
    np.savetxt(path, rows, form, delimiter)
    return str(path)


def slow(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Stamps (n), s, and readings (n, 3) in g of eight poses."""
    y = tumble(rng, rate_hz=RATE_HZ)
    return np.arange(len(y)) / RATE_HZ, y


def refused(capsys: Capture, *args: str | Path) -> str:
    assert station("import", *args) == 2
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1 and "Traceback" not in shown.err
    return shown.err


def test_a_clock_behind_the_readings(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Beside a coarse first axis that seldom changes and mostly rises."""
    t, y = slow(rng)
    rows = np.c_[np.round(y * G, 1), t + 0.24]
    check(understood(capsys, saved(tmp_path / "log.csv", rows, " ")), axes=["column 0", "column 1", "column 2"],
          rate_hz=RATE_HZ, time_unit="s", visits=8)  # fmt: skip


@pytest.mark.parametrize("behind", [0, 3, 4])
def test_columns_of_zeros_are_sensors_that_are_not_there(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, behind: int
) -> None:
    """Turn rates at rest in front of the acceleration, which drift by more than they are large."""
    t, y = slow(rng)
    turn = np.cumsum(1e-4 * rng.standard_normal(y.shape), axis=0)
    path = saved(tmp_path / "log.csv", np.c_[turn, y, np.zeros((len(t), behind))])
    check(understood(capsys, path, "--rate", f"{RATE_HZ}"), axes=["column 3", "column 4", "column 5"], visits=8)


def test_a_still_acceleration_goes_before_a_turn_rate_that_drifts(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    turn = np.cumsum(1e-3 * rng.standard_normal((400, 3)), axis=0)
    still = np.array([0.01, -0.12, 0.99]) + 0.003 * rng.standard_normal((400, 3))
    said = refused(capsys, saved(tmp_path / "back.csv", np.c_[turn, still]), "--rate", f"{RATE_HZ}")
    assert "one stretch of" in said


def test_a_turn_rate_is_no_compass_beside_an_acceleration_that_shakes(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    t = np.arange(2000) / 250
    shaken = np.array([0, 0, -G]) + 2 * np.sin(9 * t)[:, None] * [0.2, 1, 0.5] + 0.3 * rng.standard_normal((2000, 3))
    turn = 4 * np.c_[np.sin(7 * t), np.cos(5 * t), np.sin(3 * t + 1)]
    said = refused(capsys, saved(tmp_path / "platform.txt", np.c_[t, shaken, turn], "\t"))
    assert "of a compass" not in said


def test_what_is_taken_to_be_another_unit_is_of_two_units(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Linear acceleration of somebody who jumps and then stands is eleven times as small, as m/s² and g nearly are."""
    jumps = rng.standard_normal((1500, 3)) * [5, 12, 6]
    path = tmp_path / "jumps.csv"
    rows = np.c_[np.arange(2000) / 100, np.r_[jumps, 0.5 * rng.standard_normal((500, 3))]]
    np.savetxt(path, rows, "%.4f", ",", header="t,ax,ay,az", comments="")
    assert "as in another unit" not in refused(capsys, path)


def test_counts_of_a_compass_outside_of_any_field_of_the_earth_are_of_no_unit(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    counts = np.round(161 * sphere(rng, 400) * [1, 0.95, 1.04] + [20, 50, 80])
    check(understood(capsys, saved(tmp_path / "turned.txt", counts, form="%d")), raw_unit="LSB", visits=400)


def test_numbered_motors_are_no_compass(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Three angles in rad that go round, ever further, and of the size of a field in gauss in the beginning."""
    phase = np.arange(20)[:, None] * 0.7 + 2 * np.pi / 3 * np.arange(3)
    held = np.linspace(0.5, 4, 20)[:, None] * np.cos(phase)
    steps = [np.r_[np.tile(a, (200, 1)), np.linspace(a, b, 50)] for a, b in pairwise(held)]
    turns = np.concatenate(steps)
    rows = np.c_[turns + 1e-3 * rng.standard_normal(turns.shape), np.abs(turns[:, :1]) * 20]
    path = tmp_path / "arm.csv"
    np.savetxt(path, rows, "%.6f", ",", header="M1,M2,M3,Inclination", comments="")
    assert "M1, M2, M3 do not behave as the axes of one sensor" in refused(capsys, path)


def test_stamps_that_a_spreadsheet_rounded_tell_no_time(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    t, y = slow(rng)
    path = tmp_path / "sheet.csv"
    stamps = [f"{6.81e13 + 1e12 * (s > 9):.2E}".replace(".", ",") for s in t]
    lines = [f"{s};{a:.4f};{b:.4f};{c:.4f}" for s, (a, b, c) in zip(stamps, (y * G).tolist(), strict=True)]
    path.write_text("Stamp [ns]; AccX [m/s^2]; AccY [m/s^2]; AccZ [m/s^2]\n" + "\n".join(lines), encoding="utf-8")
    assert f"{len(t)} rows have 2 different stamps" in refused(capsys, path)
    check(understood(capsys, str(path), "--rate", f"{RATE_HZ}"), visits=8, rate_hz=RATE_HZ)


def test_a_header_of_devices_names_kinds_and_units(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    t, y = slow(rng)
    own = ["Timestamp", *(f"Gyroscope {a}" for a in "XYZ"), *(f"Wide Range Accelerometer {a}" for a in "XYZ")]
    heads = [
        ["Shank_R"] * 7 + ["Foot_L"] * 7,
        own * 2,
        ["CAL"] * 14,
        (["mSecs"] + ["deg/sec"] * 3 + ["m/(sec^2)"] * 3) * 2,
    ]
    still = np.array([0.0, 0.0, -G])
    block = np.c_[1000 * t, rng.standard_normal(y.shape), y * G]
    other = np.c_[1000 * t, rng.standard_normal(y.shape), still + 0.01 * rng.standard_normal(y.shape)]
    path = tmp_path / "gait.dat"
    np.savetxt(path, np.c_[block, other], "%.4f", "\t", header="\n".join("\t".join(h) for h in heads), comments="")
    one = understood(capsys, str(path))
    check(one, axes=[f"Shank_R Wide Range Accelerometer {a}" for a in "XYZ"], raw_unit="m/s²", visits=8,
          rate_hz=RATE_HZ)  # fmt: skip
    assert [r["id"] for r in one["remarks"]] == ["axes-of-others"]


Line = Callable[[float, list[float]], str]


@pytest.mark.parametrize(
    ("line", "axes"),
    [
        (lambda t, r: f"2025-10-04 16:35:{t:06.3f},EULER(deg): R=1.7,P=9.2,Y={t:.1f},GYRO: X=-0.000,Y=0.1,Z=0.000,"
         "ACCEL: X={:.3f},Y={:.3f},Z={:.3f},MAG: X=57.4,Y=-27.4,Z=53.2,".format(*r)
         + f"ALT: {16555014.81 - 9 * t:.2f}m,GPS: 3D_FIX,SAT=4,iTOW={558330000 + round(t)}ms", "ACCEL_"),
        (lambda t, r: f"2024-04-27-12-15-{int(t):02d}::: IMU Acceleration: [{r[0]:.4f} {r[1]:.4f}  {r[2]:.4f}], "
         "IMU Angular Velocity: [ 0.1 0. -0.2] ", "IMU_Acceleration_"),
        (lambda t, r: f" {1371350234 + round(1e6 * t)}: [{1638 * r[0]:3.0f} {1638 * r[1]:3.0f} {1638 * r[2]:3.0f}]"
         f" ret={-(round(25 * t) % 99 == 7)}", ""),
    ],
)  # fmt: skip
def test_three_values_behind_the_name_of_their_sensor(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, line: Line, axes: str
) -> None:
    t, y = slow(rng)
    path = tmp_path / "terminal.log"
    path.write_text("\n".join(map(line, t.tolist(), (y * G).tolist())) + "\n", encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, visits=8, poses=8)
    assert not axes or (one["axes"], one["raw_unit"]) == ([axes + a for a in "xyz"], "m/s²")
    assert one["rate_hz"] == pytest.approx(RATE_HZ, rel=0.02)


@pytest.mark.parametrize(
    "frame",
    ["{:03X}#2A366C2BBA04{:04X}", "  can0  {:03X}   [4]  2A 36 6C {:02X}", "(1436509052.2) can0 {:03X}#2A36{:04X}"],
)
@pytest.mark.parametrize("name", ["bus.log", "bus.txt"])
def test_frames_as_text_ask_for_their_description(tmp_path: Path, capsys: Capture, frame: str, name: str) -> None:
    path = tmp_path / name
    path.write_text("".join(frame.format(0x181 + i % 3, i) + "\n" for i in range(30)), encoding="utf-8")
    assert "holds CAN frames: name the file that describes them with --dbc" in refused(capsys, path)


def test_the_one_file_of_a_pose_that_was_not_held_is_named(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    poses = {"top": (0, 0, 1), "bottom": (0, 0, -1), "left": (0, 1, 0), "right": (0, -1, 0), "back": (-1, 0, 0)}
    for name, pose in poses.items():
        y = np.array(pose) + 0.003 * rng.standard_normal((500, 3))
        if name == "right":
            y += 0.1 * np.sin(np.arange(500) / 9)[:, None] * [1, 0, 1]
        saved(tmp_path / f"{name}.csv", np.c_[np.arange(500) / 100, y])
    said = refused(capsys, *(tmp_path / f"{name}.csv" for name in poses))
    assert "right.csv: the unit moves for most of the time, while each of 4 other files holds one still pose" in said


@pytest.mark.parametrize(("held", "cuts_s"), [(1, (10, 60)), (2, (5, 30, 60))])
def test_one_rest_means_the_same_however_it_is_cut(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, held: int, cuts_s: tuple[int, ...]
) -> None:
    """In blocks that leave a part over; readings that a logger writes twice, too."""
    n = 243 * 20
    drift = np.linspace(0, 1, n)[:, None] * [0.004, 0, 0]
    y = np.repeat(np.array([0, 0, 1]) + drift + 0.002 * rng.standard_normal((n, 3)), held, axis=0)
    rate_hz = 20 * held
    path = tmp_path / "still.csv"
    np.savetxt(path, np.c_[np.arange(len(y)) / rate_hz, y], "%.6f", ",", header="t,ax,ay,az", comments="")
    shown = []
    for cut_s in cuts_s:
        out = tmp_path / f"{cut_s}.csv"
        assert station("import", path, "--blocks", f"{cut_s * rate_hz}", "--out", out) == 0
        cut = pd.read_csv(out)
        cut["position"] = "z-up"
        cut.to_csv(out, index=False)
        capsys.readouterr()
        station("diagnose", "--samples", out, "--recipe", "one-point", "--json", "-")
        said = json.loads(capsys.readouterr().out)
        shown.append((said["verdict"], said["causes"]))
    assert shown == [shown[0]] * len(cuts_s)
    assert shown[0][0] != "none"


@pytest.mark.parametrize(("comments", "axes"), [
    (["data of sensor one"], ["column 1", "column 2", "column 3"]),
    (["made by bench four", "time ax ay az", "s g g g"], ["ax", "ay", "az"]),
])  # fmt: skip
def test_a_sentence_of_as_many_words_as_columns_names_none(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, comments: list[str], axes: list[str]
) -> None:
    path = tmp_path / "tumble.txt"
    y = tumble(rng)
    head = "\n".join(f"% {line}" for line in comments)
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, y], "%.5f", " ", header=head, comments="")
    assert understood(capsys, str(path))["axes"] == axes
