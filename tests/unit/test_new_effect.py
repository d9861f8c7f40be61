"""A cause in a file of its own is simulated, listed and told with no other file touched."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from station import plugins
from station.model import catalogue, truth
from station.model.simulate import SimulationJob, parse_effect, simulate
from tests.unit.tilt_recipe import tilt

FILE = '''
"""The reading follows the sine of what the axis feels: a ripple of the converter.

>>> 1 + 1
2
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class Ripple(SensorEffect):
    """Height of the ripple."""

    level = "device"
    of = ("unit",)
    parameter = Parameter("height", "u", 1e-3, 1e-4, 1e-2, "made up")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · sin(7a)."""
        return np.asarray(c * np.sin(7 * signal.true))
'''


@pytest.fixture
def ripple(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A folder more in the package of effects, with one file in it."""
    (tmp_path / "ripple.py").write_text(FILE, encoding="utf-8")
    package = importlib.import_module("station.model.effects")
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    importlib.invalidate_caches()
    yield
    plugins.load.cache_clear()
    sys.modules.pop("station.model.effects.ripple", None)
    vars(package).pop("ripple", None)


@pytest.mark.usefixtures("ripple")
def test_a_new_file_is_all_it_takes() -> None:
    recipe = tilt()
    assert "ripple" in plugins.names("station.model.effects")
    plain = SimulationJob(recipe, ("A",), 3)
    made = simulate(SimulationJob(recipe, ("A",), 3, (parse_effect("ripple", recipe, "0.01"),)))
    told = truth.document(plain, [made])["effects"][0]
    c = np.array([p["value"] for p in told["parameters"]])
    assert told["effect"] == "ripple" and np.sqrt(np.mean(c**2)) == pytest.approx(0.01)
    visits = made.scene.visits
    true = np.einsum("vji,vj->vi", visits.nest_R, visits.stimulus)[made.scene.visit]
    change = made.table.reading - simulate(plain).table.reading
    np.testing.assert_allclose(change, c * np.sin(7 * true), atol=1e-12)
    assert any(row["effect"] == "ripple" for row in catalogue.rows())


def test_it_is_gone_again() -> None:
    assert "ripple" not in plugins.names("station.model.effects")
