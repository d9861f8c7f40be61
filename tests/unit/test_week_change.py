"""What changed since last week: a shift in one nest is listed, chance is not, new facts are."""

import numpy as np

from station.messages import render
from station.ports.log_reader import Attempt
from station.reporting.line.statistics import AttemptValues
from station.reporting.line.week_change import Week, week_change
from tests.conftest import SEED


def week(
    rng: np.random.Generator, shift: float = 0.0, software: str = "1.0", failed: int = 0, units: int = 120
) -> Week:
    rows, values = [], []
    for i in range(units):
        nest, outcome = "AB"[i % 2], "FAIL" if i < failed else "PASS"
        rows.append(
            Attempt(
                i, f"a{i}", f"SN{i}", "bench", nest, 17, "L", "six-point", 1, "", "", software, "Ada", i, outcome, i
            )
        )
        known = {name: float(rng.normal(1, 0.004)) for name in ("gain x", "gain y", "gain z", "noise")}
        known["gain y"] += shift * (nest == "B")
        values.append(AttemptValues(f"SN{i}", f"bench/{nest}", i, outcome, known, {}, {}))
    return rows, values


def test_a_shift_in_one_nest_is_named_and_nothing_else() -> None:
    rng = np.random.default_rng(SEED)
    found = week_change(week(rng), week(rng, shift=0.004))
    assert found.compared == 8
    (line,) = map(render, found.messages)
    assert line.startswith("gain y, nest bench/B: mean ")


def test_chance_is_listed_in_less_than_its_family_level() -> None:
    """With the level at .01, 100 quiet pairs of weeks show one on average; more than 5 has a probability below 1e-3."""
    rng = np.random.default_rng(SEED)
    alarms = sum(bool(week_change(week(rng, units=40), week(rng, units=40)).messages) for _ in range(100))
    assert alarms <= 5


def test_yields_and_new_facts_are_said() -> None:
    rng = np.random.default_rng(SEED)
    said = [render(m) for m in week_change(week(rng), week(rng, software="1.1", failed=30)).messages]
    assert "Attempts that passed: 100.0 % → 75.0 %." in said
    assert "New software: 1.1." in said
    assert not any(m.id.startswith("week-new") for m in week_change(([], []), week(rng)).messages)
