"""Angles against the fixture's: what a position reads, and how well zero, scale and cross-coupling are found.

Truths here are made by turning vectors with scipy, readings by plain arithmetic: no line is shared with the kind.
"""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from station.domain.core.types import Floats
from station.domain.evaluation import pipeline
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

UNITS = 400
NEST_DEG, BASE_DEG = 0.2, 0.1
#: Turns about the nest's y and x axes that a fixture with two axes makes, deg.
TURNS = [(a, 0) for a in (-60, -30, 0, 30, 60)] + [(0, a) for a in (-60, -30, 30, 60)] + [(20, 20), (-20, 20)]


def recipe(**more: Any) -> Recipe:
    positions = [
        {
            "name": f"y{about_y}x{about_x}",
            "rotate": [{"axis": [0, 1, 0], "angle_deg": about_y}, {"axis": [1, 0, 0], "angle_deg": about_x}],
        }
        for about_y, about_x in TURNS
    ]
    base: dict[str, Any] = {
        "schema": "station.recipe/1",
        "name": "angles",
        "version": 1,
        "sensor": "inclinometer",
        "unit": "deg",
        "reference": {"source": "gravity", "nest_std_deg": NEST_DEG, "base_std_deg": BASE_DEG, "pose_std_deg": 0.0},
        "positions": positions,
        "method": "n-point",
    }
    return Recipe.model_validate(base | more)


def up_in_device(nest: Rotation | None = None, base: Rotation | None = None) -> Floats:
    """Up (v, 3) in the device's frame at every position of a nest and a base that lie askew."""
    turned = [Rotation.from_euler("yx", turn, degrees=True) for turn in TURNS]
    askew, leaning = nest or Rotation.identity(), base or Rotation.identity()
    return np.array([(leaning * turn * askew).inv().apply([0.0, 0.0, 1.0]) for turn in turned])


def horizon(up: Floats) -> Floats:
    """Angles (v, 3) between the axes x and y and the horizontal plane."""
    level = np.hypot(up[:, 1], up[:, 2]), np.hypot(up[:, 0], up[:, 2])
    x, y = np.degrees(np.arctan2(up[:, 0], level[0])), np.degrees(np.arctan2(up[:, 1], level[1]))
    return np.column_stack([x, y, np.zeros(len(up))])


def test_the_angles_of_the_positions_are_the_fixtures() -> None:
    np.testing.assert_allclose(tumble.truths(recipe()), horizon(up_in_device()), atol=1e-9)


@pytest.mark.parametrize(
    ("axis", "angle_deg", "convention", "reads"),
    [
        ([0, 1, 0], -70, "projected", (70, 0)),
        ([0, 1, 0], -170, "horizon", (10, 0)),
        ([1, 0, 0], 30, "projected", (0, 30)),
        ([1, 0, 0], 30, "horizon", (0, 30)),
    ],
)
def test_a_convention_says_what_an_angle_is(
    axis: list[int], angle_deg: float, convention: str, reads: tuple[float, float]
) -> None:
    found = recipe(
        positions=[{"name": "p", "rotate": [{"axis": axis, "angle_deg": angle_deg}]}], device={"convention": convention}
    )
    np.testing.assert_allclose(found.true_vector(found.positions[0]), [*reads, 0], atol=1e-9)


@pytest.mark.parametrize(("convention", "reads"), [("about-z", -100.0), ("about-z-360", 260.0)])
def test_one_axis_goes_round_the_whole_circle(convention: str, reads: float) -> None:
    upright = [{"axis": [1, 0, 0], "angle_deg": 90}, {"axis": [0, 1, 0], "angle_deg": 100}]
    found = recipe(positions=[{"name": "p", "rotate": upright}], device={"axes": 1, "convention": convention})
    assert found.axes == 1
    np.testing.assert_allclose(np.abs(found.true_vector(found.positions[0])), [abs(reads), 0, 0], atol=1e-9)


@pytest.fixture(scope="module")
def results() -> tuple[Floats, list[pipeline.CalibrationResult]]:
    """Units of ordinary errors in nests and on bases that lie askew as stated, each drawn anew."""
    rng = np.random.default_rng(20261122)
    theta = np.zeros((UNITS, 12))
    theta[:, 3:] = np.eye(3).ravel()
    theta[:, [0, 1]] = 0.3 * rng.standard_normal((UNITS, 2))
    theta[:, [3, 4, 6, 7]] += 0.01 * rng.standard_normal((UNITS, 4))
    true = np.array([horizon(up_in_device(*_askew(rng))) for _ in range(UNITS)])
    table = tumble.table(recipe(), tumble.readings(theta, true), _noise(rng), 25, rng)
    return theta, list(pipeline.calibrate(recipe(), table, tumble.TODAY))


def _noise(rng: np.random.Generator) -> Floats:
    noise = 0.02 * rng.standard_normal((UNITS, len(TURNS), 25, 3))
    noise[..., 2] = 0.0
    return noise


def _askew(rng: np.random.Generator) -> tuple[Rotation, Rotation]:
    nest = Rotation.from_rotvec(np.deg2rad(NEST_DEG) * rng.standard_normal(3))
    return nest, Rotation.from_rotvec(np.deg2rad(BASE_DEG) * rng.standard_normal(3))


@pytest.mark.parametrize("index", [0, 1, 3, 4, 6, 7])
def test_the_stated_interval_holds_the_true_coefficient(
    results: tuple[Floats, list[pipeline.CalibrationResult]], index: int
) -> None:
    """Coverage of 95 %: between .92 and .98 of 400 units (3 binomial standard deviations are .033)."""
    theta, found = results
    off = np.array([tumble.coefficients(r)[index] for r in found]) - theta[:, index]
    wide = np.array([r.budget.expanded()[index] for r in found if r.budget is not None])
    assert len(wide) == UNITS
    assert 0.92 <= np.mean(np.abs(off) <= wide) <= 0.985


def test_an_axis_that_is_not_there_has_no_coefficients(
    results: tuple[Floats, list[pipeline.CalibrationResult]],
) -> None:
    found = results[1][0]
    assert found.calibration is not None and found.budget is not None
    np.testing.assert_array_equal(found.calibration.matrix[2], [0, 0, 1])
    np.testing.assert_array_equal(found.calibration.matrix[:, 2], [0, 0, 1])
    assert not found.budget.std()[[2, 5, 8, 9, 10, 11]].any()


def test_tilts_are_the_differences_of_the_angles() -> None:
    """One position 0.5 deg away on x, among eleven: its tilt is that difference, less what the fit takes over."""
    rng = np.random.default_rng(5)
    exact = recipe(reference={"source": "gravity", "nest_std_deg": 0, "base_std_deg": 0, "pose_std_deg": 0.3})
    true = tumble.truths(exact)
    off = np.zeros_like(true)
    off[4, 0] = 0.5
    table = tumble.table(exact, (true + off)[None], 0.001, 25, rng)
    (found,) = pipeline.calibrate(exact, table, tumble.TODAY)
    assert found.calibration is not None
    assert int(np.argmax(found.calibration.tilt_deg)) == 4
    assert 0.2 < found.calibration.tilt_deg[4] <= 0.5
