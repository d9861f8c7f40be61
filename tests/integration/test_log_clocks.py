"""Since when a unit is clamped and powered stands in the log, so that creep and warm-up can be told from it."""

from pathlib import Path

import numpy as np
import yaml

from station.adapters.store.reader import SqliteLogReader
from station.config.search_path import shipped_folder
from station.domain.core.types import SampleTable
from station.ports.log_reader import Query
from station.service import stored_attempts
from tests.fakes import fixture_run


def turned(folder: Path) -> Path:
    """Six faces, then warmed up for a minute, turned, and six faces again."""
    text = (shipped_folder() / "recipes" / "six-point.yaml").read_text(encoding="utf-8")
    recipe = yaml.safe_load(text)
    recipe["name"] = "turned"
    recipe["seatings"] = {"turned": {"axis": [0, 0, 1], "angle_deg": 180}}
    recipe["runs"] = [{"seating": "home"}, {"seating": "turned", "prewarm_s": 60}]
    path = folder / "turned.yaml"
    path.write_text(yaml.safe_dump(recipe), encoding="utf-8")
    return path


def tables(folder: Path) -> list[SampleTable]:
    with SqliteLogReader(folder / "station.db") as log:
        return list(stored_attempts.samples(log, log.attempts(Query())))


def test_clamping_starts_anew_with_the_seating_and_power_goes_on(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, units=2, recipe=str(turned(tmp_path)))
    assert all(r.outcome == "PASS" for r in ran.results.values())
    for table in tables(tmp_path):
        clamp, power = table.values["since_clamp_s"], table.values["since_power_s"]
        first, second = table.run == 0, table.run == 1
        assert 0 < clamp[first].min() < 10
        np.testing.assert_allclose(clamp[first], power[first])
        # Turned, then a minute of warming up before the first stop.
        assert 60 < clamp[second].min() < 70
        assert power[second].min() > clamp[first].max() + 60
        np.testing.assert_allclose(np.diff(power), np.diff(table.time_s + table.values["started_s"]), atol=1e-6)
