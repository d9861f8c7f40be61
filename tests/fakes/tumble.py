"""Units whose truth is known, tumbled: a samples table made by nothing but matrix · true + offset + noise."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.evaluation import pipeline
from station.domain.evaluation.pipeline import NO_ROUNDING, CalibrationResult
from station.domain.recipe import plan
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError

TODAY = "2026-11-21"
FACES: Mapping[str, str] = {
    **{"x-up": "+x", "x-down": "-x", "y-up": "+y"},
    **{"y-down": "-y", "z-up": "+z", "z-down": "-z"},
}
#: A rig without errors, stated.
EXACT: Mapping[str, Any] = {"magnitude_std": 0, "nest_std_deg": 0}
TRUTHS: Mapping[str, Mapping[str, Any]] = {
    "accelerometer": {"unit": "g", "reference": {"source": "gravity", "magnitude": 1.0, **EXACT, "base_std_deg": 0}},
    "magnetometer": {
        "unit": "uT",
        "reference": {"source": "field", "vector": [20.0, 0.0, -44.0], **EXACT, "field_std_deg": 0},
    },
    "gyroscope": {"unit": "deg/s", "reference": {"source": "rate", **EXACT}},
}
#: Directions that hold the answer well: 12 vertices of an icosahedron and the six faces.
GOLDEN = (1 + 5**0.5) / 2
VERTICES = [np.roll((0.0, a, b * GOLDEN), k) for a in (1, -1) for b in (1, -1) for k in range(3)]


def position(name: str, up: Floats, sensor: str = "accelerometer", rate: float = 100.0) -> dict[str, Any]:
    """A position in which the device's axis `up` (3) points up; of a gyroscope, about which it turns."""
    unit = np.asarray(up, float) / np.linalg.norm(up)
    if sensor == "gyroscope":
        return {"name": name, "rate": (rate * unit).tolist()}
    turn = rotation.to_vector(rotation.shortest(unit, np.array([0.0, 0.0, 1.0])))
    angle = float(np.degrees(np.linalg.norm(turn)))
    if angle > 180 - 1e-6:
        turn = np.cross(unit, np.eye(3)[int(np.abs(unit).argmin())])
    axis = turn if np.linalg.norm(turn) > 1e-9 else np.array([0.0, 0.0, 1.0])
    return {"name": name, "rotate": [{"axis": axis.tolist(), "angle_deg": angle}]}


def recipe(method: str, sensor: str = "accelerometer", ups: Mapping[str, Any] | None = None, **more: Any) -> Recipe:
    """A recipe with the positions a method wants, or those of `ups`: name → axis of the device that points up."""
    axis = {f"{s}{a}": (1 if s == "+" else -1) * np.eye(3)[i] for s in "+-" for i, a in enumerate("xyz")}
    named = {name: axis[up] for name, up in FACES.items()}
    chosen = {
        "one-point": {"z-up": named["z-up"]},
        "three-point": {n: named[n] for n in ("x-up", "y-up", "z-up")},
        "six-point": named,
    }.get(method, named | {f"v{i:02d}": v for i, v in enumerate(VERTICES)})
    ups = chosen if ups is None else ups
    base: dict[str, Any] = {
        "schema": "station.recipe/1",
        "name": method,
        "version": 1,
        "sensor": sensor,
        **TRUTHS[sensor],
        "positions": [position(n, u, sensor) for n, u in ups.items()],
        "method": method,
    }
    return Recipe.model_validate(base | more)


def truths(of: Recipe) -> Floats:
    """Truth (v, 3) of every planned stop of all runs."""
    return np.array([s.true for run in range(len(of.runs)) for s in plan.planned_visits(of, run)])


def units(rng: np.random.Generator, count: int, size: float = 1.0) -> Floats:
    """Coefficients (count, 12) of ordinary units: offsets of 2 % of the stimulus, gains and cross-axis of 1 %."""
    offset = 0.02 * size * rng.standard_normal((count, 3))
    matrix = np.eye(3) + 0.01 * rng.standard_normal((count, 3, 3))
    return np.concatenate([offset, matrix.reshape(count, 9)], axis=1)


def readings(theta: Floats, true: Floats) -> Floats:
    """matrix · true + offset (u, v, 3) of truths (v, 3) or (u, v, 3)."""
    matrix = theta[:, 3:].reshape(-1, 3, 3)
    return (
        np.asarray(np.broadcast_to(true, (len(theta), *true.shape[-2:])) @ matrix.transpose(0, 2, 1))
        + theta[:, None, :3]
    )


def table(of: Recipe, mean: Floats, noise: Floats | float, count: int, rng: np.random.Generator) -> SampleTable:
    """A samples table with `count` readings a visit about the means (u, v, 3); noise: standard deviation, or
    ready-made noise (u, v, count, 3)."""
    u, v, _ = mean.shape
    stops = [s for run in range(len(of.runs)) for s in plan.planned_visits(of, run)]
    added = noise if isinstance(noise, np.ndarray) else noise * rng.standard_normal((u, v, count, 3))
    names = tuple(dict.fromkeys(s.position for s in stops))
    seats = tuple(dict.fromkeys(s.seating for s in stops))

    def each(values: list[int]) -> Any:
        return np.tile(np.repeat(np.array(values, np.int32), count), u)

    clock = np.concatenate([s.visit * 2.0 + np.arange(count) / of.device.rate_hz for s in stops])
    return SampleTable(
        unit=Labels(tuple(f"SN{i:05d}" for i in range(u)), np.repeat(np.arange(u, dtype=np.int32), v * count)),
        run=each([s.run for s in stops]),
        visit=each([s.visit for s in stops]),
        position=Labels(names, each([names.index(s.position) for s in stops])),
        time_s=np.tile(clock, u),
        reading=(mean[:, :, None] + added).reshape(-1, 3),
        labels={"seating": Labels(seats, each([seats.index(s.seating) for s in stops]))},
    )


def coefficients(result: Any) -> Floats:
    """The twelve of a result."""
    return np.concatenate([result.calibration.offset, result.calibration.matrix.ravel()])


def calibrate_unit(recipe: Recipe, table: SampleTable, today: str, rounding: Floats = NO_ROUNDING) -> CalibrationResult:
    """The one unit of a table. Errors: as `pipeline.calibrate`, and SamplesError when it cannot be calibrated."""
    (result,) = pipeline.calibrate(recipe, table, today, rounding)
    if result.calibration is None:
        raise SamplesError(result.verdict.reasons[0].message)
    return result
