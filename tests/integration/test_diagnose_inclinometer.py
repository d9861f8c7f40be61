"""Two axes of tilt: the third, which the sensor does not have, reads the same always."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.fakes.command import station


def found(tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int, *effect: str) -> dict[str, Any]:
    samples = str(tmp_path / "tilts.parquet")
    recipe = ("--recipe", "inclinometer-n-point")
    assert station("simulate", *recipe, "--units", "1", "--seed", str(seed), *effect, "--out", samples) == 0
    capsys.readouterr()
    station("diagnose", *recipe, "--samples", samples, "--json", "-")
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


@pytest.mark.parametrize("seed", [4, 8])
def test_a_healthy_inclinometer_has_no_cause(tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int) -> None:
    assert found(tmp_path, capsys, seed)["verdict"] == "none"


def test_the_curve_of_an_inclinometer_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = found(tmp_path, capsys, 3, "--effect", "cubic")
    assert (document["verdict"], [cause["effect"] for cause in document["causes"]]) == ("named", ["cubic"])
