"""Errors of the axes out of readings of eight units: right sizes, honest intervals, silence on what cannot show."""

from itertools import product

import numpy as np
import pytest
from scipy import stats

from station.config.rigs import load_rig
from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.rig.axis_errors import (
    AxisErrors,
    UnitOnAxes,
    corrected_by_errors,
    estimate_axis_errors,
    felt,
    kinds_of,
    worth_telling,
)
from tests.portion import WHOLE

RIG = load_rig("two-axis")
ANGLES = np.array(
    [(a, 0.0) for a in range(-135, 226, 45)]
    + [(0.0, b) for b in range(-135, 226, 45) if b]
    + [(a, -90.0) for a in range(-135, 226, 45)]
)
NOISE = 1e-4


def campaign(rng: np.random.Generator, angles: Floats, seats: Floats | None = None) -> tuple[Floats, Floats]:
    """True errors, and the readings of eight units with errors of their own."""
    kinds = kinds_of(RIG)
    true = rng.normal(0, 0.1, len(kinds)) * np.array([3e-3 if kind == "scale" else 1.0 for _, kind in kinds])
    g = felt(RIG, angles, true, seats)
    M = np.eye(3) + rng.normal(0, 0.01, (8, 3, 3))
    readings = np.einsum("uij,vj->uvi", M, g) + rng.normal(0, 0.03, (8, 1, 3))
    return true, readings + rng.normal(0, NOISE, readings.shape)


def estimated(angles: Floats, readings: Floats, seats: Floats | None = None) -> AxisErrors:
    """Errors of the axes from units (n, v, 3) that were all at the same angles; seats left out: at home."""
    seats = np.broadcast_to(np.eye(3), (len(angles), 3, 3)) if seats is None else seats
    return estimate_axis_errors(RIG, [UnitOnAxes(angles, unit, seats) for unit in readings])


def test_errors_are_found_within_a_hundredth_of_a_degree_with_intervals_that_cover(rng: np.random.Generator) -> None:
    covered, tried = 0, 0
    for _ in range(20 if WHOLE else 8):
        true, readings = campaign(rng, ANGLES)
        found = estimated(ANGLES, readings)
        assert found.residual_g == pytest.approx(NOISE, rel=0.3)
        for error, value in zip(found.errors, true.tolist(), strict=True):
            if error.value is None or error.interval is None:
                assert (error.axis, error.kind) == ("inner", "zero")
                continue
            assert abs(error.value - value) < 0.01
            covered += abs(error.value - value) <= error.interval
            tried += 1
    low, high = stats.binom.interval(0.999, tried, 0.95)
    assert low <= covered <= high


def test_two_seatings_show_the_zero_of_the_inner_axis_too(rng: np.random.Generator) -> None:
    turned = rotation.about(np.array([0.0, 0.0, 1.0]), 180.0)
    angles = np.vstack([ANGLES, ANGLES])
    seats = np.stack([np.eye(3)] * len(ANGLES) + [turned] * len(ANGLES))
    true, readings = campaign(rng, angles, seats)
    found = estimated(angles, readings, seats)
    for error, value in zip(found.errors, true.tolist(), strict=True):
        assert error.value == pytest.approx(value, abs=0.01), (error.axis, error.kind)


def test_one_circle_of_positions_shows_little_and_says_so(rng: np.random.Generator) -> None:
    angles = np.array([(a, 0.0) for a in range(-135, 226, 45)])
    _, readings = campaign(rng, angles)
    found = estimated(angles, readings)
    assert found.of("inner", "scale").value is None
    assert found.of("outer", "zero").value is None


def test_the_corrected_map_feels_as_the_rig_does(rng: np.random.Generator) -> None:
    kinds = kinds_of(RIG)
    true = np.array(
        [
            {"zero": 0.2, "scale": 5e-4, "square": -0.3}.get(k, 0.0) if (a, k) != ("inner", "zero") else 0.0
            for a, k in kinds
        ]
    )
    g = felt(RIG, ANGLES, true)
    readings = np.stack([g + rng.normal(0, NOISE, g.shape) for _ in range(8)])
    corrected = corrected_by_errors(RIG, estimated(ANGLES, readings))
    for outer, inner in product((-90.0, 30.0, 180.0), (-90.0, 45.0)):
        counts = [axis.counts(angle) for axis, angle in zip(RIG.axes, (outer, inner), strict=True)]
        angles = tuple(axis.angle_deg(c) for axis, c in zip(corrected.axes, counts, strict=True))
        up = corrected.attitude(angles).T @ [0.0, 0.0, 1.0]
        want = felt(RIG, np.array([[outer, inner]]), true)[0]
        assert np.degrees(np.linalg.norm(up - want)) < 0.01


def test_units_at_other_angles_and_of_other_loads_are_one_estimate(rng: np.random.Generator) -> None:
    """Each unit brings its own angles: encoders never stop twice at the same count."""
    kinds = kinds_of(RIG)
    true = rng.normal(0, 0.1, len(kinds)) * np.array([3e-3 if kind == "scale" else 1.0 for _, kind in kinds])
    units = []
    for _ in range(8):
        angles = ANGLES + rng.uniform(-0.02, 0.02, ANGLES.shape)
        readings = felt(RIG, angles, true) + rng.normal(0, NOISE, (len(angles), 3))
        units.append(UnitOnAxes(angles, readings, np.broadcast_to(np.eye(3), (len(angles), 3, 3))))
    found = estimate_axis_errors(RIG, units)
    for error, value in zip(found.errors, true.tolist(), strict=True):
        if error.value is not None:
            assert abs(error.value - value) < 0.01, (error.axis, error.kind)


def test_what_moves_no_place_by_a_hundredth_of_a_degree_is_not_told(rng: np.random.Generator) -> None:
    _, readings = campaign(rng, ANGLES)
    right = felt(RIG, ANGLES, np.zeros(len(kinds_of(RIG))))
    quiet = np.stack([right + rng.normal(0, NOISE / 10, right.shape) for _ in range(8)])
    assert not any(worth_telling(e) for e in estimated(ANGLES, quiet).errors)
    assert any(worth_telling(e) for e in estimated(ANGLES, readings).errors)
