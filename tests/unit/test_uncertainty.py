"""The budget: every cause by a formula worked by hand, and pose errors by simulation."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.domain.core import rotation
from station.domain.core.types import Floats, SampleTable
from station.domain.evaluation import calibration_document, pipeline
from station.domain.methods import contributions
from station.domain.recipe.recipe import Recipe
from station.domain.recipe.reference_block import Reproducibility
from station.messages import render
from tests.fakes import tumble
from tests.fakes.tumble import TODAY, coefficients

RIG = dict(tumble.TRUTHS["accelerometer"]["reference"])
KNOWN = {"gain_std": 0, "cross_std": 0}


def budget(method: str, **more: Any) -> Any:
    recipe = tumble.recipe(method, device=KNOWN, **more)
    theta = np.array([[0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1.0]])
    table = tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), 1e-4, 50, np.random.default_rng(2))
    return tumble.calibrate_unit(recipe, table, TODAY).budget


def test_parts_add_up_in_squares() -> None:
    found = budget("six-point", reference=RIG | {"pose_std_deg": 0.1})
    squares = sum(found.std(cause) ** 2 for cause in found.parts)
    assert found.std() == pytest.approx(np.sqrt(squares))


def test_position_error_of_one_point_goes_across_into_the_offset() -> None:
    """0.1° of tilt moves 1.745 mg onto each level axis, only its square, 3 µg in the mean, onto the upright one; 95 %
    of that lies below ln 20 times the mean."""
    found = budget("one-point", reference=RIG | {"pose_std_deg": 0.1})
    across, along = np.deg2rad(0.1), np.deg2rad(0.1) ** 2 * np.log(20) / 1.96
    assert found.std("position")[:3] == pytest.approx([across, across, along], rel=1e-4)


def test_gravity_at_a_site_is_uncertain_by_local_anomalies() -> None:
    site = {"latitude_deg": 48.14, "altitude_m": 520, "anomaly_std_ppm": 30}
    found = budget("six-point", reference={"source": "gravity", "site": site, "nest_std_deg": 0, "base_std_deg": 0})
    gains = found.std("gravity")[[3, 7, 11]]
    # Readings were made for 1 g: the gains are 1/1.00008.
    assert gains == pytest.approx(np.full(3, 30e-6), rel=1e-3)


def test_rounding_in_the_device_enters_as_it_is_told(rng: np.random.Generator) -> None:
    recipe = tumble.recipe("three-point")
    table = tumble.table(recipe, tumble.truths(recipe)[None], 1e-4, 50, rng)
    rounding = np.full(12, 3e-5)
    found = tumble.calibrate_unit(recipe, table, TODAY, rounding).budget
    assert found is not None
    # What the method does not estimate is kept nominal, and nominal is not rounded.
    assert (found.std("rounding") > 0).sum() == 6
    assert found.std("rounding").max() == pytest.approx(3e-5)


def test_temperature_differences_enter_by_the_sheets_coefficient(rng: np.random.Generator) -> None:
    """One of two passes 10 °C warmer: the mean offset is right, and half of 10 °C · tempco is in no pass."""
    recipe = tumble.recipe(
        "three-point", device={"offset_tempco": 1e-4, "gain_tempco": 0}, reference=RIG | {"thermometer_std_degC": 0}
    )
    table = tumble.table(recipe, tumble.truths(recipe)[None], 1e-4, 50, rng)
    warm = np.where(table.visit == 0, 30.0, 20.0)
    found = tumble.calibrate_unit(recipe, replace(table, values={"temperature_degC": warm}), TODAY).budget
    assert found is not None
    # x is measured up while warm: its gain takes all of 1 mg, its offset (the mean of the other two) −⅓ of it.
    assert found.std("temperature")[[0, 3]] == pytest.approx([1e-3 / 3, 1e-3], rel=1e-6)


def test_tempcos_of_usual_data_sheets_count_where_the_temperature_was_measured(rng: np.random.Generator) -> None:
    recipe = tumble.recipe("six-point", reference=RIG)
    table = tumble.table(recipe, tumble.truths(recipe)[None], 1e-4, 50, rng)
    found = tumble.calibrate_unit(recipe, table, TODAY).budget
    assert found is not None and not found.std("temperature").any()
    measured = replace(table, values={"temperature_degC": np.full(len(table), 23.0)})
    found = tumble.calibrate_unit(recipe, measured, TODAY).budget
    assert found is not None
    # 0.5 mg/°C and 0.01 %/°C, by a thermometer of class B.
    assert found.std("temperature")[[0, 3]] == pytest.approx([5e-4 * 0.4 / 3**0.5, 1e-4 * 0.4 / 3**0.5], rel=1e-4)
    recipe = tumble.recipe("six-point", device={"offset_tempco": 0, "gain_tempco": 0}, reference=RIG)
    found = tumble.calibrate_unit(recipe, measured, TODAY).budget
    assert found is not None and not found.std("temperature").any(), "what is stated as nothing is nothing"


def test_offset_of_another_power_on_counts_where_a_product_keeps_the_coefficients(rng: np.random.Generator) -> None:
    def of_runs(sensor: str = "accelerometer", **more: Any) -> Floats:
        recipe = tumble.recipe("one-point", sensor, **more)
        table = tumble.table(recipe, tumble.truths(recipe)[None], 1e-4, 50, rng)
        found = tumble.calibrate_unit(recipe, table, TODAY).budget
        assert found is not None
        return np.asarray(found.std("runs"))

    assert not of_runs().any(), "nothing is kept: the result is that of this power-on"
    kept = of_runs(product="any")
    assert kept[:3] == pytest.approx(np.full(3, 5e-4)) and not kept[3:].any()
    assert of_runs("magnetometer", product="any")[:3] == pytest.approx(np.full(3, 0.05))
    assert not of_runs(product="any", device={"turn_on_std": 0}).any()
    assert of_runs(device={"turn_on_std": 2e-4})[:3] == pytest.approx(np.full(3, 2e-4))
    twice: dict[str, Any] = {"runs": [{}, {}]}
    assert of_runs(device={"turn_on_std": 2e-4}, **twice)[:3] == pytest.approx(np.full(3, 2e-4 / 2**0.5))
    assert of_runs(product="any", **twice)[:3] == pytest.approx(np.full(3, 5e-4)), "nobody says that power was off"


@pytest.mark.parametrize(
    ("method", "runs"),
    [
        ("n-point", ["home", "home"]),
        ("n-point", ["home", "home", "back"]),
        ("six-point", ["home", "back"]),
        ("norm", ["home", "home"]),
    ],
)
def test_stated_offsets_of_runs_are_no_scatter(rng: np.random.Generator, method: str, runs: list[str]) -> None:
    """Offsets of 1 mg from run to run beside noise of 0.05 mg move the offset and nothing else."""
    seats = {"back": {"axis": [0, 0, 1], "angle_deg": 180}}
    whole: dict[str, Any] = {"seatings": seats, "runs": [{"seating": s} for s in runs], "reference": RIG}

    def found(apart: float, **sheet: float) -> tuple[list[Any], Floats]:
        recipe, theta = tumble.recipe(method, device=sheet, **whole), tumble.units(rng, 60)
        each = apart * rng.standard_normal((60, len(runs), 3))
        mean = tumble.readings(theta, tumble.truths(recipe))
        mean = mean + np.repeat(each, mean.shape[1] // len(runs), axis=1)
        results = list(pipeline.calibrate(recipe, tumble.table(recipe, mean, 3e-4, 40, rng), TODAY))
        assert all(r.budget is not None for r in results)
        return [r.budget for r in results], np.abs(np.array([coefficients(r) for r in results]) - theta)

    stated, error = found(1e-3, turn_on_std=1e-3)
    unstated, _ = found(1e-3, turn_on_std=0)
    calm, _ = found(0.0, turn_on_std=0)
    within = error < np.array([b.expanded() for b in stated])
    # Of 180 offsets and 540 others; at 95 % fewer than these by chance of 1e-4.
    assert within[:, :3].mean() > 0.88 and within[:, 3:].mean() > 0.91
    gains = [np.mean([b.expanded()[3:] for b in of]) for of in (stated, unstated, calm)]
    assert gains[0] < 1.15 * gains[2] < 0.2 * gains[1]
    assert np.mean([b.scatter > 0 for b in stated]) < 0.05, "nothing that visits differ by is left"


def test_quantisation_without_dither_is_a_line_of_its_own(rng: np.random.Generator) -> None:
    recipe = tumble.recipe("six-point", device={"lsb": 0.0127})
    true = tumble.readings(tumble.units(rng, 1), tumble.truths(recipe))
    table = tumble.table(recipe, true, 0.001, 50, rng)
    table = replace(table, reading=np.round(table.reading / 0.0127) * 0.0127)
    found = tumble.calibrate_unit(recipe, table, TODAY)
    assert found.budget is not None and found.calibration is not None
    line = found.budget.std("quantisation")[:3] / (0.0127 / np.sqrt(12))
    # Six roundings in the mean of six readings, or one of the four across with two of the faces.
    assert (line >= 0.8 * (1 / 6) ** 0.5).all() and (line <= (4**2 + 2) ** 0.5 / 6).all()
    assert any("steps of 0.0127" in render(note) for note in found.calibration.notes)


@pytest.mark.parametrize("frame", [0.0, 6.25e-5])
def test_rounding_of_few_dwells_is_counted_once(rng: np.random.Generator, frame: float) -> None:
    """Steps of 12.7 mg, ten times the noise, as they are or in finer frames: no U of a gain is far from what two
    rounded readings make, and rounding is not counted as scatter again: chance shows some in four of ten units."""
    recipe = tumble.recipe("six-point", device={"lsb": 0.0127, "rounding": "nearest"}, reference=RIG)
    theta = tumble.units(rng, 60)
    table = tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), 0.00127, 60, rng)
    reading = np.round(table.reading / 0.0127) * 0.0127
    table = replace(table, reading=np.round(reading / frame) * frame if frame else reading)
    limited = recipe.model_copy(update={"limits": recipe.limits.model_copy(update={"residual": 0.05})})
    results = list(pipeline.calibrate(limited, table, TODAY))
    documents = [calibration_document.unit(r) for r in results]
    residuals = [d for one in documents for d in one["decisions"] if d["what"] == "residual"]
    assert len(residuals) == 60 and all(d["expanded"] > 0.0127 / 12 for d in residuals), "rounding is in their U"
    found = [r.budget for r in results if r.budget is not None]
    wide = np.array([budget.expanded()[[3, 7, 11]] for budget in found]) / (1.96 * 0.0127 / np.sqrt(24))
    assert (wide > 0.3).all() and 0.5 < np.median(wide) < 1.1
    assert np.mean([budget.std("scatter").any() for budget in found]) < 0.6


@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize("method", ["six-point", "n-point", "norm"])
def test_pose_errors_are_covered_whether_declared_or_not(rng: np.random.Generator, method: str, declared: bool) -> None:
    """Every pose of every unit is off by 0.1° about each axis: intervals hold, though noise alone is far smaller."""
    reference = RIG | {"pose_std_deg": 0.1 if declared else 0.0}
    recipe = tumble.recipe(method, reference=reference)
    theta = tumble.units(rng, 150)
    true = turned(tumble.truths(recipe), np.deg2rad(0.1), rng, len(theta))
    table = tumble.table(recipe, tumble.readings(theta, true), 3e-4, 40, rng)
    found = list(pipeline.calibrate(recipe, table, TODAY))
    error = np.array([coefficients(r) for r in found]) - theta
    wide = np.array([r.budget.expanded() for r in found if r.budget is not None])
    assert 0.92 < (np.abs(error) < wide).mean() < 0.985


@pytest.mark.parametrize("scatter", [0.0, 5e-4])
def test_scatter_far_below_stated_pose_errors_is_seen_along_the_stimulus(
    rng: np.random.Generator, scatter: float
) -> None:
    """Poses off by 0.3° as stated hide scatter of ten times the noise from χ², but not where a pose moves nothing."""
    recipe = tumble.recipe("n-point", reference=RIG | {"pose_std_deg": 0.3})
    theta = tumble.units(rng, 120)
    true = turned(tumble.truths(recipe), np.deg2rad(0.3), rng, len(theta))
    readings = tumble.readings(theta, true)
    readings += scatter * rng.standard_normal(readings.shape)
    found = list(pipeline.calibrate(recipe, tumble.table(recipe, readings, 3e-4, 40, rng), TODAY))
    error = np.array([coefficients(r) for r in found]) - theta
    wide = np.array([r.budget.expanded() for r in found if r.budget is not None])
    offsets_and_gains = [0, 1, 2, 3, 7, 11]
    # 720 of .95, those of a unit not independent: three standard deviations of a third as many.
    assert 0.91 < (np.abs(error) < wide)[:, offsets_and_gains].mean() < 0.99
    assert np.median(wide[:, offsets_and_gains]) < 3 * np.hypot(scatter, 3e-4 / 40**0.5)


@pytest.mark.parametrize("scatter", [5e-4, 5e-3])
def test_scatter_that_six_faces_cannot_show_is_bounded_by_stated_pose_errors(
    rng: np.random.Generator, scatter: float
) -> None:
    """Six faces, each visited once, with poses off by 0.3° as stated: gains have no redundancy of their own."""
    recipe = tumble.recipe("six-point", reference=RIG | {"pose_std_deg": 0.3})
    theta = tumble.units(rng, 100)
    true = turned(tumble.truths(recipe), np.deg2rad(0.3), rng, len(theta))
    readings = tumble.readings(theta, true)
    readings += scatter * rng.standard_normal(readings.shape)
    table = tumble.table(recipe, readings, 3e-4, 40, rng)
    error, wide = _gains(recipe, table, theta)
    # 300 of .95, three of a unit together: three standard deviations of a third as many.
    assert (error < wide).mean() > 0.95 - 3 * (0.95 * 0.05 / 100) ** 0.5
    assert np.median(wide) < 2.45 * 2**0.5 * np.hypot(np.deg2rad(0.3), scatter)
    if scatter < np.deg2rad(0.3) / 3:
        known = recipe.model_copy(update={"reproducibility": Reproducibility(gain=scatter, dof=30)})
        assert _gains(known, table, theta)[1].min() < wide.min() / 3, "who measured it, knows"


def _gains(recipe: Recipe, table: SampleTable, theta: Floats) -> tuple[Floats, Floats]:
    """Errors of all gains and their U."""
    found = list(pipeline.calibrate(recipe, table, TODAY))
    error = np.abs(np.array([coefficients(r) for r in found]) - theta)
    wide = np.array([r.budget.expanded() for r in found if r.budget is not None])
    return error[:, [3, 7, 11]], wide[:, [3, 7, 11]]


@pytest.mark.parametrize("count", [1, 2, 6, 40])
def test_shortening_by_poses_is_covered_although_it_has_one_sign(rng: np.random.Generator, count: int) -> None:
    """A pose off by δ about each of two axes shortens by an exponential variable of mean δ²."""
    short = np.full((1, 12, count), -1e-6)
    std = np.hypot(1e-6 * count**0.5, contributions.shortening(short)[0, 0])
    error = 1e-6 * rng.exponential(size=(4000, count)).sum(axis=1)
    # 4000 draws of .95: three standard deviations are .010.
    assert (error < 1.96 * std).mean() == pytest.approx(0.95, abs=0.011)
    assert contributions.shortening(np.array([[[1e-6, -1e-6]]]))[0, 0] == 0


def turned(true: Floats, std_rad: float, rng: np.random.Generator, count: int) -> Floats:
    """Truths (count, v, 3) with every pose turned at random."""
    R = rotation.from_vector(std_rad * rng.standard_normal((count, len(true), 3)))
    return np.asarray((R @ true[..., None])[..., 0])


def test_norm_does_not_feel_fixture_error_where_six_point_does(rng: np.random.Generator) -> None:
    """0.2° a pose: the magnitude by norm stays within 0.2 mg rms where the six faces have more than 1.5 mg."""
    direction = rng.standard_normal((400, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    errors = {}
    for method in ("six-point", "norm"):
        ups = None if method == "six-point" else {f"v{i}": v for i, v in enumerate(tumble.VERTICES)}
        recipe = tumble.recipe(method, ups=ups)
        theta = tumble.units(rng, 100)
        true = turned(tumble.truths(recipe), np.deg2rad(0.2), rng, 100)
        table = tumble.table(recipe, tumble.readings(theta, true), 2e-4 * np.sqrt(20), 20, rng)
        observed = tumble.readings(theta, direction)
        found = pipeline.calibrate(recipe, table, TODAY)
        off = [
            np.linalg.norm(r.calibration.correct(observed[i]), axis=1) - 1 for i, r in enumerate(found) if r.calibration
        ]
        errors[method] = float(np.sqrt(np.mean(np.square(off))))
    assert errors["norm"] < 2.0e-4
    assert errors["six-point"] > 1.5e-3


def test_norm_tells_the_tilt_of_every_pose(rng: np.random.Generator) -> None:
    recipe = tumble.recipe("norm")
    true = tumble.truths(recipe)
    tilt = np.deg2rad(0.2) * rng.standard_normal((80, len(true), 3))
    tilted = (rotation.from_vector(tilt) @ true[..., None])[..., 0]
    table = tumble.table(recipe, tumble.readings(tumble.units(rng, 80), tilted), 1e-4, 40, rng)
    found = [r.calibration for r in pipeline.calibrate(recipe, table, TODAY)]
    angle = np.rad2deg(np.arccos(np.clip((tilted * true).sum(axis=2), -1, 1)))
    off = np.array([c.tilt_deg for c in found if c]) - angle
    std = np.array([c.tilt_std_deg for c in found if c])
    assert np.sqrt((off**2).mean()) < 0.085
    assert np.sqrt((off**2).mean()) == pytest.approx(np.sqrt((std**2).mean()), rel=0.2)
