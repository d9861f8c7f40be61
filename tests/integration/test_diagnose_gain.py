"""What a cause means for the line, in the JSON: calibrations moved, verdicts changed, yield; against known truth."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from station.adapters.samples import read_samples
from station.config.recipes import load_recipe, recipe_path
from station.diagnosis.results.line_impact import _impacts, _unit_impact
from station.domain.core.types import Floats
from station.domain.evaluation import pipeline
from station.model.simulate import SimulationJob, simulate
from tests.fakes.command import station

pytestmark = pytest.mark.timeout(300)


def recipe_with(folder: Path, **limits: object) -> str:
    """offset-gain with two seatings, so that a nest's tilt can be told from the parts' own."""
    printed = yaml.safe_load(recipe_path("offset-gain").read_text(encoding="utf-8"))
    printed |= {"seatings": {"turned": {"axis": [0, 0, 1], "angle_deg": 180}}, "limits": limits, "verify": {}}
    printed["runs"] = [{"seating": "home"}, {"seating": "turned", "order": "reversed"}]
    path = folder / "recipe.yaml"
    path.write_text(yaml.safe_dump(printed), encoding="utf-8")
    return str(path)


def found(folder: Path, recipe: str, *effect: str) -> tuple[dict[str, Any], Path]:
    """The diagnosis of four units, and their samples."""
    samples, shown = folder / "s.parquet", folder / "d.json"
    requested = ["--recipe", recipe, "--units", "4", "--seed", "5", *effect, "--out", str(samples)]
    assert station("simulate", *requested) == 0
    station("diagnose", "--recipe", recipe, "--samples", str(samples), "--json", str(shown))
    return json.loads(shown.read_text(encoding="utf-8")), samples


def offsets(recipe: str, samples: Path) -> dict[str, Floats]:
    """Calibrated offset of each unit."""
    results = pipeline.calibrate(load_recipe(recipe), read_samples(samples), "2026-11-21")
    return {r.serial: r.calibration.offset for r in results if r.calibration is not None}


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """The same without any cause."""
    folder = tmp_path_factory.mktemp("healthy")
    return found(folder, recipe_with(folder, offset=0.2))


def test_calibrations_move_as_if_the_cause_had_never_been(tmp_path: Path, healthy: tuple[Any, Path]) -> None:
    """Of one seed the samples with and without the cause differ by the cause alone: what it does is known exactly."""
    recipe = recipe_with(tmp_path, offset=0.2)
    shown, samples = found(tmp_path, recipe, "--effect", "quadratic=0.004")
    line = shown["line"]
    assert (shown["causes"][0]["effect"], line["unit"]) == ("quadratic", "mg")
    bent = offsets(recipe, samples)
    straight = offsets(recipe, healthy[1])
    # Rms over a hundred thousand directions of what offset and matrix make of an axis.
    a = np.random.default_rng(0).standard_normal((100_000, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    for unit in line["units"]:
        wanted = straight[unit["serial"]] - bent[unit["serial"]]
        assert np.linalg.norm(wanted) > 5e-4
        # The coefficient's own 44 µg/g² move the offset of an axis by half as much; four standard deviations.
        assert unit["offset"] == pytest.approx(1e3 * wanted, abs=0.09)
        b, A = np.array(unit["offset"]), 1e3 * np.array(unit["matrix"])
        assert unit["moves"] == pytest.approx(np.sqrt(np.mean((b + a @ A.T) ** 2)), rel=0.01)


def test_verdicts_that_the_cause_made_are_counted(tmp_path: Path) -> None:
    """The residual that a tilted nest leaves fails every unit; without it all pass."""
    recipe = recipe_with(tmp_path, offset=0.2, residual=0.001)
    shown, _ = found(tmp_path, recipe, "--effect", "nest-tilt=0.004")
    line = shown["line"]
    assert shown["causes"][0]["effect"] == "nest-tilt"
    assert {(u["before"], u["after"]) for u in line["units"]} == {("FAIL", "PASS")}
    assert (line["verdicts_changed"], line["passed_before"], line["passed_after"]) == (4, 0, 4)
    assert (line["yield_before"], line["yield_after"]) == (0.0, 1.0)


def test_a_recipe_without_limits_judges_nothing(tmp_path: Path) -> None:
    recipe = recipe_with(tmp_path)
    line = found(tmp_path, recipe, "--effect", "nest-tilt=0.004")[0]["line"]
    assert (line["verdicts_changed"], line["yield_before"], line["units"][0]["before"]) == (None, None, None)
    assert len(line["units"]) == 4


def test_rounding_moves_nothing() -> None:
    """Of what each run holds alike, such as another offset at each power-on, two solutions differ by rounding."""
    recipe = load_recipe("offset-gain")
    table = simulate(SimulationJob(recipe, ("A",), seed=5)).table
    (result,) = pipeline.calibrate(recipe, table, "2026-11-21")
    assert result.calibration is not None
    for share, moves in ((1e-15, 0.0), (1e-6, pytest.approx(1e-6 / np.sqrt(3)))):
        offset = result.calibration.offset + np.array([share, 0.0, 0.0])
        moved = replace(result, calibration=replace(result.calibration, offset=offset))
        impact = _unit_impact(result, moved, 1.0)
        assert impact is not None
        assert impact.shift_rms == moves
    # A unit that is clipped at every visit is measured, and not corrected.
    assert len(_impacts([result, replace(result, serial="B")], [result], 1.0)) == 1


def test_where_nothing_is_found_nothing_moves(healthy: tuple[dict[str, Any], Path]) -> None:
    shown, _ = healthy
    assert (shown["verdict"], shown["line"]) == ("none", None)
