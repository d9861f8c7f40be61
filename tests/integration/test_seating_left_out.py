"""A table may leave the seating out: each pass then sat as the recipe's run says (docs/formats.md, samples)."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from tests.fakes.command import captured


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Two units turned in their seats between the runs: with the column, without it, and without it unturned."""
    folder = tmp_path_factory.mktemp("seating")
    found = {name: folder / f"{name}.parquet" for name in ("with", "without", "unturned")}
    made = captured("simulate", "--recipe", "tilt-24", "--units", 2, "--seed", 4, "--out", found["with"])
    assert made.returncode == 0, made.stderr
    table = pd.read_parquet(found["with"])
    assert table["seating"].nunique() > 1
    table.drop(columns="seating").to_parquet(found["without"])
    home = table[table["run"] == 0]
    again = [home.assign(run=run) for run in range(table["run"].nunique())]
    pd.concat(again).sort_values(["unit", "run", "visit"], kind="stable").drop(columns="seating").to_parquet(
        found["unturned"]
    )
    return found


def shown(command: str, table: Path) -> dict[str, Any]:
    done = captured(command, "--recipe", "tilt-24", "--samples", table, "--json", "-")
    assert done.returncode in (0, 1), done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def test_calibrate_and_diagnose_say_the_same_without_the_column(tables: dict[str, Path]) -> None:
    for unit, same in zip(
        shown("calibrate", tables["with"])["units"], shown("calibrate", tables["without"])["units"], strict=True
    ):
        assert (unit["offset"], unit["matrix"]) == (same["offset"], same["matrix"])
    assert shown("diagnose", tables["without"])["verdict"] == shown("diagnose", tables["with"])["verdict"] == "none"


def test_what_was_never_turned_is_no_pass_under_a_recipe_that_turns_it(tables: dict[str, Path]) -> None:
    units = shown("calibrate", tables["unturned"])["units"]
    assert {unit["outcome"] for unit in units} == {"FAIL"}
