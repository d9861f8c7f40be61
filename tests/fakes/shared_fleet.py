"""Tables of a fleet whose units are drawn here, without the station's own simulation: groups that share a cause."""

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from station.config.recipes import load_recipe
from station.domain.core.types import Floats
from station.wiring.sample_files import FleetWriter
from tests.fakes.watched_log import RECIPE, skew

STATIONS, NESTS = tuple(f"bench-{n}" for n in range(1, 11)), "ABCD"
FIRST, STEP = datetime(2026, 1, 1, tzinfo=UTC), timedelta(seconds=30)
#: What is wrong with a unit, by (number, station, nest, lot): tilt of its nest (3) in rad, offset (3), quadratic term.
Wrong = Callable[[int, str, str, str], tuple[Floats, Floats, float]]
NOTHING: tuple[Floats, Floats, float] = (np.zeros(3), np.zeros(3), 0.0)


def lot_of(number: int, units: int) -> str:
    """Sixteen lots, two at a time."""
    return f"L{number * 8 // units * 2 + number % 2:02d}"


def place_of(number: int) -> tuple[str, str]:
    """Stations by turns, nests by loads."""
    return STATIONS[number % len(STATIONS)], NESTS[number // len(STATIONS) % len(NESTS)]


def write(folder: Path, units: int, wrong: Wrong, seed: int) -> None:
    """Units in the order of time, half a minute apart."""
    recipe = load_recipe(RECIPE)
    text = recipe.model_dump_json(by_alias=True)
    names = [p.name for p in recipe.positions]
    true = np.array([recipe.true_vector(p) for p in recipe.positions])
    rng, v = np.random.default_rng(seed), len(names)
    writer = FleetWriter(folder, f"1:{'00' * 32}")
    plain = {
        "position": names, "seating": ["home"] * v, "run": [0] * v, "visit": list(range(v)), "true": true.tolist(),
        "cov": np.tile(np.eye(3) * 1e-8, (v, 1, 1)).tolist(), "quantisation": [[0.0] * 3] * v, "dof": [[99.0] * 3] * v,
        "std": [[1e-3] * 3] * v, "count": [100] * v, "effective": [90.0] * v, "time_s": [3.0 * i for i in range(v)],
        "temperature_degC": [None] * v,
    }  # fmt: skip
    for number in range(units):
        (station, nest), lot = place_of(number), lot_of(number, units)
        tilt, offset, quadratic = wrong(number, station, nest, lot)
        matrix = np.eye(3) + rng.normal(0, 3e-3, (3, 3)) + np.diag(rng.normal(0, 0.01, 3))
        felt = true - true @ skew(tilt).T
        # One unit in two hundred is no good at all.
        noise = rng.normal(0, 1e-4 if rng.random() > 5e-3 else 0.05, (v, 3))
        mean = felt @ matrix.T + rng.normal(0, 0.03, 3) + offset + quadratic * felt**2 + noise
        at = FIRST + number * STEP
        row = {
            "attempt": f"{number:032x}", "serial": f"SN{number:07d}", "station": station, "nest": nest, "lot": lot,
            "recipe_name": recipe.name, "recipe_version": recipe.version, "recipe_hash": "ab" * 32, "outcome": "PASS",
            "started": at, "stops": json.dumps({**plain, "mean": mean.tolist()}), "recipe": text, "product_json": "{}",
            "before": '["PASS", null, null, []]',
        }  # fmt: skip
        writer.add("reduced", "sensor", f"{at:%Y-%m-%d}", [row])
    writer.finish()
