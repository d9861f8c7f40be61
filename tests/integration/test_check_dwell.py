"""`station check` of a recipe whose dwells end when they are good enough: how long, and whether that suffices."""

import json
from pathlib import Path

import pytest

from station.cli.app import main
from tests.fakes import fixture_run


def checked(folder: Path, capsys: pytest.CaptureFixture[str], *more: str, max_s: float) -> str:
    """What `station check` prints of six faces that want 50 ug and 50 ppm."""
    recipe = fixture_run.recipe(folder, dwell={"until_std": 5e-5, "min_s": 0.2, "max_s": max_s})
    with pytest.raises(SystemExit) as ended:
        main(["check", recipe, *more])
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_dwells_and_coefficients_are_predicted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = json.loads(checked(tmp_path, capsys, "--json", max_s=5))["predicted"]
    assert found["dwell_s"] == pytest.approx([1.0] * 6, rel=0.01)
    assert max(c["std"] for c in found["coefficients"]) >= 5e-5 * 0.99


def test_a_longest_dwell_that_cannot_suffice_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    printed = " ".join(checked(tmp_path, capsys, max_s=0.5).split())
    assert "s a visit" in printed
    assert "times the target of dwell.until_std 5e-05 g: raise dwell.max_s (0.5 s) or add positions" in printed
