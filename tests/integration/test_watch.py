"""`station watch` over a log: the nest that tilts, since when, which units, and silence once it is put right."""

import json
from pathlib import Path
from typing import Any

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.cli.app import main
from station.ports.log_reader import Attempt, Query
from station.service.watch import Watch
from tests.fakes import logs, watched_log

Out = pytest.CaptureFixture[str]
SEED, BEGIN, RIGHTED, LAST = 5, 81, 101, 120


def tilted(load: int, nest: str) -> tuple[float, float, float]:
    """Nest B stands askew by 2 mrad about its x from load 81 to load 100."""
    return (2e-3 if nest == "B" and BEGIN <= load < RIGHTED else 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("watch")
    watched_log.write(made / "quiet.db", range(1, 61), lambda load, nest: (0.0, 0.0, 0.0), SEED)
    watched_log.write(made / "worn.db", range(1, RIGHTED), tilted, SEED)
    return made


def watch(capsys: Out, *args: str, code: int) -> Any:
    with pytest.raises(SystemExit) as ended:
        main(["watch", *args])
    shown = capsys.readouterr()
    assert ended.value.code == code, shown.err
    return shown


def test_a_quiet_line_is_silent(folder: Path, capsys: Out) -> None:
    shown = watch(capsys, "--db", str(folder / "quiet.db"), "--json", code=0)
    assert shown.out == ""
    assert "Nothing begins to go wrong in 60 loads." in shown.err


def test_a_tilted_nest_is_named_with_its_beginning_size_and_units(folder: Path, capsys: Out) -> None:
    shown = watch(capsys, "--db", str(folder / "worn.db"), "--json", code=1)
    (alert,) = [json.loads(line) for line in shown.out.splitlines()]
    assert (alert["schema"], alert["effect"], alert["nest"]) == ("station.watch/1", "nest-tilt", "B")
    assert abs(alert["begin"]["load"] - BEGIN) <= 2
    assert alert["ended"] is None
    # About x the part turns by 2 mrad; the units' own matrices scatter: 4 of the stated deviations, one in 16,000.
    assert abs(alert["size"]["vector"][0] - 2e-3) < 4 * alert["size"]["std"]
    assert alert["units"] == RIGHTED - alert["begin"]["load"]
    assert set(alert["serials"]) == {f"B{n:05d}" for n in range(alert["begin"]["load"], RIGHTED)}
    text = watch(capsys, "--db", str(folder / "worn.db"), code=1).out
    assert "Nest B of bench-1 tilts by" in text
    assert "station contain --station bench-1 --nest B --since" in text


def test_since_leaves_out_what_was_put_right_before_and_nothing_else(tmp_path: Path, capsys: Out) -> None:
    path = tmp_path / "station.db"
    watched_log.write(path, range(1, RIGHTED), tilted, SEED)
    assert "Nest B" in watch(capsys, "--db", str(path), "--since", "2030-01-01", code=1).out
    watched_log.write(path, range(RIGHTED, LAST + 1), tilted, SEED)
    assert "Put right with load" in watch(capsys, "--db", str(path), code=1).out
    assert watch(capsys, "--db", str(path), "--since", "2030-01-01", code=0).out == ""


def test_the_containment_command_lists_the_same_units(folder: Path, capsys: Out) -> None:
    db = str(folder / "worn.db")
    (alert,) = [json.loads(line) for line in watch(capsys, "--db", db, "--json", code=1).out.splitlines()]
    words = alert["containment"].split()
    with pytest.raises(SystemExit):
        main([*words[1:], "--db", db, "--json"])
    assert [u["serial"] for u in json.loads(capsys.readouterr().out)["units"]] == alert["serials"]


def test_new_loads_are_read_as_they_come_and_the_alert_ends_when_it_is_put_right(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "station.db"
    watched_log.write(path, range(1, BEGIN), tilted, SEED)
    with SqliteLogReader(path) as log:
        watched = Watch(log, 1000)
        assert watched.read() == []
        watched_log.write(path, range(BEGIN, RIGHTED), tilted, SEED)
        (raised,) = watched.read()
        assert raised.alert.place.nest == "B"
        watched_log.write(path, range(RIGHTED, LAST + 1), tilted, SEED)
        assert watched.read() == []
        (ended,) = watched.findings()
        assert ended.alert.ended is not None
        assert abs(ended.alert.ended - RIGHTED) <= 2


def test_a_load_that_still_runs_is_waited_for_at_its_own_station_only(tmp_path: Path) -> None:
    path, at = tmp_path / "station.db", watched_log.FIRST_NS + 2 * watched_log.STEP_NS
    watched_log.write(path, range(1, 2), tilted, SEED)
    watched_log.write(path, range(1, 5), tilted, SEED, "bench-2")
    with SqliteStore(path) as store, SqliteLogReader(path) as log:
        watched = Watch(log, 1000)
        running = store.begin(logs.begin("A00002", started_ns=at, recipe_json=""))
        watched.read()
        assert watched.loads == 5
        store.finish(running, "ABORTED", at + 1)
        watched.read()
        assert watched.loads == 6


def test_loads_after_a_clock_was_turned_back_are_read_in_the_order_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "station.db"
    watched_log.write(path, range(101, 104), tilted, SEED)
    with SqliteLogReader(path) as log:
        watched = Watch(log, 1000)
        watched.read()
        watched_log.write(path, range(1, 3), tilted, SEED)
        watched.read()
        assert watched.loads == 5


class CountingReader(SqliteLogReader):
    """Counts the attempts that it hands out."""

    handed = 0

    def attempts(self, query: Query, limit: int | None = None) -> list[Attempt]:
        found = super().attempts(query, limit)
        self.handed += len(found)
        return found


def test_what_a_look_for_new_loads_reads_does_not_grow_with_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though another station has been silent since before all of them, and one never finished its load."""
    monkeypatch.setattr("station.service.watch._PAGE", 8)
    path = tmp_path / "station.db"
    watched_log.write(path, range(1, 2), tilted, SEED, "bench-2")
    with SqliteStore(path) as store:
        at = watched_log.FIRST_NS + 2 * watched_log.STEP_NS
        store.begin(logs.begin("A00002", station="bench-3", started_ns=at, recipe_json=""))
    watched_log.write(path, range(3, 23), tilted, SEED)
    with CountingReader(path) as log:
        watched = Watch(log, 1000)
        watched.read()
        assert watched.loads == 21
        before = log.handed
        watched_log.write(path, range(23, 24), tilted, SEED)
        watched.read()
        assert watched.loads == 22
        # A page of eight, and the one that still runs.
        assert log.handed - before <= 9


def test_a_log_of_few_loads_says_that_the_watch_still_learns(tmp_path: Path, capsys: Out) -> None:
    watched_log.write(tmp_path / "new.db", range(1, 4), lambda load, nest: (0.0, 0.0, 0.0), SEED)
    shown = watch(capsys, "--db", str(tmp_path / "new.db"), code=0)
    assert "still learns: 3 loads in the log" in shown.err
