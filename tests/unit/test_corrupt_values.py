"""A samples table with one value of each column corrupt is the table as it was, and every column is said."""

from dataclasses import replace

import numpy as np
import pytest

from station.diagnosis.data.corrupt_values import repaired
from station.domain.core.types import SampleTable
from tests.fakes import tumble

ROW = 130


def whole(rng: np.random.Generator) -> SampleTable:
    recipe = tumble.recipe("six-point")
    made = tumble.table(recipe, tumble.truths(recipe)[None], 1e-3, 60, rng)
    n = np.arange(len(made), dtype=float)
    values = {
        "temperature_degC": np.full(len(n), 25.0),
        "since_power_s": made.time_s + 60,
        "since_clamp_s": made.time_s + 5,
        "motor": np.ones(len(n)),
        "started_s": np.full(len(n), 900.0),
        "counter": n % 256,
    }
    return replace(made, values=values, gold=np.array(made.reading))


def test_one_corrupt_value_of_each_column_changes_nothing_and_is_said(rng: np.random.Generator) -> None:
    recipe, table = tumble.recipe("six-point"), whole(rng)
    assert repaired(recipe, table) == (table, ())
    reading, gold, time_s = np.array(table.reading), np.array(table.gold), np.array(table.time_s)
    reading[ROW, 2], gold[ROW, 0], time_s[ROW] = 16.0, -16.0, 1e9
    values = {name: np.array(column) for name, column in table.values.items()}
    for name, value in {"temperature_degC": 85.0, "since_power_s": np.nan, "since_clamp_s": 1e9, "motor": 9.0}.items():
        values[name][ROW] = value
    values["started_s"][ROW], values["counter"][ROW] = 0.0, 77.0
    found, said = repaired(recipe, replace(table, reading=reading, gold=gold, time_s=time_s, values=values))
    assert [m.parameters.get("column", m.id) for m in said] == [
        "reading-outliers", "stamp-outliers", *table.values, "gold_x, gold_y, gold_z",
    ]  # fmt: skip
    assert {m.parameters["visit"] for m in said} == {int(table.visit[ROW])}
    assert found.time_s == pytest.approx(table.time_s)
    for name, column in table.values.items():
        assert found.values[name] == pytest.approx(column), name
    # A median of twelve neighbours and the reading itself, each by its noise of 1 mg: six deviations of both.
    assert found.reading == pytest.approx(table.reading, abs=7e-3)
    assert found.gold == pytest.approx(table.gold, abs=7e-3)


def test_what_nobody_can_know_stays_missing(rng: np.random.Generator) -> None:
    table = whole(rng)
    gaps = np.where(np.arange(len(table)) % 2 == 0, np.nan, 25.0)
    found, said = repaired(tumble.recipe("six-point"), replace(table, values={"temperature_degC": gaps}))
    assert said == ()
    np.testing.assert_array_equal(found.values["temperature_degC"], gaps)
