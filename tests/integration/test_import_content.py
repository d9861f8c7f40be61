"""What the numbers of a file tell where its header does not: which columns, which quantity, which rows hold nothing."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.domain.capture import rest_segments
from station.domain.core.types import Floats
from tests.integration.test_import import G, check, tumble, understood
from tests.integration.test_import_shapes import sphere

Capture = pytest.CaptureFixture[str]


def saved(path: Path, rows: Any, fmt: str = "%.5f", header: str = "") -> str:
    np.savetxt(path, rows, fmt, ",", header=header, comments="")
    return str(path)


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
