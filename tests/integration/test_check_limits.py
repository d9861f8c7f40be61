"""`station check` of limits and references: what can be decided, and what contradicts itself."""

import json
from pathlib import Path

import numpy as np
import pytest

from station.cli.app import run_command
from station.config.recipes import load_recipe
from station.domain.planning.forecast import forecast
from station.errors import RecipeError
from tests.fakes import fixture_run

POSITION = {"name": "verify-x", "up": "+x"}


@pytest.mark.parametrize(
    ("limit", "verdict"), [(0.0001, "impossible"), (0.0038, "impossible"), (0.008, "tight"), (0.02, "comfortable")]
)
def test_a_verification_limit_is_judged_before_anything_moves(tmp_path: Path, limit: float, verdict: str) -> None:
    recipe = load_recipe(fixture_run.recipe(tmp_path, verify={"limit": limit, "positions": [POSITION]}))
    found = forecast(recipe, rounding=np.zeros(12)).decisions[-1]
    assert (found.kind, found.coefficient, found.verdict) == ("verification", "verify-x", verdict)
    # Nest 0.1 and base 0.05 degrees across the stimulus, 0.16 % along it: U of the least known direction.
    assert found.expanded == pytest.approx(1.96 * max(0.0016, (0.1**2 + 0.05**2) ** 0.5 * 0.0174533), rel=0.01)


@pytest.mark.parametrize(
    ("reference", "other"),
    [
        ({"site": {"latitude_deg": 47, "altitude_m": 400}, "magnitude": 1.0}, "site and by reference.magnitude"),
        ({"site": {"latitude_deg": 47, "altitude_m": 400}, "magnitude_std": 0.001}, "reference.magnitude_std"),
        ({"gravimeter": {"value_m_s2": 9.81, "std_m_s2": 1e-5}, "magnitude": 1.0}, "gravimeter and by"),
    ],
)
def test_gravity_stated_twice_is_refused(tmp_path: Path, reference: dict[str, object], other: str) -> None:
    path = fixture_run.recipe(tmp_path, reference={"source": "gravity", **reference})
    with pytest.raises(RecipeError, match=other):
        load_recipe(path)


@pytest.mark.parametrize("magnitude", [9.81, 0.985, 1000.0])
def test_a_magnitude_that_is_no_gravity_on_earth_is_refused(tmp_path: Path, magnitude: float) -> None:
    path = fixture_run.recipe(tmp_path, reference={"source": "gravity", "magnitude": magnitude})
    with pytest.raises(RecipeError, match=f"reference.magnitude {magnitude:g} is no gravity on Earth"):
        load_recipe(path)


@pytest.mark.parametrize(("full_scale", "beyond"), [(0.5, ["z-up", "x-up"]), (1.0, []), (2.0, [])])
def test_positions_beyond_the_range_are_named_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], full_scale: float, beyond: list[str]
) -> None:
    path = str(fixture_run.recipe(tmp_path, device={"rate_hz": 100, "full_scale": full_scale}))
    assert run_command(["check", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out).get("beyond_range", [])[::2][:2] == beyond
    assert run_command(["check", path]) == 0
    assert ("Every unit clips at z-up, z-down" in capsys.readouterr().out) == bool(beyond)


def test_a_due_date_that_is_no_day_names_its_form(tmp_path: Path) -> None:
    own = [{"item": "fixture", "number": "C-1", "due": "31.1.2027"}]
    path = Path(fixture_run.recipe(tmp_path, reference={"source": "gravity", "certificates": own}))
    with pytest.raises(RecipeError, match="2027-01-31"):
        load_recipe(path)
    assert json.loads(path.read_text())["reference"]["certificates"] == own
