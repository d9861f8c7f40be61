"""A log of many loads whose readings are drawn here, without the station's own simulation: nests that can tilt."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from station.adapters.store.sqlite import SqliteStore
from station.config.recipes import load_recipe
from station.domain.core.types import Floats, ReducedVisits
from station.domain.evaluation.reduced_visits_document import to_document
from tests.fakes import logs

RECIPE = "six-point"
NESTS = "AB"
FIRST_NS, STEP_NS = 1_767_225_600_000_000_000, 60_000_000_000
#: Rotation vector (3) in rad by load, from 1, and nest.
Tilt = Callable[[int, str], tuple[float, float, float]]


def skew(v: Floats) -> Floats:
    """Turns about v as a matrix, for small angles."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def visits(rng: np.random.Generator, tilt: Floats) -> ReducedVisits:
    """A unit with its own matrix and offset, turned by `tilt` in its nest."""
    recipe = load_recipe(RECIPE)
    names = tuple(p.name for p in recipe.positions)
    v = len(names)
    true = np.array([recipe.true_vector(p) for p in recipe.positions])
    matrix = np.eye(3) + rng.normal(0, 3e-4, (3, 3))
    mean = (true - true @ skew(tilt).T) @ matrix.T + rng.normal(0, 0.01, 3) + rng.normal(0, 1e-4, (v, 3))
    std = 1e-3 * np.exp(rng.normal(0, 0.05, (v, 3)))
    cov = np.tile(np.eye(3) * 1e-8, (v, 1, 1))
    count = np.full(v, 100, np.int64)
    number, zero = np.arange(v, dtype=np.int32), np.zeros(v, np.int32)
    plain, time_s = np.zeros((v, 3)), number.astype(np.float64)
    return ReducedVisits(
        names, ("home",) * v, zero, number, mean, cov, plain, plain + 99, true, std, count, np.full(v, 90.0), time_s,
        np.full(v, np.nan),
    )  # fmt: skip


def write(path: Path, loads: range, tilt: Tilt, seed: int, station: str = "bench-1") -> None:
    """Appends these loads of a station, one unit in each nest."""
    recipe = load_recipe(RECIPE).model_dump_json(by_alias=True)
    with SqliteStore(path) as store:
        for load in loads:
            rng = np.random.default_rng([seed, load])
            for nest in NESTS:
                at = FIRST_NS + load * STEP_NS
                attempt = store.begin(
                    logs.begin(f"{nest}{load:05d}", station=station, nest=nest, started_ns=at, recipe_json=recipe)
                )
                store.result(attempt, "stops", to_document(visits(rng, np.array(tilt(load, nest)))))
                store.result(attempt, "calibration", {"outcome": "PASS", "offset": None, "matrix": None, "checks": []})
                store.finish(attempt, "PASS", at + 28_000_000_000)
