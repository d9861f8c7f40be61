"""Known answers: the design tips' own formulas, worked by hand."""

from typing import Any

import numpy as np
import pytest

from tests.fakes import tumble
from tests.fakes.tumble import TODAY, coefficients


def result(recipe: Any, mean: Any) -> Any:
    table = tumble.table(recipe, np.array([mean], float), 0.0, 3, np.random.default_rng(0))
    return tumble.calibrate_unit(recipe, table, TODAY)


def test_one_point_takes_the_stimulus_off_the_reading() -> None:
    """DT0105: Xofs = x, Yofs = y, Zofs = z − m."""
    found = result(tumble.recipe("one-point"), [[0.012, -0.007, 1.021]])
    assert found.calibration.offset == pytest.approx([0.012, -0.007, 0.021])
    assert found.calibration.matrix.tolist() == np.eye(3).tolist()


def test_three_point_by_the_table() -> None:
    """DT0105: Xofs = (x2 + x3)/2, Xgain = (x1 − Xofs)/m, and so on; rows are +X, +Y, +Z up."""
    found = result(tumble.recipe("three-point"), [[1.05, -0.02, 0.00], [0.03, 0.96, 0.02], [0.05, 0.02, 1.11]])
    assert found.calibration.offset == pytest.approx([0.04, 0.00, 0.01])
    assert np.diagonal(found.calibration.matrix) == pytest.approx([1.01, 0.96, 1.10])
    assert found.calibration.matrix[~np.eye(3, dtype=bool)].tolist() == [0.0] * 6


def test_three_point_shows_its_three_spare_equations() -> None:
    """x2 − x3 = −0.02, y1 − y3 = −0.04, z1 − z2 = −0.02: the largest is what the gate sees."""
    mean = [[1.05, -0.02, 0.00], [0.03, 0.96, 0.02], [0.05, 0.02, 1.11]]
    recipe = tumble.recipe("three-point", limits={"consistency": 0.03})
    found = result(recipe, mean)
    (reason,) = found.verdict.reasons
    assert reason.check == "consistency"
    assert reason.value == pytest.approx(0.04)
    assert found.calibration.residual[1, 0] - found.calibration.residual[2, 0] == pytest.approx(-0.02)
    assert not result(tumble.recipe("three-point", limits={"consistency": 0.05}), mean).verdict.reasons


def test_three_point_of_a_gyroscope_has_the_speed_of_the_table_for_m() -> None:
    found = result(tumble.recipe("three-point", "gyroscope"), [[103, 1, 2], [3, 99, 2], [1, 3, 102]])
    assert found.calibration.offset == pytest.approx([2, 2, 2])
    assert np.diagonal(found.calibration.matrix) == pytest.approx([1.01, 0.97, 1.00])


def test_six_point_by_the_closed_form(rng: np.random.Generator) -> None:
    """DT0053: Xofs = mean of all six, XtoY = (y(+X) − y(−X))/2."""
    recipe = tumble.recipe("six-point")
    y = dict(zip(tumble.FACES, tumble.truths(recipe) + 0.05 * rng.standard_normal((6, 3)), strict=True))
    found = result(recipe, list(y.values())).calibration
    assert found.offset == pytest.approx(np.mean(list(y.values()), axis=0), abs=1e-12)
    for j, a in enumerate("xyz"):
        assert found.matrix[:, j] == pytest.approx((y[f"{a}-up"] - y[f"{a}-down"]) / 2, abs=1e-12)


@pytest.mark.parametrize("method", ["six-point", "n-point", "norm"])
def test_without_noise_the_answer_is_exact(method: str, rng: np.random.Generator) -> None:
    recipe = tumble.recipe(method)
    theta = tumble.units(rng, 1)
    found = result(recipe, tumble.readings(theta, tumble.truths(recipe))[0])
    assert coefficients(found) == pytest.approx(theta[0], abs=1e-9)


def test_hand_held_stops_give_the_upper_triangular_matrix(rng: np.random.Generator) -> None:
    recipe = tumble.recipe("norm", reference={"source": "gravity", "magnitude": 1.0, "pose": "unknown"})
    theta = tumble.units(rng, 1)
    posed = tumble.recipe("norm")
    mean = tumble.readings(theta, tumble.truths(posed))
    table = tumble.table(posed, mean, 0.0, 3, rng)
    found = tumble.calibrate_unit(recipe, table, TODAY)
    upper = np.linalg.cholesky((theta[0, 3:].reshape(3, 3) @ theta[0, 3:].reshape(3, 3).T)[::-1, ::-1])[::-1, ::-1]
    assert found.calibration is not None
    assert found.calibration.matrix == pytest.approx(upper, abs=1e-9)
    assert found.calibration.offset == pytest.approx(theta[0, :3], abs=1e-9)
    assert (np.diagonal(found.calibration.covariance) > 0).tolist() == [True] * 6 + [
        False,
        True,
        True,
        False,
        False,
        True,
    ]


def test_gold_readings_take_the_place_of_the_nominal_truth(rng: np.random.Generator) -> None:
    """A fixture that stands askew does not matter when a gold sensor sees the same."""
    own = {"offset": [0.01, -0.02, 0.0], "matrix": [[1.0, 0.001, 0.0], [0.0, 0.99, 0.0], [0.0, 0.0, 1.01]]}
    gold = {"serial": "G1", "due": "2027-01-01", **own}
    recipe = tumble.recipe("n-point", reference={"source": "gold", "gold": gold, "magnitude": 1.0})
    true = tumble.truths(recipe) + 0.02 * rng.standard_normal((18, 3))
    theta = tumble.units(rng, 1)
    table = tumble.table(recipe, tumble.readings(theta, true), 0.0, 3, rng)
    observed = true @ np.array(own["matrix"]).T + own["offset"]
    table = type(table)(
        **{n: getattr(table, n) for n in table.__slots__ if n != "gold"}, gold=np.repeat(observed, 3, axis=0)
    )
    found = tumble.calibrate_unit(recipe, table, TODAY)
    assert coefficients(found) == pytest.approx(theta[0], abs=1e-9)


def test_the_earths_turning_is_not_taken_for_an_offset(rng: np.random.Generator) -> None:
    """At the pole, at rest, z up: 0.00417807 deg/s about z belong to the Earth."""
    reference = {"source": "rate", "site": {"latitude_deg": 90.0, "heading_deg": 0.0}}
    recipe = tumble.recipe(
        "one-point", "gyroscope", reference=reference, positions=[{"name": "rest", "rate": [0, 0, 0]}]
    )
    found = result(recipe, [[0.5, -0.5, 0.25 + 0.00417807]])
    assert found.calibration.offset == pytest.approx([0.5, -0.5, 0.25], abs=1e-8)


def test_a_gyroscopes_pull_of_gravity_is_fitted_beside_its_offset(rng: np.random.Generator) -> None:
    ups = ["+x", "+x", "+y", "+y", "+z", "+z", "-x", "-y", "-z"]
    rates = [[100, 0, 0], [-100, 0, 0], [0, 100, 0], [0, -100, 0], [0, 0, 100], [0, 0, -100], *[[0, 0, 0]] * 3]
    positions = [{"name": f"p{i}", "up": u, "rate": r} for i, (u, r) in enumerate(zip(ups, rates, strict=True))]
    recipe = tumble.recipe("n-point", "gyroscope", positions=positions)
    theta = tumble.units(rng, 1, 100.0)
    pull = 0.1 * rng.standard_normal((3, 3))
    up = np.array([(1 if u[0] == "+" else -1) * np.eye(3)["xyz".index(u[1])] for u in ups])
    found = result(recipe, tumble.readings(theta, tumble.truths(recipe))[0] + up @ pull.T)
    assert coefficients(found) == pytest.approx(theta[0], abs=1e-9)
