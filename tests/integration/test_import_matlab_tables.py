"""Tables and timetables of MATLAB, as its app for phones and its scripts save them."""

from pathlib import Path

import numpy as np
import pytest

from tests.fakes.command import station
from tests.fakes.matlab_tables import table, timetables
from tests.integration.test_import import G, check, tumble, understood


def test_a_timetable_for_each_sensor(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a phone writes them: one clock for each, a reading more in one, angles that are no readings."""
    y = tumble(rng) * G
    time_s = 1.67e9 + np.arange(len(y)) / 100
    acceleration = dict(zip("XYZ", y.T, strict=True))
    angles = dict(zip("XYZ", 30 * y[1:].T, strict=True))
    rates = dict(zip("XYZ", 0.01 * rng.standard_normal((3, len(y) - 1)), strict=True))
    content = timetables(
        {
            "Orientation": (time_s[1:], angles),
            "Acceleration": (time_s, acceleration),
            "AngularVelocity": (time_s[1:], rates),
        }
    )
    (tmp_path / "phone.mat").write_bytes(content)
    one = understood(capsys, str(tmp_path / "phone.mat"))
    check(one, axes=[f"Acceleration.{a}" for a in "XYZ"], time_unit="s", rate_hz=100.0, raw_unit="m/s²", visits=8)


def test_a_table_of_one_matrix(rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    y = tumble(rng)
    content = table("log", {"acc": y, "temperature": np.full(len(y), 21.5), "time": np.arange(len(y)) / 200})
    (tmp_path / "a.mat").write_bytes(content)
    check(understood(capsys, str(tmp_path / "a.mat")), rate_hz=200.0, raw_unit="g", visits=8)


def test_what_is_kept_in_another_way_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A version of MATLAB that nobody has seen, whose names lie elsewhere."""
    x = np.arange(50.0)
    content = timetables({"Acceleration": (x, dict.fromkeys("XYZ", x))})
    (tmp_path / "a.mat").write_bytes(content.replace(b"timetable\0nrows\0", b"nrows\0timetable\0"))
    assert station("import", str(tmp_path / "a.mat")) == 2
    shown = capsys.readouterr()
    assert "objects of MATLAB" in shown.err
    assert shown.err.count("\n") == 1
