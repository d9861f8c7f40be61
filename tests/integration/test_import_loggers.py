"""Tables whose clock, columns or rests are not what their names say: loggers of vehicles, of steps, of counts."""

from pathlib import Path

import numpy as np
import pytest

from station.domain.core.types import Floats
from tests.integration.test_import import G, check, tumble, understood
from tests.integration.test_import_content import refused, remarks, saved

Capture = pytest.CaptureFixture[str]


def test_an_engine_is_no_accelerometer_whose_gears_are_poses(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """A gear of whole numbers looks like a label, and a pressure, a speed and a torque stood still in each."""
    gear = np.repeat([0, 1, 2, 3, 4, 5], 400)
    engine = np.c_[gear, 40 + gear + rng.random(2400), 800 * (1 + gear) + rng.random(2400), 9 * gear + rng.random(2400)]
    rows = np.c_[np.arange(2400) / 20, engine]
    for head in ("Time,Gear Position,Man Abs Press,RPM,Req Torque", "t,Gear Position,alpha,beta,gamma"):
        error = refused(capsys, saved(tmp_path / "drive.csv", rows, header=head))
        assert "can be x, y and z" in error or "do not behave as the axes of one sensor" in error


def spins(rng: np.random.Generator, rates: Floats) -> Floats:
    """Turn rates (n, 3) in deg/s of stretches of 3 s with handling of 1 s between."""
    parts = [np.tile(rate, (300, 1)) for rate in rates]
    handled = [40 * rng.standard_normal((100, 3)).cumsum(axis=0) / 10 for _ in rates]
    y = np.concatenate([part for pair in zip(parts, handled, strict=True) for part in pair])
    return np.asarray(y + 0.1 * rng.standard_normal(y.shape))


@pytest.mark.parametrize("between", [0, 9])
def test_a_gyroscope_that_only_rests_tells_no_gain_in_however_many_rests(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, between: int
) -> None:
    y = spins(rng, np.tile([0.3, -0.2, 0.1], (4, 1)))
    y = np.concatenate([y, *[spins(rng, np.zeros((1, 3)))[300:]] * between])
    path = saved(tmp_path / "gyro.csv", np.c_[np.arange(len(y)) / 100, y], header="t,gx,gy,gz")
    error = refused(capsys, path)
    assert "all at one rate" in error if between == 0 else "as in handling" in error
    # Its offset is all that a recipe of one point asks for.
    assert understood(capsys, path, "--recipe", "gyroscope-one-point")["visits"] >= 3


def test_a_gyroscope_that_is_shaken_all_the_time_is_never_steady(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """A walk of minutes is as quiet as it ever is from its begin to its end."""
    y = 0.4 * rng.standard_normal((2000, 3))
    path = saved(tmp_path / "walk.csv", np.c_[np.arange(len(y)) / 10, y], header="t,x (rad/s),y (rad/s),z (rad/s)")
    assert "as in handling" in refused(capsys, path)


def test_spins_of_a_gyroscope_are_visits(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    rates = np.concatenate([np.zeros((1, 3)), 90 * np.eye(3), -90 * np.eye(3)])
    y = spins(rng, rates)
    path = saved(tmp_path / "gyro.csv", np.c_[np.arange(len(y)) / 100, y], header="t,gx,gy,gz")
    check(understood(capsys, path), visits=7)


@pytest.mark.parametrize("name", ["t", "dt", "delta_time"])
def test_a_column_of_steps_is_added_up(rng: np.random.Generator, tmp_path: Path, capsys: Capture, name: str) -> None:
    """A loop that writes how long it took, not when."""
    y = tumble(rng, rate_hz=50) * G
    steps_ms = rng.choice([12, 20, 20, 28], len(y))
    one = understood(capsys, saved(tmp_path / "loop.csv", np.c_[steps_ms, y], header=f"{name},ax,ay,az"))
    check(one, visits=8, poses=8, time_unit="ms", rate_hz=50.0)
    assert "stamps-are-steps" in remarks(one)


def test_rows_in_no_order_are_sorted_and_not_added_up(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    y = tumble(rng)
    rows = np.c_[np.arange(len(y)) * 10, y][rng.permutation(len(y))]
    one = understood(capsys, saved(tmp_path / "mixed.csv", rows, header="t,ax,ay,az"))
    check(one, visits=8, poses=8, rate_hz=100.0)
    assert "rows-sorted" in remarks(one)


def test_a_clock_that_counts_one_by_one_through_less_than_seconds_counts_readings(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """Neither 3.2 s, which hold no tumble, nor an hour: it is a number in front of each reading."""
    y = tumble(rng, rate_hz=80)
    rows = np.c_[np.arange(len(y)), y]
    assert len(y) < 4000
    check(understood(capsys, saved(tmp_path / "a.csv", rows, header="Timestamp,ax,ay,az")), time_unit="none", poses=8)
    check(understood(capsys, saved(tmp_path / "b.csv", rows, header="Time_ms,ax,ay,az"), "--raw"), time_unit="ms")


def test_a_quaternion_without_a_name_is_no_compass(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """An armband's stream: stamp, quaternion, acceleration and turn rate, all of them counts."""
    y = tumble(rng)
    turn = np.cumsum(rng.standard_normal((len(y), 4)), axis=0) / 20
    turn /= np.linalg.norm(turn, axis=1)[:, None]
    counts = np.round(np.c_[16384 * turn, 2048 * y, 40 * rng.standard_normal(y.shape)])
    rows = np.c_[1665978419.5 + np.arange(len(y)) / 100, counts]
    one = understood(capsys, saved(tmp_path / "raw_imu.csv", rows, "%.3f"))
    check(one, axes=["column 5", "column 6", "column 7"], scale=1 / 2048, poses=8)


def test_turn_rates_without_stamps_that_are_few_have_no_clock(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    path = saved(tmp_path / "gyro.txt", rng.standard_normal((250, 3)))
    error = refused(capsys, path)
    assert "without stamps" in error
    assert "by its clock" not in error
