"""What a diagnosis has learnt of the devices goes into their calibration, and the verification error falls."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.fakes.command import station

pytestmark = pytest.mark.timeout(300)


def ran(folder: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[dict[str, Any], str]:
    """A run of two units with crooked axes: document, and what was said beside it."""
    requested = ("--recipe", "offset-gain", "--simulate", "--units", "2", "--effect", "cross-axis=0.003")
    assert station("run", *requested, "--db", str(folder / "station.db"), "--json", *more) == 0
    shown = capsys.readouterr()
    return json.loads(shown.out), shown.err


def errors(document: dict[str, Any], name: str) -> list[float]:
    return [p[name] for unit in document["units"] for p in unit["verification"]["positions"]]


@pytest.fixture
def learnt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[Path, Any]:
    """The model that a diagnosis of a first run wrote, and that run."""
    first, _ = ran(tmp_path, capsys)
    model, db = tmp_path / "model.yaml", str(tmp_path / "station.db")
    assert station("diagnose", "--db", db, "--recipe", "offset-gain", "--extend", str(model), "--json", "-") == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], [c["effect"] for c in found["causes"]]) == ("named", ["cross-axis"])
    return model, first


def test_the_verification_error_falls(
    learnt: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, first = learnt
    second, printed = ran(tmp_path, capsys, "--model", str(model))
    assert "cross-axis, the device's own, goes into the calibration: offset and the whole matrix" in printed
    assert {tuple(u["verification"]["takes_in"]) for u in second["units"]} == {("cross-axis",)}
    # As the first run would have had it on the same dwells, to the noise of a dwell; and far below it now.
    assert errors(second, "error_before") == pytest.approx(errors(first, "error"), abs=4e-4)
    assert min(errors(first, "error")) > 2e-3
    assert max(errors(second, "error")) < 4e-4
    assert all(abs(u["matrix"][0][1]) > 5e-4 for u in second["units"])


def test_the_log_says_so_and_computes_it_again(
    learnt: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, _ = learnt
    ran(tmp_path, capsys, "--model", str(model))
    assert station("audit", "SN0001", "--db", str(tmp_path / "station.db"), "--recompute", "--json") == 0
    stored = json.loads(capsys.readouterr().out)
    printed = json.dumps(stored)
    assert '"takes_in": ["cross-axis"]' in printed
    assert '"error_before"' in printed


def test_what_the_device_cannot_hold_is_said_and_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "model.yaml"
    model.write_text("schema: station.model/1\neffects: [{effect: quadratic}, {effect: nest-tilt}]\n", encoding="utf-8")
    document, printed = ran(tmp_path, capsys, "--model", str(model))
    assert "quadratic is no part of offset and matrix" in printed
    assert "nest-tilt is of the rig and not of the device" in printed
    assert all("takes_in" not in u["verification"] for u in document["units"])
    assert all(u["matrix"][0][1] == 0 for u in document["units"])
