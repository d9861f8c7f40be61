"""`station check --order`, and a run that goes the fastest way."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from station.cli.app import main
from station.config.recipes import load_recipe
from station.domain.core.types import Outcome
from station.domain.recipe import plan
from tests.fakes import fixture_run


def checked(*arguments: str) -> int | str | None:
    """The exit code of `station check`."""
    with pytest.raises(SystemExit) as ended:
        main(["check", *arguments])
    return ended.value.code


def order_of(capsys: pytest.CaptureFixture[str], *more: str) -> dict[str, Any]:
    """What the check says of the shipped six faces' one run."""
    assert checked("six-point", "--order", "--json", *more) == 0
    document = json.loads(capsys.readouterr().out)["order"]
    (run,) = document["runs"]
    return {"moving_times": document["moving_times"], **run}


def test_the_order_is_yaml_to_paste_and_faster(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    found = order_of(capsys)
    assert found["fastest_s"] < 0.7 * found["moves_s"]
    pasted = [yaml.safe_load(text) for text in found["yaml"]]
    recipe = load_recipe(fixture_run.recipe(tmp_path, positions=pasted))
    assert [p.name for p in recipe.positions] == found["positions"]
    again = load_recipe(fixture_run.recipe(tmp_path, runs=[{"order": "fastest"}]))
    assert [p.name for p in plan.order_of(again, 0)] == found["positions"]


def test_the_positioner_of_a_config_tells_its_own_times(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    usual = order_of(capsys)
    slow = {"kind": "simulated", "speed_deg_s": 9, "acceleration_deg_s2": 1.8}
    found = order_of(capsys, "--config", str(fixture_run.config(tmp_path, positioner=slow)))
    assert found["fastest_s"] == pytest.approx(10 * usual["fastest_s"], rel=1e-6)
    assert str(tmp_path) in str(found["moving_times"])


@pytest.mark.parametrize(
    ("arguments", "printed"),
    [
        (["six-point", "--order", "--design", "6"], "use one at a time"),
        (["hand-held", "--order"], "--order needs known poses"),
    ],
)
def test_what_cannot_be_ordered_is_refused(
    capsys: pytest.CaptureFixture[str], arguments: list[str], printed: str
) -> None:
    assert checked(*arguments) == 2
    assert printed in capsys.readouterr().err


def test_a_run_goes_the_fastest_way_and_takes_less_time(tmp_path: Path) -> None:
    took = {}
    for order in ("listed", "fastest"):
        (tmp_path / order).mkdir()
        recipe = fixture_run.recipe(tmp_path / order, runs=[{"order": order}])
        ran = fixture_run.run(tmp_path / order, recipe=recipe)
        assert ran.results["SN0001"].outcome is Outcome.PASS
        took[order] = ran.results["SN0001"].duration_s
        visits = [v["position"] for v in ran.life("SN0001")["visits"] if v["kind"] == "tumble"]
        assert visits == [p.name for p in plan.order_of(load_recipe(recipe), 0)]
    assert took["fastest"] < took["listed"] - 4
