"""What the charts remember is what counting anew comes to: units that come again, late ends, several questions."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.config.settings import load_settings
from station.ports.log_reader import Attempt, Query
from station.ports.store import AttemptStart
from station.service.line_statistics import gather_statistics
from station.web.app import create_app
from station.web.line_cache import DAY_NS, LineCache
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from tests.fakes import fixture_run

FIRST_DAY = 20_400
BEGIN = AttemptStart(
    serial="", station="bench-1", nest="A", node=17, recipe_name="six-point", recipe_version=1, recipe_hash="r",
    recipe_json='{"schema": "station.recipe/1"}', config_hash="c", software="1", operator="", started_ns=0,
)  # fmt: skip


def day(number: int, second: int) -> int:
    return (FIRST_DAY + number) * DAY_NS + second * 10**9


@pytest.mark.parametrize("seed", range(4))
def test_remembered_yields_are_those_counted_anew(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    memory, late = LineCache(), list[str]()
    whole = Query(since_ns=day(0, 0))
    with SqliteStore(tmp_path / "s.db") as store:
        for step in range(120):
            number = step // 20
            began = day(number, step)
            serial, nest = f"SN{rng.integers(40):02d}", "AB"[rng.integers(2)]
            attempt = store.begin(replace(BEGIN, serial=serial, nest=nest, started_ns=began))
            if rng.random() < 0.2:
                late.append(attempt)
            else:
                store.finish(attempt, str(rng.choice(["PASS", "PASS", "FAIL", "ERROR"])), began + 5)
            if late and rng.random() < 0.3:
                store.finish(late.pop(0), "INTERRUPTED", day(number, step + 1))
            if rng.random() < 0.4:
                with SqliteLogReader(tmp_path / "s.db") as log:
                    for requested in (whole, replace(whole, nest="A"), Query(since_ns=day(max(0, number - 2), 0))):
                        assert _table(memory.yields(log, requested)) == _table(log.yields(requested, "cell")), (
                            step,
                            requested,
                        )
    assert len(memory._days) == 2, "questions that differ in their span only share their days"


def _table(cells: Sequence[object]) -> list[str]:
    return sorted(map(repr, cells))


def test_a_day_that_is_over_is_not_counted_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    memory, counted = LineCache(), list[Query]()
    real = SqliteLogReader.yields

    def spy(self: SqliteLogReader, query: Query, by: str = "all") -> list[object]:
        counted.append(query)
        return real(self, query, by)  # type: ignore[return-value]

    monkeypatch.setattr(SqliteLogReader, "yields", spy)
    with SqliteStore(tmp_path / "s.db") as store, SqliteLogReader(tmp_path / "s.db") as log:

        def run(serial: str, number: int) -> None:
            attempt = store.begin(replace(BEGIN, serial=serial, started_ns=day(number, 1)))
            store.finish(attempt, "PASS", day(number, 2))

        def days() -> list[int]:
            counted.clear()
            memory.yields(log, Query(since_ns=day(0, 0)))
            return [(q.since_ns or 0) // DAY_NS - FIRST_DAY for q in counted]

        for number in range(4):
            run(f"SN{number}", number)
        assert days() == [0, 1, 2, 3]
        assert days() == []
        run("SN9", 3)
        assert days() == [3]
        run("SN1", 3)
        assert days() == [1, 3], "SN1 came again: its first attempt is its last no more"


def test_the_page_counts_before_anybody_asks(tmp_path: Path) -> None:
    fixture_run.run(tmp_path, ["SN0001"])
    job, _ = load_job("six-point")
    order = LaunchOptions(tmp_path / "station.db", "six-point", simulate=True)
    panel = Panel(load_settings(), job.recipe, order, tmp_path / "accounts.json")
    with TestClient(create_app(panel)):
        pass
    assert len(panel.memory._days) == 1
    empty = Panel(
        load_settings(), job.recipe, LaunchOptions(tmp_path / "none.db", "six-point"), tmp_path / "accounts.json"
    )
    with TestClient(create_app(empty)) as client:
        assert client.get("/health").status_code == 200, "no log yet is no reason not to serve"


def test_finished_attempts_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fixture_run.run(tmp_path, ["SN0001", "SN0002"])
    memory, read = LineCache(), list[str]()
    real = SqliteLogReader.attempt

    def attempt(log: SqliteLogReader, unit: Attempt) -> dict[str, Any]:
        read.append(unit.serial)
        return real(log, unit)

    monkeypatch.setattr(SqliteLogReader, "attempt", attempt)
    with SqliteLogReader(tmp_path / "station.db") as log:
        since = log.attempts(Query())[-1].started_ns // DAY_NS * DAY_NS
        first = gather_statistics(log, Query(since_ns=since), 50, memory)
        assert sorted(read) == ["SN0001", "SN0002"]
        assert (
            gather_statistics(log, Query(since_ns=since), 50, memory)
            == first
            == gather_statistics(log, Query(since_ns=since), 50)
        )
    assert len(read) == 2, "each once, for the first look; without memory they are read together"
