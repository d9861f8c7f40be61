"""Texts whose readings are spoken line by line: over several lines, beside numbers without a name, in uneven rows."""

from pathlib import Path

import numpy as np
import pytest

from tests.integration.test_import import G, check, tumble, understood
from tests.integration.test_import_content import refused

Capture = pytest.CaptureFixture[str]


def test_a_record_of_several_lines_is_one_row(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """A phone's log: the time, then a line for each sensor."""
    y = tumble(rng, rate_hz=50)
    path = tmp_path / "phone.txt"
    start = np.datetime64("2023-04-17T15:24:05.000")
    path.write_text("\n" + "".join(
        f"    {str(start + np.timedelta64(20 * i, 'ms')).replace('T', ' ')}\n"
        f"    Acceleration: {a:.5f}, {b:.5f}, {c:.5f}\n    Rotation Rate: 0.1, {a / 9:.5f}, -0.2\n"
        f"    Magnetic Field: {400 + a:.4f}, -235.1, {b - 390:.4f}\n"
        for i, (a, b, c) in enumerate(y)
    ))  # fmt: skip
    one = understood(capsys, str(path))
    check(one, visits=8, poses=8, rate_hz=50.0, reading_unit="g", gaps=0)
    assert one["axes"] == ["Acceleration_x", "Acceleration_y", "Acceleration_z"]


def test_axes_beside_numbers_without_a_name_are_found(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Each line begins with a device's number, and other lines stand between."""
    y = tumble(rng)
    path = tmp_path / "tag.txt"
    path.write_text("".join(
        ("7E-9342-B1 range to 1 device: 912 mm\n" if i % 4 == 0 else "")
        + f"7E-9342-B1 state: 3, Accel X = {a:.0f}, Y = {b:.0f}, Z = {c:.0f}, qw = {a:.0f}\n"
        for i, (a, b, c) in enumerate(8192 * y)
    ))  # fmt: skip
    check(understood(capsys, str(path)), visits=8, poses=8, scale=1 / 8192)


def test_a_unit_in_brackets_behind_the_name_is_the_readings(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng) * G
    path = tmp_path / "serial.txt"
    rows = "".join(f"Acceleration (m/s^2): X={a:.3f} \t  Y={b:.3f} \t  Z={c:.3f}i \t\n" for a, b, c in y)
    path.write_text("begin of 3 sensors\n" + rows)
    check(understood(capsys, str(path)), visits=8, poses=8, raw_unit="m/s²")


def test_a_slower_sensor_behind_some_rows_is_a_gap_in_its_columns(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Six counts each row, and three of a compass at every tenth; below zero they go on from 65,535 down."""
    y = np.round(16384 * tumble(rng)).astype(int)
    turn = rng.integers(-40, 40, y.shape)
    rows = [[*a.tolist(), *g.tolist(), *([300, -200, 40] if i % 10 == 9 else [])]
            for i, (a, g) in enumerate(zip(y, turn, strict=True))]  # fmt: skip
    path = tmp_path / "mixed.csv"
    path.write_text("".join("".join(f"{v % 65536:.1f}," for v in row) + "\n" for row in rows))
    check(understood(capsys, str(path)), visits=8, poses=8, axes=["column 0", "column 1", "column 2"])


def test_rows_that_are_cut_anywhere_stay_refused(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = tumble(rng)
    path = tmp_path / "cut.csv"
    path.write_text("".join(
        ",".join(f"{v:.4f}" for v in [i / 100, *row][: rng.integers(2, 5)]) + "\n" for i, row in enumerate(y)
    ))  # fmt: skip
    assert "cells where the others have" in refused(capsys, str(path))
    # A longer row whose numbers are not those of the others by column holds something else.
    path.write_text("".join(
        ",".join(f"{v:.4f}" for v in ([77.0, 12.0, *row, 5.0] if i % 9 == 0 else row)) + "\n" for i, row in enumerate(y)
    ))  # fmt: skip
    assert "cells where the others have" in refused(capsys, str(path))


@pytest.mark.parametrize("head", ["accelerometer_z\n", ""])
def test_one_column_of_numbers_has_no_three_axes(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, head: str
) -> None:
    path = tmp_path / "z.csv"
    path.write_text(head + "".join(f"{v:.4f}\n" for v in tumble(rng)[:, 2]))
    error = refused(capsys, str(path))
    assert f"no three columns that can be x, y and z (columns: {head.strip() or 'column 0'})" in error
