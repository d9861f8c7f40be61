"""The simulated positioner: its speed, its errors, its faults, and where it is on the way."""

import numpy as np
import pytest

from station.adapters.clock import VirtualClock
from station.adapters.positioner.simulated import SimulatedPositioner
from station.domain.core import rotation
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.position import UP
from station.errors import PositionerFault


def stop(up: str) -> PlannedVisit:
    nest = rotation.shortest(UP[up], UP["+z"])
    return PlannedVisit(0, 0, up, "home", nest, np.eye(3), nest.T @ UP["+z"], None)


def made(**options: object) -> tuple[SimulatedPositioner, VirtualClock]:
    clock = VirtualClock()
    return SimulatedPositioner(SimulatedPositioner.Settings.model_validate(options), clock), clock


def test_a_quarter_turn_takes_the_time_of_the_trapezium() -> None:
    positioner, clock = made(speed_deg_s=90, acceleration_deg_s2=180)
    positioner.move(stop("+x"), 60)
    assert clock.monotonic_s() == pytest.approx(90 / 90 + 90 / 180)


def test_a_small_turn_never_reaches_full_speed() -> None:
    positioner, clock = made(speed_deg_s=1000, acceleration_deg_s2=180)
    positioner.move(stop("+x"), 60)
    assert clock.monotonic_s() == pytest.approx(2 * np.sqrt(90 / 180))


def test_it_turns_the_shortest_way_and_stays_a_rotation_on_it() -> None:
    positioner, clock = made()
    positioner.move(stop("+y"), 60)
    for time_s in np.linspace(0, clock.monotonic_s(), 20):
        R = positioner.at(float(time_s))
        assert np.allclose(R @ R.T, np.eye(3))
        assert np.allclose(R[0], [1, 0, 0]), "from +z up to +y up it turns about x only"


def test_each_arrival_is_off_by_the_declared_error() -> None:
    positioner, _ = made(error_deg=0.1, seed=7)
    off = []
    for _ in range(400):
        positioner.move(stop("+x"), 60)
        off.append(rotation.to_vector(positioner.where().attitude @ stop("+x").nest.T))
    # 1200 draws: the standard deviation is known to 1/sqrt(2400) = 2 %; 5 standard deviations.
    assert np.std(off) == pytest.approx(np.deg2rad(0.1), rel=0.102)


def test_equal_seeds_give_equal_places() -> None:
    first, second = made(error_deg=0.1, seed=3)[0], made(error_deg=0.1, seed=3)[0]
    for up in ("+x", "-z", "+y"):
        first.move(stop(up), 60)
        second.move(stop(up), 60)
        assert np.array_equal(first.where().attitude, second.where().attitude)


@pytest.mark.parametrize("fault", ["stuck", "slow"])
def test_a_move_that_does_not_end_is_a_fault_within_its_time_out(fault: str) -> None:
    positioner, clock = made(fault=fault, after=1)
    positioner.move(stop("+x"), 10)
    before = clock.monotonic_s()
    with pytest.raises(PositionerFault, match=r"position '-x' within 10 s"):
        positioner.move(stop("-x"), 10)
    assert clock.monotonic_s() - before == pytest.approx(10)


def test_at_the_wrong_place_its_encoders_say_so() -> None:
    positioner, _ = made(fault="wrong-place")
    positioner.move(stop("+x"), 10)
    positioner.move(stop("+x"), 10)
    assert np.linalg.norm(rotation.to_vector(positioner.where().attitude @ stop("+x").nest.T)) > 1.0


@pytest.mark.parametrize("pair", [("+x", "-x"), ("+y", "-y"), ("+z", "-z"), ("-y", "+y")])
def test_a_half_turn_arrives_upside_down(pair: tuple[str, str]) -> None:
    positioner, clock = made()
    for up in pair:
        positioner.move(stop(up), 60)
        assert np.allclose(positioner.where().attitude, stop(up).nest, atol=1e-9)
    assert clock.monotonic_s() > 180 / 90
