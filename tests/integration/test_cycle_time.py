"""The cycle time that `check` states, against the loads themselves; and a product checked without a recipe."""

import json
from pathlib import Path

import pytest

from station.cli.app import run_command
from station.errors import UsageError
from station.ports.log_reader import Query
from station.wiring.logs import open_log

#: Predicted ÷ real.
WITHIN = 0.05


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def predicted_s(recipe: str, capsys: pytest.CaptureFixture[str], *words: str) -> float:
    """What `check` states."""
    capsys.readouterr()
    assert run_command(["check", recipe, "--json", *words]) == 0
    return float(json.loads(capsys.readouterr().out)["cycle_s"])


def real_s(recipe: str) -> float:
    """What the newest attempt took."""
    with open_log(Path("station.db")) as log:
        attempt = log.attempts(Query(recipe_name=recipe), 1)[0]
    assert attempt.ended_ns is not None
    return (attempt.ended_ns - attempt.started_ns) / 1e9


def test_the_cycle_time_is_foretold_without_a_log_by_other_recipes_and_by_the_same(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without = predicted_s("three-point", capsys)
    run_command(["run", "--simulate", "--units", "1", "--recipe", "three-point"])
    assert without == pytest.approx(real_s("three-point"), rel=WITHIN)
    by_another = predicted_s("six-point", capsys)
    run_command(["run", "--simulate", "--units", "1", "--recipe", "six-point"])
    assert by_another == pytest.approx(real_s("six-point"), rel=WITHIN)
    assert predicted_s("six-point", capsys, "--db", "station.db") == pytest.approx(real_s("six-point"), rel=WITHIN)


def test_a_product_is_checked_alone(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["check", "--product", "accelerometer"]) == 0
    shown = capsys.readouterr().out
    assert "accelerometer: accelerometer; X, Y, Z of message ACCELERATION, in g" in shown
    assert "writes 12 coefficients" in shown
    assert "agrees with accelerometer.eds" in shown
    with pytest.raises(UsageError, match="Name a recipe, or a product"):
        run_command(["check"])
