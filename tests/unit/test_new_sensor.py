"""A sensor kind in a file of its own is simulated, calibrated and diagnosed with no other file touched."""

import importlib
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station import plugins
from station.diagnosis.results.diagnose import diagnose
from station.diagnosis.search import alarm
from station.domain.product.product import Product
from station.domain.recipe import sensor
from station.model.model_file import Model
from station.model.simulate import SimulationJob, parse_effect, simulate
from tests.fakes import tumble
from tests.unit.tilt_recipe import THREE_RUNS, tilt

FILE = '''
"""Load cell of three axes: at rest it reads the weight of its plate."""

import numpy as np


class LoadCell:
    """Force in newtons."""

    unit = "N"
    quantity = "force"
    sources = ("gravity", "gold")
    feels_earth_rate = False
    large_offset = False

    def truth_errors(self, recipe, position, seating, true):
        """The plate's weight."""
        return {"weight": (recipe.reference.relative_std() * true)[None]}

    def nuisance(self, recipe, position, seating):
        """Nothing else acts."""
        return np.zeros((len(position), 0))
'''


@pytest.fixture
def load_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A folder more in the package of sensors, with one file in it."""
    (tmp_path / "load_cell.py").write_text(FILE, encoding="utf-8")
    package = importlib.import_module(sensor.PACKAGE)
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    importlib.invalidate_caches()
    yield
    plugins.load.cache_clear()
    sys.modules.pop(f"{sensor.PACKAGE}.load_cell", None)
    vars(package).pop("load_cell", None)


def recipe(**more: Any) -> Any:
    reference = {"source": "gravity", "magnitude": 12.0, "magnitude_std": 0.0}
    return tilt(sensor="load-cell", unit="N", reference=reference, runs=THREE_RUNS, **more)


@pytest.mark.usefixtures("load_cell")
def test_a_new_file_is_all_it_takes_to_simulate_calibrate_and_diagnose() -> None:
    job = SimulationJob(recipe(), ("A", "B"), 3, (parse_effect("quadratic", recipe()),))
    made = simulate(job)
    plain = simulate(SimulationJob(recipe(), ("A",), 3))
    unit = tumble.calibrate_unit(recipe(), plain.table, "2026-11-22")
    assert unit.calibration is not None
    gain = np.diagonal(unit.calibration.matrix)
    np.testing.assert_allclose(gain, np.diagonal(plain.base.matrix[0]), atol=2e-4)
    found = diagnose(job.recipe, made.table, Model(), partial(alarm.bootstrap, seed=1))
    assert found.verdict == "named"
    assert "quadratic" in {c.finding.name for c in found.causes} | set(found.causes[0].finding.indistinguishable_from)


@pytest.mark.usefixtures("load_cell")
def test_a_product_may_be_of_the_new_kind() -> None:
    Product.__pydantic_validator__.validate_assignment(Product.model_construct(), "sensor", "load-cell")


def test_it_is_gone_again() -> None:
    with pytest.raises(ValueError, match="'load-cell' is unknown"):
        recipe()
