"""Recordings that never rest, or whose logger is slower or faster than the sensor: what is said of them."""

from pathlib import Path

import numpy as np
import pytest

from station.domain.core.types import Floats
from tests.fakes.command import station
from tests.integration.test_import import G, check, tumble, understood
from tests.integration.test_import_content import refused, remarks, saved
from tests.integration.test_import_shapes import sphere

Capture = pytest.CaptureFixture[str]


def shaken(rng: np.random.Generator, rows: int = 900) -> Floats:
    return np.asarray(3 * rng.standard_normal((rows, 3)))


def test_linear_acceleration_is_called_so_where_nothing_rests(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = np.c_[np.arange(900) / 100, shaken(rng)]
    header = ",".join(["Time (s)", *(f"Linear Acceleration {a} (m/s^2)" for a in "xyz")])
    said = refused(capsys, saved(tmp_path / "walk.csv", y, header=header))
    assert "are linear acceleration, from which gravity was taken out" in said
    named = ",".join(["Time (s)", *(f"Acceleration {a} (m/s^2)" for a in "xyz")])
    assert "never at rest" in refused(capsys, saved(tmp_path / "shaken.csv", y, header=named))


def test_an_axis_that_counts_is_no_shaking(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Packets read from one byte too early: the clock stands where an axis is meant, in ticks of two and three."""
    ticks = -0.9 + 6.1e-5 * np.cumsum(2 + np.arange(900) % 2)
    y = np.c_[np.arange(900) / 50, ticks, shaken(rng)[:, :2]]
    said = refused(capsys, saved(tmp_path / "a.csv", y, "%.6f", header="t,ax,ay,az"))
    assert "ax goes on by the same step from reading to reading" in said


def test_whole_seconds_without_a_name_are_time(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """As a small computer writes them, 48 readings to each."""
    y = tumble(rng, 48.0)
    stamps = 1_746_835_168 + np.floor(np.arange(len(y)) / 48)
    check(understood(capsys, saved(tmp_path / "a.csv", np.c_[stamps, y])), time_unit="s", rate_hz=48.0, visits=8)


def test_readings_held_for_any_number_of_rows_are_taken_once(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """A logger that writes its last reading again while the sensor is busy, for 3 to 60 rows."""
    y = np.round(tumble(rng, 20.0), 5)
    times = rng.choice([3, 5, 16, 16, 16, 16, 60], len(y))
    one = understood(capsys, saved(tmp_path / "a.csv", np.repeat(y, times, axis=0)))
    assert remarks(one) == ["readings-held"]
    assert one["readings"] == len(y)


@pytest.mark.parametrize("written", ["each third at once", "the second half at the end again", "all after all"])
def test_rows_written_again_are_taken_once(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, written: str
) -> None:
    y = np.round(tumble(rng), 5)
    rows = np.c_[np.arange(len(y)) / 100, y]
    again = {
        "each third at once": np.repeat(rows, 1 + (np.arange(len(y)) % 3 == 0), axis=0),
        "the second half at the end again": np.r_[rows, rows[len(rows) // 2 :]],
        "all after all": np.r_[rows, rows],
    }[written]
    one = understood(capsys, saved(tmp_path / "a.csv", again, "%.5f", header="t,ax,ay,az"))
    check(one, readings=len(y), rate_hz=100.0, restarts=0, visits=8)
    assert "rows-written-again" in remarks(one)


def test_rows_of_one_coarse_stamp_are_readings_of_their_own(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Of a converter as coarse as its noise, so that many neighbours are equal."""
    y = np.round(tumble(rng) / 0.004) * 0.004
    rows = np.c_[np.floor(np.arange(len(y)) / 5) / 20, y]
    one = understood(capsys, saved(tmp_path / "a.csv", rows, "%.5f", header="t,ax,ay,az"))
    check(one, readings=len(y))


def test_a_frozen_rest_alone_is_not_held(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    y = np.round(tumble(rng), 5)
    y[1000:2000] = y[1000]
    one = understood(capsys, saved(tmp_path / "a.csv", np.c_[np.arange(len(y)) / 100, y], header="t,ax,ay,az"))
    assert remarks(one) == []
    assert one["readings"] == len(y)


def test_too_few_orientations_are_no_next_step_to_calibrate(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng)[:3450] * G
    path = saved(tmp_path / "a.csv", np.c_[np.arange(len(y)) / 100, y], header="t,ax,ay,az")
    assert station("import", path, "--out", str(tmp_path / "a.parquet")) == 0
    assert "hold the unit in more orientations, well spread: the recipe hand-held needs 9" in capsys.readouterr().out


def test_a_compass_beside_iron_many_times_its_field_is_turned_all_the_same(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """As phones give it where nothing is taken off: it ranges over a fifth of its size, about a middle far away."""
    y = sphere(rng, 600) * 43 + [-199, -218, -364] + 0.3 * rng.standard_normal((600, 3))
    path = saved(tmp_path / "MagnetometerUncalibrated.csv", np.c_[np.arange(600) / 25, y], header="time,x,y,z")
    one = understood(capsys, path)
    check(one, visits_by="readings", reading_unit="uT", raw_unit="uT")
    assert one["centre"] == pytest.approx([-199.0, -218.0, -364.0], abs=0.3)
    assert one["poses"] > 50
    out = str(tmp_path / "a.parquet")
    assert station("import", path, "--out", out) == 0
    assert station("calibrate", "--samples", out, "--recipe", "magnetometer-hand-held") == 0
    said = capsys.readouterr().out
    assert "mgauss" not in said
    assert "state that of your place in `reference.magnitude`" in said


def test_a_compass_that_is_not_turned_is_refused_whatever_its_iron(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = [-199, -218, -364] + 3 * rng.standard_normal((600, 3))
    path = saved(tmp_path / "MagnetometerUncalibrated.csv", np.c_[np.arange(600) / 25, y], header="time,x,y,z")
    assert "range over" in refused(capsys, path)


def test_labels_of_a_flight_are_no_poses(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Stand-by, burn, coast, fall, landed: what a computer on board calls its own state."""
    parts = [np.tile([0.0, 0.0, 1.0], (400, 1)), *(3 * rng.standard_normal((300, 3)) for _ in range(3))]
    y = np.concatenate([*parts, np.tile([0.0, 1.0, 0.0], (400, 1))]) + 0.002 * rng.standard_normal((1700, 3))
    state = np.repeat(list("SMCFL"), [400, 300, 300, 300, 400])
    rows = [
        f"{s},{i / 100:.2f},{','.join(f'{v:.5f}' for v in r)}" for i, (s, r) in enumerate(zip(state, y, strict=True))
    ]
    path = tmp_path / "flight.csv"
    path.write_text("state,t,ax,ay,az\n" + "\n".join(rows) + "\n", encoding="utf-8")
    assert "looks like driving or handling" in refused(capsys, str(path))


def test_rows_that_stand_still_before_the_sensor_answers_are_no_end_of_its_range(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Zeros and a first guess of gravity, which is more than the sensor ever reads on that axis."""
    y = np.asarray(np.round(np.r_[np.tile([0.0, 0.0, 1.05], (400, 1)), tumble(rng)], 5), float)
    one = understood(capsys, saved(tmp_path / "a.csv", np.c_[np.arange(len(y)) / 100, y], header="t,ax,ay,az"))
    check(one, full_scale=None, rate_hz=100.0)


def test_a_gyroscope_is_told_of_spins_and_not_of_poses(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    stamps, noise = np.arange(900) / 100, 0.002 * rng.standard_normal((900, 3))
    header = "t,gyro_x,gyro_y,gyro_z"
    said = refused(capsys, saved(tmp_path / "still.csv", np.c_[stamps, noise], header=header))
    assert "tells a gyroscope's offset and none of its gains" in said
    swing = np.where(stamps < 2, 0.0, 90 * np.sin(2 * np.pi * 0.4 * stamps))[:, None]
    waved = np.c_[stamps, swing + noise]
    assert "not as in the spins of a gyroscope" in refused(capsys, saved(tmp_path / "waved.csv", waved, header=header))


def test_of_two_columns_called_time_the_one_that_counts_rows_is_none(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng, 200.0)
    stamps = np.cumsum(rng.uniform(0.004, 0.006, len(y)))
    rows = np.c_[y, np.arange(len(y)), stamps]
    path = saved(tmp_path / "a.csv", rows, header="ax,ay,az,Arduino Time,Computer time")
    check(understood(capsys, path), rate_hz=200.0, time_unit="s", visits=8)


def test_a_rest_in_which_the_logger_froze_is_no_end_of_the_range(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Of three turns one froze, which is the greatest of each axis by chance."""
    means = np.repeat([[0.0, 0.0, 0.0], [1.9, -1.2, 1.3], [2.6, 0.6, 2.1], [0.0, 0.0, 0.0]], 200, axis=0)
    y = np.round(means + rng.normal(0, 0.004, means.shape), 3)
    y[405:595] = [2.63, 0.63, 2.13]
    rates = saved(tmp_path / "gyro.csv", np.c_[np.arange(len(y)) / 100, y], header="t,gx,gy,gz")
    check(understood(capsys, rates, "--unit", "deg/s"), full_scale=None)
