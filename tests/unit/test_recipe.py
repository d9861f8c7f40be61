"""The recipe: what it means, and what it refuses."""

import numpy as np
import pytest
from pydantic import ValidationError

from station.domain.recipe import gravity, plan
from station.domain.recipe.recipe import Recipe

BASE = {
    "schema": "station.recipe/1",
    "name": "t",
    "version": 1,
    "sensor": "accelerometer",
    "unit": "g",
    "reference": {"source": "gravity", "magnitude": 1.0},
    "positions": [{"name": "z-up", "up": "+z"}, {"name": "x-up", "up": "+x"}],
}


def recipe(**changes: object) -> Recipe:
    return Recipe.model_validate({**BASE, **changes})


@pytest.mark.parametrize("up", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_the_axis_that_points_up_reads_plus_one_g(up: str) -> None:
    r = recipe(positions=[{"name": "p", "up": up}])
    expected = (1 if up[0] == "+" else -1) * np.eye(3)["xyz".index(up[1])]
    np.testing.assert_allclose(r.true_vector(r.positions[0]), expected, atol=1e-15)


@pytest.mark.parametrize("key", ["lsb", "full_scale", "noise_density", "gain_std", "turn_on_std", "rate_hz"])
@pytest.mark.parametrize("value", [1.1e15, 1e300, 1e-31, 1e-300])
def test_a_quantity_whose_square_is_no_number_is_refused(key: str, value: float) -> None:
    with pytest.raises(ValidationError, match=r"at most|less than or equal|at least"):
        recipe(device={key: value})


@pytest.mark.parametrize("key", ["noise_density", "lsb", "turn_on_std"])
def test_nothing_may_be_stated(key: str) -> None:
    assert getattr(recipe(device={key: 0}).device, key) == 0


def test_turns_are_applied_left_to_right_about_station_axes() -> None:
    turns = [{"axis": [1, 0, 0], "angle_deg": 90}, {"axis": [0, 0, 1], "angle_deg": 90}]
    r = recipe(positions=[{"name": "p", "rotate": turns}])
    # About x first: z goes to −y; then about z: −y goes to x.
    np.testing.assert_allclose(r.positions[0].matrix() @ [0, 0, 1], [1, 0, 0], atol=1e-15)


def test_the_seating_turns_the_unit_before_the_position_turns_the_nest() -> None:
    turned = {"axis": [0, 0, 1], "angle_deg": 180}
    r = recipe(seatings={"turned": turned}, positions=[{"name": "p", "up": "+x"}])
    np.testing.assert_allclose(r.true_vector(r.positions[0], "turned"), [-1, 0, 0], atol=1e-15)


def test_site_gravity_sets_the_magnitude() -> None:
    r = recipe(reference={"source": "gravity", "site": {"latitude_deg": 45, "altitude_m": 0}})
    assert r.reference.strength() == pytest.approx(9.80620 / 9.80665, abs=1e-6)


def test_a_rig_is_turned_on_its_floor_where_gravity_is_all_that_is_felt() -> None:
    turned = recipe(runs=[{}, {"base_turn_deg": 180}])
    assert turned.base(1) @ [1.0, 0.0, 0.0] == pytest.approx([-1.0, 0.0, 0.0])
    assert "base_turn_deg" not in recipe().model_dump_json(), "the hash of recipes so far stays"
    with pytest.raises(ValueError, match="base_turn_deg"):
        recipe(
            reference={"source": "field", "vector": [20, 0, 40]},
            sensor="magnetometer",
            unit="uT",
            runs=[{"base_turn_deg": 180}],
        )


def test_motors_off_survives_the_boolean_that_yaml_makes_of_it() -> None:
    run = recipe(runs=[{"motors": False, "filter": False}]).runs[0]
    assert (run.motors, run.filter) == ("off", "off")
    plain = recipe(runs=[{"filter": True, "temperature_swing_degC": 0}]).model_dump_json()
    assert "filter" not in plain and "swing" not in plain, "the hash of recipes so far stays"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"positions": []}, "positions are missing"),
        ({"reference": {"source": "gravity", "site": {"latitude_deg": 45}}}, "site needs altitude_m"),
        ({"positions": [{"name": "a", "up": "+x"}, {"name": "a", "up": "-x"}]}, "listed twice"),
        ({"positions": [{"name": "a", "quaternion": [1, 1, 0, 0]}]}, "not a rotation"),
        ({"positions": [{"name": "a"}]}, "has no orientation"),
        ({"positions": [{"name": "a", "up": "+x", "quaternion": [1, 0, 0, 0]}]}, "both give"),
        ({"positions": [{"name": "a", "rotate": [{"axis": [0, 0, 0], "angle_deg": 1}]}]}, "axis must have a length"),
        ({"unit": "uT"}, "write unit: g"),
        ({"reference": {"source": "rate"}}, "does not excite"),
        ({"reference": {"source": "gold"}}, "needs the sensor too"),
        ({"runs": [{"seating": "upside"}]}, "not defined"),
        ({"runs": []}, "at least 1"),
        ({"runs": [{"temperature_swing_degC": -900}]}, "greater than or equal to -300"),
        ({"runs": [{"temperature_offset_degC": 301}]}, "less than or equal to 300"),
        ({"dwell": {"time_s": 1, "until_std": 0.1}}, "either time_s or until_std"),
        ({"limits": {"rule": "false-accept"}}, "needs false_accept"),
        ({"limits": {"offset": -1}}, "greater than 0"),
        ({"limits": {"temperature_degC": [30, 20]}}, "is empty; the lower limit"),
        ({"colour": "red"}, "Extra inputs"),
    ],
)
def test_what_cannot_be_run_is_refused_with_its_reason(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        recipe(**changes)


def test_an_unknown_pose_needs_no_positions_and_has_no_true_vector() -> None:
    r = recipe(reference={"source": "gravity", "pose": "unknown"}, positions=[{"name": "any"}], method="norm")
    assert np.isnan(r.true_vector(r.positions[0])).all()


def test_orders_are_listed_reversed_and_shuffled_the_same_every_time() -> None:
    many = [{"name": f"p{i}", "rotate": [{"axis": [1, 0, 0], "angle_deg": 15 * i}]} for i in range(12)]
    r = recipe(positions=many, runs=[{"order": "listed"}, {"order": "reversed"}, {"order": "shuffled"}])
    listed, reverse, shuffled = ([s.position for s in plan.planned_visits(r, i)] for i in range(3))
    assert reverse == listed[::-1]
    assert sorted(shuffled) == sorted(listed)
    assert shuffled != listed
    assert shuffled == [s.position for s in plan.planned_visits(r, 2)]
    assert plan.planned_visits(r, 0)[0].previous is None
    assert plan.planned_visits(r, 1)[1].previous == "p11"


@pytest.mark.parametrize(
    ("latitude", "altitude", "published"),
    # NGA/WGS-84 normal gravity: equator and pole exactly; heights by the free-air series.
    [(0, 0, 9.7803253359), (90, 0, 9.8321849378), (45, 0, 9.80619777), (0, 1000, 9.7772396)],
)
def test_normal_gravity_matches_published_values(latitude: float, altitude: float, published: float) -> None:
    assert gravity.normal_gravity(latitude, altitude) == pytest.approx(published, rel=2e-7)
