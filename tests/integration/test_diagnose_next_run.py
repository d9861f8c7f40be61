"""What is tied is told apart by the run that the diagnosis proposes: its recipe runs, and old and new runs together
name the cause alone."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from station.config.recipes import recipe_path
from tests.fakes.command import station
from tests.portion import portion

pytestmark = pytest.mark.timeout(300)


def once(folder: Path) -> str:
    """The 24 tilts, gone through once."""
    printed = yaml.safe_load(recipe_path("tilt-24").read_text(encoding="utf-8"))
    printed |= {"runs": [{"seating": "home"}], "seatings": {}}
    path = folder / "once.yaml"
    path.write_text(yaml.safe_dump(printed), encoding="utf-8")
    return str(path)


def diagnosed(recipe: str, samples: Path, *more: str) -> dict[str, Any]:
    shown = samples.with_suffix(".json")
    assert station("diagnose", "--recipe", recipe, "--samples", str(samples), "--json", str(shown), *more) == 1
    found: dict[str, Any] = json.loads(shown.read_text(encoding="utf-8"))
    return found


def members(document: dict[str, Any]) -> set[str]:
    """The cause found and those it is tied with."""
    (cause,) = document["causes"]
    return {cause["effect"], *cause["indistinguishable_from"]}


#: By effect: units in which it is hidden, what it is tied with, and what the proposed run changes.
TIES: dict[str, tuple[int, set[str], str]] = {
    "warm-up": (4, {"clamp-creep"}, "warmed up"),
    "offset-temperature=0.0005": (4, {"bias-drift", "warm-up", "clamp-creep"}, "slow"),
    "nest-tilt": (2, {"package-rotation"}, "one run once more in the next nest"),
    "base-tilt": (2, {"index-error"}, "one run with the rig turned 180° on its floor"),
    "filter-lag": (1, {"settling"}, "one run in the same nest with the device's filter off"),
}


@pytest.mark.parametrize("effect", portion(TIES))
def test_the_proposed_run_tells_it_apart(effect: str, tmp_path: Path) -> None:
    units, tied, change = TIES[effect]
    recipe, name = once(tmp_path), effect.partition("=")[0]
    nests = "1" if units == 1 else "4"
    requested = ("--units", str(units), "--nests", nests, "--seed", "5", "--effect", effect)
    old, new, following = (tmp_path / n for n in ("old.parquet", "new.parquet", "next.yaml"))
    assert station("simulate", "--recipe", recipe, *requested, "--out", str(old)) == 0
    before = diagnosed(recipe, old, "--next-run", str(following))
    assert members(before) >= {name, *tied}
    proposed = before["next_run"]
    assert change in proposed["recipe_change"]
    assert set(proposed["separates"]) >= {name, *tied}
    assert proposed["certainty"] > 0.8

    heading = "".join(line for line in following.read_text(encoding="utf-8").splitlines(True) if line[0] == "#")
    assert f"{proposed['minutes']:.1f} minutes more" in heading
    sure = re.search(r"a single cause is left: (\d+)%", heading)
    assert sure is not None
    assert float(sure[1]) == pytest.approx(100 * proposed["certainty"], abs=0.51)
    assert station("check", str(following)) == 0

    # Only the new run is measured; the old samples are kept.
    assert station("simulate", "--recipe", str(following), *requested, "--out", str(new)) == 0
    table = pd.read_parquet(new)
    both = tmp_path / "both.parquet"
    joined = pd.concat([pd.read_parquet(old), table[table["run"] > 0]])
    joined.sort_values(["unit", "run"], kind="stable").to_parquet(both)
    after = members(diagnosed(str(following), both))
    assert name in after
    assert not after & tied


def test_what_one_nest_cannot_tell_is_told_in_another(tmp_path: Path) -> None:
    """Of one unit in one nest errors of all positions look like a tilted nest whatever is done."""
    recipe, old, following = once(tmp_path), tmp_path / "old.parquet", tmp_path / "next.yaml"
    requested = ("--units", "1", "--seed", "5", "--effect", "package-rotation")
    assert station("simulate", "--recipe", recipe, *requested, "--out", str(old)) == 0
    before = diagnosed(recipe, old, "--next-run", str(following))
    tied = {"nest-tilt", "package-rotation", "index-error"}
    assert members(before) == tied == set(before["next_run"]["separates"])
    assert (
        before["next_run"]["recipe_change"] == "one run once more in another nest, then one run turned 180° in the seat"
    )
    assert before["next_run"]["certainty"] > 0.9
    assert "put each unit into another one" in following.read_text(encoding="utf-8")


def test_one_pose_of_one_unit_has_no_run_that_tells_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A sensor that warms towards a steady state in one pose: its temperature and the rate of it are one curve, and a
    run of one visit leaves nothing beside the offset."""
    rng, n, rows = np.random.default_rng(4), 40, 8
    seconds = np.repeat(30.0 * np.arange(n), rows) + np.tile(np.arange(rows) / 5, n)
    warm = 25 + 20 * (1 - np.exp(-seconds / 300))
    means = np.array([0.01, -0.02, 0.99]) + (warm - 25)[:, None] * [8e-5, -4e-5, 1e-4]
    table = pd.DataFrame(means + rng.normal(0, 2e-4, (n * rows, 3)), columns=["x", "y", "z"])
    table = table.assign(unit="SN0001", run=0, visit=np.repeat(np.arange(n), rows), position="z-up", time_s=seconds)
    samples = tmp_path / "warming.parquet"
    table.assign(temperature_degC=warm + rng.normal(0, 0.02, len(warm))).to_parquet(samples)
    following = tmp_path / "next.yaml"
    document = diagnosed("one-point", samples, "--next-run", str(following))
    assert "nothing is written" in capsys.readouterr().err
    assert not following.exists()
    assert {"offset-temperature", "temperature-rate"} <= members(document)
    assert document["next_run"]["separates"] == []
