"""A cause in a file of its own is simulated, found blind, drawn and listed with no other file touched."""

import importlib
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from station import plugins
from station.diagnosis.results.diagnose import diagnose
from station.diagnosis.results.diagnosis_document import document
from station.diagnosis.search import alarm
from station.model import catalogue, truth
from station.model.model_file import Model
from station.model.simulate import SimulationJob, parse_effect, simulate
from station.reporting.diagnosis.gather import report_data
from station.reporting.diagnosis.page import build_page
from tests.unit.tilt_recipe import THREE_RUNS, tilt

#: A bar is none of the table's.
PHYSICS_IN_A_TABLE = r"The reading follows the sine of the sum of all axes, a ripple of their supply, and of \|a\|."
FILE = '''
"""The reading follows the sine of the sum of all axes, a ripple of their supply, and of |a|.

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

    physics = "The reading follows the sine of the sum of all axes, a ripple of their supply, and of |a|."
    remedy = "have the converter linearised"
    shown_by = "add tilts between the faces"
    drawn_over = "input"
    level = "device"
    of = ("unit",)
    parameter = Parameter("height", "u", 1e-3, 1e-4, 1e-2, "made up")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · sin(5 Σ a)."""
        return np.asarray(c * np.sin(5 * signal.true.sum(1, keepdims=True)))
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
    written = truth.document(plain, [made])["effects"][0]
    c = np.array([p["value"] for p in written["parameters"]])
    assert written["effect"] == "ripple" and np.sqrt(np.mean(c**2)) == pytest.approx(0.01)
    visits = made.scene.visits
    true = np.einsum("vji,vj->vi", visits.nest_R, visits.stimulus)[made.scene.visit]
    change = made.table.reading - simulate(plain).table.reading
    np.testing.assert_allclose(change, c * np.sin(5 * true.sum(1, keepdims=True)), atol=1e-12)
    assert any(row["effect"] == "ripple" for row in catalogue.rows())
    page = catalogue.page()
    assert "| `ripple` | have the converter linearised | add tilts between the faces | input | yes |" in page
    assert f"| `ripple` | {PHYSICS_IN_A_TABLE} |" in page


@pytest.mark.usefixtures("ripple")
def test_it_is_found_blind_and_the_report_has_its_remedy_and_picture() -> None:
    recipe = tilt(runs=THREE_RUNS)
    job = SimulationJob(recipe, ("A", "B"), 4, (parse_effect("ripple", recipe),))
    made = simulate(job)
    found = diagnose(recipe, made.table, Model(), partial(alarm.bootstrap, seed=1))
    written = document(found)
    assert (written["verdict"], [c["effect"] for c in written["causes"]]) == ("named", ["ripple"])
    rows = truth.document(job, [made])["effects"][0]["parameters"]
    true = {(row["of"], row["axis"]): row["value"] for row in rows}
    for row in written["causes"][0]["parameters"]:
        assert row["value"] == pytest.approx(true[row["of"], row["axis"]], abs=5 * row["std"])
    page = build_page(report_data(found, written))
    assert page.do == "Have the converter linearised."
    assert page.lead is not None and page.lead.svg.startswith("<svg")


def test_it_is_gone_again() -> None:
    assert "ripple" not in plugins.names("station.model.effects")
