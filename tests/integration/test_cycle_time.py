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


@pytest.mark.parametrize("first", [1, 4])
def test_the_cycle_time_is_foretold_without_a_log_by_other_recipes_and_by_the_same(
    first: int, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a full load, whatever loads the log has: units are written one after the other."""
    without = predicted_s("three-point", capsys)
    run_command(["run", "--simulate", "--units", "4", "--recipe", "three-point"])
    assert without == pytest.approx(real_s("three-point"), rel=WITHIN)
    if first == 1:
        Path("station.db").rename("first.db")
        Path("station.db.head").rename("first.db.head")
        run_command(["run", "--simulate", "--units", "1", "--recipe", "three-point"])
    for recipe in ("six-point", "one-point"):
        by_others = predicted_s(recipe, capsys)
        if first == 1:
            run_command(["run", "--simulate", "--units", "1", "--recipe", recipe])
            by_small_loads = predicted_s(recipe, capsys, "--db", "station.db")
            assert by_small_loads == pytest.approx(by_others, rel=WITHIN)
        run_command(["run", "--simulate", "--units", "4", "--recipe", recipe])
        assert by_others == pytest.approx(real_s(recipe), rel=WITHIN), recipe
        assert predicted_s(recipe, capsys) == pytest.approx(real_s(recipe), rel=WITHIN), recipe


def test_a_product_is_checked_alone(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["check", "--product", "accelerometer"]) == 0
    shown = capsys.readouterr().out
    assert "accelerometer: accelerometer; X, Y, Z of message ACCELERATION, in g" in shown
    assert "writes 12 coefficients" in shown
    assert "agrees with accelerometer.eds" in shown
    with pytest.raises(UsageError, match="Name a recipe, or a product"):
        run_command(["check"])
