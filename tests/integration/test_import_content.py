"""What the numbers of a file tell where its header does not: which columns, which quantity, which rows hold nothing."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.domain.capture import rest_segments
from station.domain.core.types import Floats
from tests.fakes.command import station
from tests.integration.test_import import G, check, tumble, understood
from tests.integration.test_import_shapes import sphere

Capture = pytest.CaptureFixture[str]


def saved(path: Path, rows: Any, fmt: str = "%.5f", header: str = "") -> str:
    np.savetxt(path, rows, fmt, ",", header=header, comments="")
    return str(path)


def refused(capsys: Capture, *args: str) -> str:
    """The sentence by which `station import` refuses a file."""
    code = station("import", *args)
    shown = capsys.readouterr()
    assert code == 2, shown.out
    return shown.err


def remarks(one: dict[str, Any]) -> list[str]:
    return [r["id"] for r in one["remarks"]]


def test_rows_never_filled_are_no_visit(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """A buffer made for more readings than came ends in zeros, which rest very well."""
    y = np.r_[tumble(rng) * G, np.zeros((300, 3))]
    one = understood(capsys, saved(tmp_path / "buffer.csv", y))
    check(one, visits=8, poses=8)
    assert remarks(one) == ["rows-unfilled"]
    assert one["magnitude"]["least"] > 0.9


def test_a_code_for_none_on_all_axes_is_no_reading(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = tumble(rng)
    y[::41] = -9999
    one = understood(capsys, saved(tmp_path / "coded.csv", np.c_[np.arange(len(y)) / 100, y], header="t,ax,ay,az"))
    check(one, visits=8, poses=8, rate_hz=100.0)
    assert remarks(one) == ["rows-unfilled"]


@pytest.mark.parametrize("glitch_g", [0.3, -16.0, 1e9])
def test_outlying_readings_and_stamps_cut_no_rest_in_two(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, glitch_g: float
) -> None:
    """A rest goes on after a reading or a stamp that a line corrupted, and neither hides the unit of the others."""
    y = tumble(rng)
    time_s = np.arange(len(y)) / 100
    whole = understood(capsys, saved(tmp_path / "whole.csv", np.c_[time_s, y], header="t,ax,ay,az"))
    y[150::211, 0] += glitch_g
    time_s[[170, 333]] = 0.0, 1e6
    one = understood(capsys, saved(tmp_path / "corrupt.csv", np.c_[time_s, y], header="t,ax,ay,az"))
    check(one, visits=8, poses=8, rate_hz=100.0, restarts=0)
    # Of the readings some were taken while the unit was turned, and nobody could tell these.
    assert set(remarks(one)) <= {"import-reading-outliers", "readings-impossible", "import-stamp-outliers"}
    assert "import-stamp-outliers" in remarks(one)
    assert one["rate_hz"] == whole["rate_hz"]
    assert one["noise"] == pytest.approx(whole["noise"], rel=0.02)
    assert one["magnitude"] == pytest.approx(whole["magnitude"], rel=1e-3)


def test_an_outlier_shifts_no_block(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Blocks of readings without stamps are counted with those that are left out."""
    y = np.repeat(sphere(rng, 24), 50, axis=0) + 0.002 * rng.standard_normal((1200, 3))
    y[[77, 510], 1] += 3.0, -0.4
    y[303, 2] = 1e9
    one = understood(capsys, saved(tmp_path / "blocks.csv", y, header="ax,ay,az"))
    check(one, visits=24, visits_by="shown-blocks", readings=1197)
    assert remarks(one) == ["readings-impossible", "import-reading-outliers"]


def test_an_outlier_of_counts_far_off_zero_is_seen(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = np.round(32768 + 4096 * tumble(rng))
    time_s = np.arange(len(y)) / 100
    y[[150, 660], 0] += 600
    time_s[[200, 900, 1700, 2300, 3100]] = 0.0, 1e6, -3.0, 1e6, 0.0
    one = understood(capsys, saved(tmp_path / "counts.csv", np.c_[time_s, y], header="t_s,ax,ay,az"))
    check(one, visits=8, poses=8, rate_hz=100.0, restarts=0)
    assert remarks(one) == ["import-reading-outliers", "import-stamp-outliers"]
    assert one["readings"] == len(y) - 2


@pytest.mark.parametrize("bits", [12, 16])
def test_counts_below_zero_written_as_unsigned(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, bits: int
) -> None:
    counts = np.round(tumble(rng) * 2 ** (bits - 3)).astype(int) % 2**bits
    one = understood(capsys, saved(tmp_path / "raw.csv", counts, "%d"))
    check(one, visits=8, poses=8, raw_unit="LSB", scale=1 / 2 ** (bits - 3))
    assert remarks(one) == ["counts-unsigned"]
    assert one["magnitude"]["greatest"] < 1.05


def test_counts_about_a_middle_are_not_unsigned(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    counts = np.round(tumble(rng) * 13_000 + 32_768).astype(int)
    one = understood(capsys, saved(tmp_path / "middle.csv", counts, "%d"))
    check(one, visits=8, poses=8)
    assert remarks(one) == []


def test_of_columns_without_names_those_that_turn_in_a_known_unit_are_the_axes(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Behind them a pressure and two temperatures, which are steadier than any accelerometer."""
    y = tumble(rng) * G
    still = np.array([97.5, 33.9, 21.0]) + 1e-3 * rng.standard_normal(y.shape)
    wraps = np.round(rng.standard_normal(y.shape) * 40) % 8192
    one = understood(capsys, saved(tmp_path / "log.txt", np.c_[np.arange(len(y)) / 100, y, wraps, still]))
    check(one, axes=["column 1", "column 2", "column 3"], visits=8, raw_unit="m/s²", rate_hz=100.0)


def iron(rng: np.random.Generator, size: float, offset: float) -> Floats:
    return sphere(rng, 400) * [1.05 * size, size, 0.97 * size] + [offset, -0.6 * offset, 0.4 * offset]


@pytest.mark.parametrize(
    ("name", "size", "offset", "unit"),
    [("turned", 48.0, 25.0, "uT"), ("turned", 0.48, 0.1, "gauss"), ("Board2_raw_mag_data", 48.0, 2.0, "uT")],
)
def test_a_field_without_a_header_is_no_acceleration(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, name: str, size: float, offset: float, unit: str
) -> None:
    one = understood(capsys, saved(tmp_path / f"{name}.csv", iron(rng, size, offset)))
    check(one, reading_unit="uT", raw_unit=unit, visits=400)


def test_names_that_tell_a_quantity_go_before_names_that_tell_none(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    turn = np.repeat(np.eye(3), 400, axis=0) * 90 + 0.05 * rng.standard_normal((1200, 3))
    target = np.repeat(np.eye(3), 400, axis=0) * 2.1
    rows = np.c_[np.arange(1200) / 100, turn, target]
    one = understood(capsys, saved(tmp_path / "runs.csv", rows, header="t,gx,gy,gz,ref_x,ref_y,ref_z"))
    check(one, axes=["gx", "gy", "gz"], reading_unit="deg/s")


def test_readings_of_gravity_go_before_names_of_other_quantities(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng) * G
    rows = np.c_[np.arange(len(y)) / 100, y, 0.02 * rng.standard_normal(y.shape), y / G * 40]
    one = understood(capsys, saved(tmp_path / "log.csv", rows, header="time,tx,ty,tz,wx,wy,wz,mx,my,mz"))
    check(one, axes=["tx", "ty", "tz"], raw_unit="m/s²", visits=8)


def test_a_sensor_that_is_not_there_is_none(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    rows = np.c_[np.zeros((400, 3)), iron(rng, 48.0, 10.0)]
    one = understood(capsys, saved(tmp_path / "log.csv", rows, header="acc_x,acc_y,acc_z,mag_x,mag_y,mag_z"))
    check(one, axes=["mag_x", "mag_y", "mag_z"], reading_unit="uT", visits=400)


def test_very_many_readings_that_never_rest_are_thinned(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = sphere(rng, 3500) * 48.0 + [5, -3, 8]
    one = understood(capsys, saved(tmp_path / "compass.csv", y))
    check(one, visits=500, visits_by="readings")
    assert remarks(one) == ["readings-thinned"]


def test_the_last_digit_of_a_printed_number_is_no_step(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng)
    one = understood(capsys, saved(tmp_path / "digits.csv", np.c_[np.arange(len(y)) / 100, y], "%.8f"))
    assert one["lsb"] == [0.0, 0.0, 0.0]


def test_short_stops_without_stamps_are_found_at_a_slower_rate(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Stops of 60 to 75 readings, one upon the other: a second at 25 Hz, and not at the 100 Hz that are assumed."""
    poses = sphere(rng, 16)
    y = np.concatenate([np.tile(p, (int(n), 1)) for p, n in zip(poses, rng.integers(60, 76, 16), strict=True)])
    one = understood(capsys, saved(tmp_path / "poses.csv", y + 0.002 * rng.standard_normal(y.shape)))
    assert one["poses"] == len(np.unique(rest_segments.orientations(poses)))
    assert one["visits"] == 16


def loop_in_one_pose(rng: np.random.Generator) -> Floats:
    """A sensor at rest whose offset bends with its temperature, −18 to 74 °C: (n, 3) in g, and °C (n)."""
    T = 28 + 46 * np.sin(np.linspace(0, 2 * np.pi, 3000))
    y = np.stack([0.01 - 5e-5 * T + 4e-7 * T**2, 0.02 + 3e-5 * T, 1.004 + 1.2e-4 * T + 2e-8 * T**3], axis=1)
    return np.asarray(np.c_[y + rng.normal(0, 5e-4, (3000, 3)), T])


@pytest.mark.parametrize("header", ["ax_g,ay_g,az_g,temp", "x_g,y_g,z_g,temp", "x (G),y (G),z (G),temp"])
def test_g_behind_a_name_is_gravity_and_no_gauss(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, header: str
) -> None:
    one = understood(capsys, saved(tmp_path / "loop.csv", loop_in_one_pose(rng), header=header), "--blocks", "100")
    assert (one["reading_unit"], one["raw_unit"], "unit" in one["inferred"]) == ("g", "g", False)
    assert one["magnitude"]["median"] == pytest.approx(1.005, abs=0.01)


@pytest.mark.parametrize(
    ("header", "unit", "factor"),
    [
        ("t;x (in radians/s);y (in radians/s);z (in radians/s)", "deg/s", 180 / np.pi),
        ("t;x (in G's);y (in G's);z (in G's)", "g", 1.0),
        ("t;x [microteslas];y [microteslas];z [microteslas]", "uT", 1.0),
        ("t;x [degrees per second];y [degrees per second];z [degrees per second]", "deg/s", 1.0),
        ("t;x_mps2;y_mps2;z_mps2", "g", 1 / G),
    ],
)
def test_a_unit_written_out_tells_what_is_measured(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, header: str, unit: str, factor: float
) -> None:
    y = tumble(rng)
    path = tmp_path / "readings.csv"
    np.savetxt(path, np.c_[np.arange(len(y)) / 100, y / factor], "%.6f", ";", header=header, comments="")
    one = understood(capsys, str(path))
    assert (one["reading_unit"], one["scale"], "unit" in one["inferred"]) == (unit, pytest.approx(factor), False)


@pytest.mark.parametrize(
    ("header", "factor", "taken"),
    [("m/s^2", 1.0, "g"), ("mg", 1.0, "g"), ("g", G, "m/s²"), ("g", 1000.0, "mg"), ("m/s^2", 16384.0, "LSB")],
)
def test_a_header_that_gravity_contradicts_is_not_believed(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, header: str, factor: float, taken: str
) -> None:
    y = factor * (tumble(rng) + 0.03)
    names = ",".join(f"a{axis} [{header}]" for axis in "xyz")
    path = saved(tmp_path / "mislabelled.csv", np.c_[np.arange(len(y)) / 100, y], header=f"t [s],{names}")
    one = understood(capsys, path)
    check(one, raw_unit=taken, visits=8, scale=1 / factor)
    assert "unit" in one["inferred"]
    assert remarks(one) == ["header-unit-wrong"]
    if factor > 1:
        # What a person states holds.
        held = understood(capsys, path, "--unit", header)
        assert held["magnitude"]["median"] > 5
        assert "header-unit-wrong" not in remarks(held)


@pytest.mark.parametrize("wrong", [1 / 8, 1 / 2, 2.0, 4.0, 8.0])
def test_a_range_set_wrong_is_no_other_unit(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, wrong: float
) -> None:
    """A sensor that reads gravity by a power of two too large or small says what its gain is, and not its unit."""
    y = wrong * tumble(rng)
    names = ",".join(f"a{axis} [g]" for axis in "xyz")
    path = saved(tmp_path / "range.csv", np.c_[np.arange(len(y)) / 100, y], header=f"t [s],{names}")
    if wrong < 1 / 2:
        assert "gravity is not in them" in refused(capsys, path)
        return
    one = understood(capsys, path)
    check(one, raw_unit="g", visits=8, scale=1.0)
    assert "unit" not in one["inferred"]


@pytest.mark.parametrize(
    ("header", "factor", "likelier"), [("t [s]", 1e3, "ms"), ("t [s]", 1e6, "us"), ("time_ms", 1e9, "ns"), ("s", 1, "")]
)
def test_a_clock_that_few_sensors_have_is_doubted(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, header: str, factor: float, likelier: str
) -> None:
    y = tumble(rng)
    table = np.c_[factor * np.arange(len(y)) / 100, y]
    path = saved(tmp_path / "slow.csv", table, header=f"{header},ax [g],ay [g],az [g]")
    said = [r for r in understood(capsys, path)["remarks"] if r["id"] == "time-header-doubtful"]
    assert [(r["likelier"], pytest.approx(100)) for r in said] == [(likelier, r["likely_hz"]) for r in said]
    assert bool(said) == bool(likelier)
    if likelier:
        right = understood(capsys, path, "--time-unit", likelier)
        check(right, rate_hz=100.0, visits=8)
        assert remarks(right) == []


@pytest.mark.parametrize(("header", "zero"), [("temp [°C]", 273.15), ("temp_C", 273.15), ("temp [K]", 273.15)])
def test_kelvins_are_taken_as_such(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, header: str, zero: float
) -> None:
    y = tumble(rng)
    warm = zero + 25.0 + 2e-4 * np.arange(len(y))
    path = tmp_path / "warm.csv"
    saved(path, np.c_[np.arange(len(y)) / 100, y, warm], header=f"t [s],ax [g],ay [g],az [g],{header}")
    one = understood(capsys, str(path))
    assert one["temperature_degC"] == pytest.approx([25.0, 25.8], abs=0.1)
    assert remarks(one) == ([] if "K" in header else ["kelvin-called-celsius"])


@pytest.mark.parametrize("more", [-1, 2])
def test_a_header_with_more_or_fewer_cells_than_the_rows(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, more: int
) -> None:
    """Loggers end each row with empty cells for sensors that are not there, or name a sensor that never reads."""
    y = tumble(rng)
    names = ["t", "gx", "gy", "gz", "ax", "ay", "az", "mark"]
    rows = [f"{i / 100:.2f},{0.001 * i:.3f},0.1,0.2,{x:.5f},{y:.5f},{z:.5f},7" for i, (x, y, z) in enumerate(y)]
    end = "," * (more + 1) if more > 0 else ""
    head = names if more > 0 else [*names, "note"]
    path = tmp_path / "phone.csv"
    path.write_text("\n".join([",".join(head), *(row + end for row in rows)]))
    one = understood(capsys, str(path))
    check(one, visits=8, poses=8, axes=["ax", "ay", "az"], rate_hz=100.0)


def test_a_row_number_without_a_name_is_no_reading(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """As R writes a table: the header has a cell fewer than the rows."""
    y = tumble(rng)
    path = tmp_path / "r.txt"
    lines = [f"{i + 1}\t{x:.5f}\t{y:.5f}\t{z:.5f}\t{i / 100:.2f}" for i, (x, y, z) in enumerate(y)]
    path.write_text("\n".join(["ax\tay\taz\ttime", *lines]))
    check(understood(capsys, str(path)), visits=8, poses=8, axes=["ax", "ay", "az"], rate_hz=100.0)


@pytest.mark.parametrize("names", ["qw,qx,qy,qz", "id,position_x,position_y,position_z", "e,euler_x,euler_y,euler_z"])
def test_what_is_computed_is_no_reading(rng: np.random.Generator, tmp_path: Path, capsys: Capture, names: str) -> None:
    q = sphere(rng, 400)
    path = saved(tmp_path / "imu.csv", np.c_[np.arange(400) / 100, q[:, 0], q], header=f"t,{names}")
    assert "are of another quantity" in refused(capsys, path)


def test_a_circle_in_one_plane_is_no_compass_turned_all_round(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """A phone on a table lies on an ellipsoid of its own noise."""
    turn = np.linspace(0, 4 * np.pi, 3000)
    y = np.stack([90 + 30 * np.cos(turn), 180 + 28 * np.sin(turn), -430 + 3 * np.sin(3 * turn)], axis=1)
    y += np.cumsum(rng.normal(0, 0.05, y.shape), axis=0)
    path = saved(tmp_path / "table.csv", np.c_[np.arange(3000) / 50, y], header="time,mx,my,mz")
    assert "mx, my, mz are no readings of a compass that is turned in a steady field: 3000 readings" in refused(
        capsys, path
    )


@pytest.mark.parametrize("name", ["x,y,z", "est_linear_accel_x,est_linear_accel_y,est_linear_accel_z"])
def test_a_scale_that_makes_noise_one_g_is_not_assumed(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, name: str
) -> None:
    """Linear acceleration at rest is noise; some number a g makes any magnitude right."""
    y = rng.normal(0, 0.004, (4000, 3)) + np.repeat(rng.normal(0, 0.006, (4, 3)), 1000, axis=0)
    y[990:1010] += rng.normal(0, 1.5, (20, 3))
    path = saved(tmp_path / "Accelerometer.csv", np.c_[np.arange(4000) / 100, y], header=f"time,{name}")
    assert "gravity is not in them" in refused(capsys, path)


def test_two_orientations_span_no_sphere(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Six rests in two poses: their few hundredths apart are no sphere whose radius is the scale."""
    pose = np.array([[0.2, 0.3, 9.78], [0.1, 9.79, 0.3]])[[0, 1, 0, 1, 0, 1]] + rng.normal(0, 0.04, (6, 3))
    y = np.repeat(pose, 300, axis=0) + rng.normal(0, 0.1, (1800, 3))
    y[np.arange(300, 1800, 300)[:, None] + np.arange(-20, 20)] += rng.normal(0, 3, (5, 40, 3))
    one = understood(capsys, saved(tmp_path / "a.csv", np.c_[np.arange(1800) / 50, y], header="time,ax,ay,az"))
    check(one, raw_unit="m/s²")
    assert one["magnitude"]["median"] == pytest.approx(1, abs=0.02)


def test_magnitudes_of_a_compass_are_about_its_middle(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = 48 * sphere(rng, 600) + [230, 40, -30] + rng.normal(0, 0.2, (600, 3))
    one = understood(capsys, saved(tmp_path / "mag.csv", y))
    assert one["centre"] == pytest.approx([230, 40, -30], abs=1)
    assert [one["magnitude"][k] for k in ("least", "greatest")] == pytest.approx([48, 48], abs=2)


def test_of_nine_columns_the_compass_is_where_no_power_of_two_is_a_g(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    d = sphere(rng, 900)
    gyro, gravity = rng.normal(0, 4000, (900, 3)), 16_400 * d + rng.normal(0, 900, (900, 3))
    field = 6200 * np.roll(d, 1, axis=1) * [1.2, 1, 0.95] + [1300, 500, 1200] + rng.normal(0, 60, (900, 3))
    rows = np.round(np.c_[gyro, gravity, field])
    one = understood(capsys, saved(tmp_path / "magnetometer.csv", rows, "%d"))
    assert one["axes"] == ["column 6", "column 7", "column 8"]


@pytest.mark.parametrize("times", [4.0, 3.37])
def test_a_logger_faster_than_its_sensor_writes_readings_again(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, times: float
) -> None:
    """100 rows a second of a sensor that has 25 or 30: each reading counts once, or the noise looks half as large."""
    y = tumble(rng, 100.0, 8.0)
    held = np.round(y[(np.floor(np.arange(len(y)) / times) * times).astype(int)], 5)
    one = understood(capsys, saved(tmp_path / "held.csv", np.c_[np.arange(len(y)) / 100, held], header="t,ax,ay,az"))
    check(one, visits=8, poses=8, rate_hz=100 / times)
    assert remarks(one) == ["readings-held"]
    assert one["noise"] == pytest.approx([0.002] * 3, rel=0.15)


def test_a_coarse_converter_repeats_itself_without_being_held(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = np.round(tumble(rng) / 0.004) * 0.004
    one = understood(capsys, saved(tmp_path / "coarse.csv", np.c_[np.arange(len(y)) / 100, y], header="t,ax,ay,az"))
    check(one, visits=8, poses=8, rate_hz=100.0)
    assert remarks(one) == []


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("unit", "own"), [("g", "m/s²"), ("g", "mg"), ("m/s²", "g")])
def test_an_axis_in_another_unit_is_named_with_the_option_that_mends_it(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, axis: int, unit: str, own: str
) -> None:
    factor = {"g": 1.0, "m/s²": G, "mg": 1000.0}
    y = tumble(rng)
    factors = np.array([factor[own] if i == axis else factor[unit] for i in range(3)])
    path = saved(tmp_path / "log.csv", np.c_[np.arange(len(y)) / 100, y * factors], header="t,ax,ay,az")
    units = ",".join(own if i == axis else unit for i in range(3))
    said = refused(capsys, path)
    assert f"column a{'xyz'[axis]}: it reaches " in said
    assert f"import it with --unit {units}." in said
    one = understood(capsys, path, "--unit", units)
    check(one, visits=8, poses=8, raw_unit="g", scale=1.0)
    assert remarks(one) == ["axes-of-several-units"]
    assert one["magnitude"]["median"] == pytest.approx(1.0, abs=0.02)


def test_a_header_may_state_a_unit_for_each_axis(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = tumble(rng) * [1.0, G, 1000.0]
    rows = np.c_[np.arange(len(y)) / 100, y]
    one = understood(capsys, saved(tmp_path / "log.csv", rows, header="t [s],ax [g],ay [m/s^2],az [mg]"))
    check(one, visits=8, poses=8, raw_unit="g", scale=1.0)
    said = refused(capsys, saved(tmp_path / "odd.csv", rows, header="t [s],ax [g],ay [V],az [mg]"))
    assert "in different units (V, g, mg), not all of them known: state three with --unit" in said
    assert "does not state three units" in refused(capsys, str(tmp_path / "log.csv"), "--unit", "g,mg")


def test_readings_that_go_round_no_sphere_are_in_no_other_unit(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """A pendulum swings in one plane; a compass beside iron sees one axis weakly."""
    soft = iron(rng, 48.0, 25.0) * [1.0, 0.4, 1.0]
    check(understood(capsys, saved(tmp_path / "soft.csv", soft, header="mx,my,mz")), reading_unit="uT", visits=400)


@pytest.mark.parametrize("stamps", [False, True])
@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ("cube", r"243 readings stand off the nearest ellipsoid by \d+ % of its size, where 10 %"),
        ("plane", "243 readings (lie on no ellipsoid|go round only a part)"),
        ("still", r"243 readings range over 1?\d % of their size only"),
        ("few", "8 readings are fewer than 12"),
    ],
)
def test_a_compass_that_goes_round_no_ellipsoid_is_told_so(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, shape: str, said: str, *, stamps: bool
) -> None:
    """It is neither too short nor driven: no rest is asked of a compass."""
    angle = np.linspace(0, 40, 243)
    field = {
        "cube": rng.uniform(-60, 60, (243, 3)),
        "plane": np.c_[40 * np.cos(angle), 30 * np.sin(angle), 20 + 0.1 * rng.standard_normal(243)],
        "still": np.array([30.0, -20.0, 25.0]) + rng.standard_normal((243, 3)),
        "few": sphere(rng, 8) * 48,
    }[shape]
    rows = np.c_[np.arange(len(field)) / 20, field] if stamps else field
    err = refused(capsys, saved(tmp_path / "mag.csv", rows, header="t,mx,my,mz" if stamps else "mx,my,mz"))
    assert re.search(said, err)
    assert "too short" not in err
    assert "Turn it all round about all axes, far from iron" in err


@pytest.mark.parametrize("names", ["p,q,r", "roll_rate,pitch_rate,yaw_rate", "gyroRoll,gyroPitch,gyroYaw"])
def test_turn_rates_as_aviators_call_them(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, names: str
) -> None:
    turn = np.repeat(np.r_[np.eye(3), -np.eye(3)], 400, axis=0) * 90 + 0.05 * rng.standard_normal((2400, 3))
    rows = np.c_[np.arange(2400) / 100, turn, 44 + 0.1 * rng.standard_normal(2400)]
    one = understood(capsys, saved(tmp_path / "log.csv", rows, header=f"t,{names},Mag Yaw"))
    check(one, axes=names.split(","), reading_unit="deg/s", visits=6)


@pytest.mark.parametrize(
    "names", ["Latitude (°),Longitude (°),Altitude (m),Speed (m/s),Direction (°)", "ax,ay,AngleZ,pressure,humidity"]
)
def test_places_and_weather_are_no_axes(rng: np.random.Generator, tmp_path: Path, capsys: Capture, names: str) -> None:
    rows = np.c_[np.arange(400.0), np.cumsum(rng.standard_normal((400, 5)), axis=0)]
    assert "has no three columns that can be x, y and z" in refused(
        capsys, saved(tmp_path / "log.csv", rows, header=f"time,{names}")
    )


def test_a_title_with_empty_cells_behind_it_is_no_row(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """As a maker of sensors writes it: the start above the header, with as many tabs as there are columns."""
    y = tumble(rng)
    lines = ["StartTime: 2022-08-10 08:58:06.422" + "\t" * 4, "address\tTime(s)\tax(g)\tay(g)\taz(g)"]
    lines += [f"0x50\t{i / 100:.2f}\t{r[0]:.4f}\t{r[1]:.4f}\t{r[2]:.4f}" for i, r in enumerate(y)]
    path = tmp_path / "imu.txt"
    path.write_text("\n".join(lines) + "\n")
    check(understood(capsys, str(path)), axes=["ax", "ay", "az"], raw_unit="g", rate_hz=100.0, visits=8)


def test_columns_called_times_g_are_no_time(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = tumble(rng)
    path = saved(tmp_path / "a.csv", np.c_[y, np.arange(len(y)) / 100], header="x_times_g,y_times_g,z_times_g,Interval")
    check(understood(capsys, path, "--rate", "100"), axes=["x_times_g", "y_times_g", "z_times_g"], visits=8)


def test_columns_of_a_matrix_are_no_axes_by_their_numbers(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Six columns, turn rates first: by what they read, not by their places."""
    y = tumble(rng)
    turn = np.gradient(y, axis=0) * 100
    path = saved(tmp_path / "m.csv", np.c_[turn, 9.80665 * y], header=",".join(f"imu_{i}" for i in range(6)))
    check(understood(capsys, path, "--rate", "100"), axes=["imu_3", "imu_4", "imu_5"], raw_unit="m/s²", visits=8)


@pytest.mark.parametrize(("least", "said"), [(0, "holds no table of numbers"), (1, "names no x, y and z, and")])
def test_what_names_no_axes_is_refused_by_its_names(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, least: int, said: str
) -> None:
    """It was called a compass that was not turned; and a file of one line a table with no row missing."""
    rows = rng.standard_normal((1, 500)) if not least else np.cumsum(rng.standard_normal((2000, 4)), axis=0)
    path = saved(tmp_path / "a.csv", rows, header="left motor,right motor,command,torque" if least else "")
    assert said in refused(capsys, path)


@pytest.mark.parametrize("stops", [1, 4])
def test_one_pose_is_no_driving(rng: np.random.Generator, tmp_path: Path, capsys: Capture, stops: int) -> None:
    y = np.tile([0.1, -0.2, 0.97], (12_000, 1)) + 0.002 * rng.standard_normal((12_000, 3))
    for k in range(1, stops):
        y[3000 * k : 3000 * k + 1200] += 0.2 * rng.standard_normal((1200, 3))
    path = saved(tmp_path / "a.csv", np.c_[np.arange(12_000) / 100, y], header="t,x,y,z")
    said = refused(capsys, path)
    assert ("one stretch of" if stops == 1 else "4 stretches of one orientation: one pose") in said


def test_rows_of_other_sensors_in_one_log_are_left_out(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng)
    rows = "".join(f"{10 * i},{a:.4f},{b:.4f},{c:.4f},\n{10 * i + 2},,,,1\n{10 * i + 5},,,,2\n"
                   for i, (a, b, c) in enumerate(y.tolist()))  # fmt: skip
    path = tmp_path / "merged.csv"
    path.write_text("time_ms,ax,ay,az,light\n" + rows, encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, rate_hz=100.0, visits=8, poses=8)
    assert "rows-left-out" in remarks(one)


def test_sensors_that_lie_still_are_told_apart_by_a_column_of_their_ids(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Fifteen on a table, row by row: they were one unit in fifteen poses."""
    true = rng.standard_normal((15, 3))
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    place = np.tile(np.arange(15), 600)
    y = true[place] + 0.006 * rng.standard_normal((9000, 3))
    path = saved(tmp_path / "a.csv", np.c_[place, y], header="id,accel_x,accel_y,accel_z")
    assert "sensor 0: the unit is at rest in one stretch" in refused(capsys, path)


def test_one_pose_that_drifts_tells_no_unit_of_an_axis(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Cut into blocks, z was said to be in another unit than x and y, which drifted less."""
    around = rng.standard_normal((40, 3))
    drift = around / np.linalg.norm(around, axis=1, keepdims=True) * [1e-4, 1e-4, 2e-3]
    y = np.array([0.01, -0.02, 1.01]) + np.repeat(drift, 500, axis=0) + 2e-4 * rng.standard_normal((20_000, 3))
    path = saved(tmp_path / "a.csv", np.c_[np.arange(20_000) / 100, y], header="t,ax,ay,az")
    check(understood(capsys, path, "--blocks", "500"), visits=40, raw_unit="g")


def test_the_counts_of_a_compass_beside_turn_rates_without_names(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Counts off their centre by most of the field, whose magnitude happens to be near a power of two; the rates beside
    them have the size of a field in µT, and go round nothing."""
    t = np.linspace(0, 60, 3000)
    height, round_ = 0.98 * np.sin(2 * np.pi * t / 13), 2 * np.pi * t / 3.1
    across = np.sqrt(1 - height**2)
    turned = np.stack([across * np.cos(round_), across * np.sin(round_), height], axis=1)
    counts = np.round(1000 * turned @ np.diag([1.03, 0.96, 1.0]) + [690, 370, 360])
    fast = 45 * (1 + 0.4 * np.sin(2 * np.pi * t / 4.7))[:, None]
    rates = np.roll(turned, 700, axis=0)[:, [2, 0, 1]] * fast + rng.standard_normal((3000, 3))
    one = understood(capsys, saved(tmp_path / "log.txt", np.c_[counts, rates]))
    check(one, axes=["column 0", "column 1", "column 2"], reading_unit="uT", visits_by="readings")


def six_faces(rng: np.random.Generator, noise: Floats, offset: Floats) -> Floats:
    """Readings (n, 3) in g at 100 Hz: each face three times for 2.5 s, 3 s in the hand between; noise (6) by face."""
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    parts = []
    for i in np.tile(np.arange(6), 3).tolist():
        parts.append(faces[i] + noise[i] * rng.standard_normal((250, 3)))
        swing = np.linspace(0, 1, 300)[:, None]
        parts.append(faces[i] * (1 - swing) + faces[(i + 1) % 6] * swing + 0.3 * rng.standard_normal((300, 3)))
    return np.asarray(np.concatenate(parts[:-1]) + offset)


def test_six_faces_of_a_sensor_far_off_zero_are_a_tumble_though_it_rests_for_less_than_half(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Offsets that make magnitudes range over 12 %, as nobody has calibrated it."""
    y = six_faces(rng, np.full(6, 0.002), np.array([-0.02, 0.06, -0.03]))
    path = saved(tmp_path / "a.csv", np.c_[np.arange(len(y)) / 100, y], header="t,ax,ay,az")
    check(understood(capsys, path), visits=18, poses=6, visits_by="rest")
    assert station("import", path, "--out", str(tmp_path / "a.parquet")) == 0
    assert "--recipe six-faces" in capsys.readouterr().out
    assert station("import", path, "--recipe", "six-point", "--out", str(tmp_path / "a.parquet")) == 0
    assert "Next: station calibrate --samples" in capsys.readouterr().out


def test_poses_that_are_held_less_steadily_than_others_rest_too(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = six_faces(rng, np.array([0.005, 0.002, 0.002, 0.002, 0.005, 0.002]), np.zeros(3))
    path = saved(tmp_path / "a.csv", np.c_[np.arange(len(y)) / 100, y], header="t,ax,ay,az")
    check(understood(capsys, path), visits=18, poses=6)


def test_a_unit_that_is_turned_all_the_time_never_rests(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Slow parts of a rotation by hand are quiet beside its fast ones, but go ten degrees away and come back."""
    slow = np.arange(0, 10, 1 / 30)
    away = 0.18 * (1 - np.cos(2 * np.pi * slow / 10)) / 2
    parts = []
    for i in range(6):
        pose, aside = np.eye(3)[i % 3] * (-1) ** i, np.eye(3)[(i + 1) % 3]
        parts.append(pose * np.cos(away)[:, None] + aside * np.sin(away)[:, None])
        parts.append(rng.standard_normal((120, 3)))
    y = np.concatenate(parts) + 0.02 * rng.standard_normal((6 * (len(slow) + 120), 3))
    path = saved(tmp_path / "a.csv", np.c_[np.arange(len(y)) / 30, y], header="t,ax,ay,az")
    assert "never at rest" in refused(capsys, path)


def test_the_name_of_a_compass_chip_in_the_file_s_name_tells_a_field(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Its counts are near a power of two, as an accelerometer's are."""
    counts = np.round(540 * sphere(rng, 400) + [20, -90, -80])
    one = understood(capsys, saved(tmp_path / "HMC5883L_calibr.txt", counts, "%d"))
    check(one, reading_unit="uT", visits_by="readings")
