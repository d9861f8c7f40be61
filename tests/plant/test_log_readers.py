"""One suite for both readers of the log-reader port: a plant that has a station's log answers as the log does."""

import io
import json
import re
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import psycopg
import pytest

from station.adapters.postgres.readers import grant
from station.adapters.postgres.retention import retire
from station.adapters.store.reader import SqliteLogReader
from station.cli.app import main
from station.domain.records.framepack import plain
from station.errors import LogError, UsageError
from station.ports.log_reader import LogReader, Query
from station.ports.store import WriteRecord
from station.service.line_statistics import gather_statistics
from station.service.recompute import recompute
from station.wiring.logs import open_log
from tests.fakes import logs
from tests.fakes.plant import FakePlant, FakeStation, Server

STARTED_NS = logs.begin().started_ns
DAY_NS = 86_400 * 10**9
QUERIES = (
    Query(),
    Query(serial="SN0001"),
    Query(serial_from="SN00"),
    Query(serial_from="SN%"),
    Query(lot="L8", nest="B"),
    Query(recipe_name="six-point", station="bench-1"),
    Query(recipe_hash="ab" * 32, operator="Ada"),
    Query(outcome="FAIL"),
    Query(firmware="1.0.0"),
    Query(firmware="1.0.0", lot="L8"),
    Query(firmware="2"),
    Query(since_ns=STARTED_NS + DAY_NS, until_ns=STARTED_NS + 3 * DAY_NS),
    Query(software="0.1.0", before=30),
)


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> FakeStation:
    """A log with repeats, failures, lots, days, an unfinished attempt and events of the station."""
    one = FakeStation("bench-1", tmp_path_factory.mktemp("log"))
    with one.store() as store:
        for number in range(12):
            changes = {"lot": f"L{7 + number % 2}", "nest": "AB"[number % 2]}
            day = STARTED_NS + number // 3 * DAY_NS
            outcome = "FAIL" if number % 5 == 0 else "PASS"
            logs.unit(store, f"SN{number % 8:04d}", outcome, started_ns=day, **changes)
        store.event("", "odd % text", {"what": "100 %", "unicode": "°C µg 校准"})
        attempt = store.begin(logs.begin("SN0099"))
        store.visit([attempt], [logs.visit(0, np.random.default_rng(1), "rejected")])
        store.write(attempt, WriteRecord(0x2101, 1, "gain", b"\0\1", b"\2", None, None))
    return one


@pytest.fixture(scope="module")
def module_plant(server: Server, station: FakeStation, tmp_path_factory: pytest.TempPathFactory) -> Iterator[FakePlant]:
    plant = FakePlant(server.database(), tmp_path_factory.mktemp("objects"))
    with plant.connections.one() as db:  # so small that these logs span several
        db.execute("UPDATE counter SET partition_records = 40")
    assert plant.take_all(station, 17).refusal is None
    yield plant
    plant.connections.close()


@pytest.fixture(params=["sqlite", "postgresql"])
def log(request: pytest.FixtureRequest, station: FakeStation, module_plant: FakePlant) -> Iterator[LogReader]:
    with SqliteLogReader(station.path) if request.param == "sqlite" else module_plant.reader() as reader:
        yield reader


@pytest.fixture
def both(station: FakeStation, module_plant: FakePlant) -> Iterator[tuple[LogReader, LogReader]]:
    with SqliteLogReader(station.path) as own, module_plant.reader() as plants:
        yield own, plants


def test_attempts_come_newest_first_with_their_ends(log: LogReader) -> None:
    found = log.attempts(Query())
    assert [a.number for a in found] == sorted((a.number for a in found), reverse=True)
    assert [(a.serial, a.outcome) for a in found[:2]] == [("SN0099", None), ("SN0003", "PASS")]
    assert log.attempts(Query(), 3) == found[:3]
    assert log.count(Query(outcome="FAIL")) == 3
    assert {a.serial for a in log.attempts(Query(lot="L8"))} == {f"SN{n:04d}" for n in (1, 3, 5, 7)}
    assert [a.serial for a in log.attempts(Query(before=found[0].number), 1)] == ["SN0003"]


def test_calibrations_of_a_recipe_are_the_same_in_both(both: tuple[LogReader, LogReader]) -> None:
    own, plants = both
    recipe = own.attempts(Query(outcome="PASS"))[0].recipe_hash
    found = own.calibrations(recipe, 5)
    assert found and [c.started_ns for c in found] == sorted(c.started_ns for c in found)
    there = plants.calibrations(recipe, 5)
    assert [replace(c, fit="") for c in there] == [replace(c, fit="") for c in found]
    assert [json.loads(c.fit) for c in there] == [json.loads(c.fit) for c in found]
    assert own.calibrations("none", 5) == list(plants.calibrations("none", 5)) == []


def test_yields_count_units_by_their_first_and_last_attempt(log: LogReader) -> None:
    (whole,) = log.yields(Query())
    assert (whole.attempts, whole.passed, whole.failed, whole.units, whole.final) == (12, 9, 3, 8, 8)
    assert (whole.first_pass, whole.final_pass) == (6, 6)
    assert whole.mean_duration_s == pytest.approx(28.0, abs=1e-12)
    with pytest.raises(UsageError):
        log.yields(Query(), "weather")


def test_counts_kept_at_arrival_are_those_of_all_attempts(module_plant: FakePlant) -> None:
    """`before` makes the plant count every attempt anew."""
    days = Query(since_ns=STARTED_NS, until_ns=STARTED_NS + 2 * DAY_NS)
    with module_plant.reader() as log:
        for query in (Query(), Query(station="bench-1", nest="A"), days, Query(until_ns=STARTED_NS)):
            for by in ("all", "station", "nest", "recipe", "day", "cell"):
                assert log.yields(query, by) == log.yields(replace(query, before=1 << 60), by), (query, by)


def test_an_unfinished_attempt_shows_what_was_written(log: LogReader) -> None:
    (one,) = log.running()
    assert (one.serial, one.visits, one.writes[0].written, one.writes[0].read_back) == ("SN0099", 1, b"\2", None)


def test_frames_come_back_bit_for_bit(log: LogReader) -> None:
    newest = log.attempts(Query(outcome="PASS"), 1)[0]
    rng = np.random.default_rng(7)
    expected = [plain.to_bytes(logs.visit(n, rng).frames) for n in range(2)]
    assert [plain.to_bytes(f) for f in log.frames(newest)] == expected


def test_both_give_the_same_answer_to_every_question(both: tuple[LogReader, LogReader]) -> None:
    own, plants = both
    assert own.head() == plants.head()
    for query in QUERIES:
        assert own.attempts(query) == plants.attempts(query), query
        assert own.count(query) == plants.count(query), query
        assert own.life(query, 4) == plants.life(query, 4), query
        for by in ("all", "station", "nest", "recipe", "lot", "operator", "day", "cell"):
            assert own.yields(query, by) == plants.yields(query, by), (query, by)
    attempts = own.attempts(Query())
    assert own.lives(attempts) == plants.lives(attempts) == [own.attempt(a) for a in attempts]
    numbers = [a.number for a in attempts]
    assert [replace(r, before=json.loads(r.before)) for r in own.reduced(numbers)] == [
        replace(r, before=json.loads(r.before)) for r in plants.reduced(numbers)
    ]
    for attempt in attempts:
        assert own.recipe_and_product(attempt) == plants.recipe_and_product(attempt)
    assert own.running() == plants.running()
    for after in (0, 5, 60, 10_000):
        assert own.events(after, 20) == plants.events(after, 20)
        assert own.changes(after, 20) == plants.changes(after, 20)
        assert own.changed_days(after) == plants.changed_days(after)
    assert own.recent(5, 10) == plants.recent(5, 10)
    product = own.reduced(numbers)[0].product if own.reduced(numbers) else None
    assert product is None or own.document(product) == plants.document(product)
    assert own.acknowledgements() == plants.acknowledgements()
    assert list(own.findings()) == list(plants.findings()) == []


def command(*words: str | Path) -> str:
    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(io.StringIO()), pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    assert ended.value.code in (0, None), words
    return out.getvalue()


def test_audit_certificate_charts_and_recompute_are_those_of_the_station(
    server: Server, real_log: FakeStation, tmp_path: Path
) -> None:
    plant = FakePlant(server.database(), tmp_path / "objects")
    assert plant.take_all(real_log).refusal is None
    config, answers = real_log.folder / "config.yaml", dict[str, list[str]]()
    for db in (str(real_log.path), plant.address):
        files = [tmp_path / "c.json", tmp_path / "results.csv", tmp_path / "charts.html"]
        life = command("audit", "SN0001", "--json", "--db", db)
        found = command("audit", "--nest", "B", "--json", "--db", db)
        same = command("audit", "SN0001", "--recompute", "--json", "--db", db)
        command("certificate", "SN0001", "--json", files[0], "--db", db, "--config", config)
        command("export", "--results", files[1], "--db", db)
        report = command("report", "--json", "--db", db)
        certificate = json.loads(files[0].read_text())
        answers[db] = [
            *(strip(text) for text in (life, found, same, report)),
            files[1].read_text(),
            json.dumps(certificate["coefficients"]),
        ]
    own, plants = answers.values()
    assert own == plants
    assert '"identical": true' in own[2] or '"differences": []' in own[2]
    with plant.reader() as log, SqliteLogReader(real_log.path) as station_log:
        assert gather_statistics(log, Query(), 50) == gather_statistics(station_log, Query(), 50)
        assert all(recompute(log, attempt).identical for attempt in log.attempts(Query()))
    plant.connections.close()


def strip(text: str) -> str:
    """Without the place of the log."""
    return re.sub(r'"log": "[^"]*"', "", text)


def test_a_person_sees_her_stations_and_products_alone_whatever_she_asks_with(
    plant: FakePlant, new_station: Callable[..., FakeStation], tmp_path: Path
) -> None:
    plant.take_all(new_station("bench-1", 2))
    plant.take_all(new_station("bench-2", 3))
    other = FakeStation("bench-3", tmp_path)
    with other.store() as store:
        logs.unit(store, "MAG1", station="bench-3", product_json='{"product":{"name":"magnetometer"}}')
    plant.take_all(other)
    grant(plant.connections, "anna", ["bench-2"], [])
    grant(plant.connections, "boris", [], ["magnetometer"])
    grant(plant.connections, "chen", [], [])
    expected = {"anna": {"bench-2"}, "boris": {"bench-3"}, "chen": {"bench-1", "bench-2", "bench-3"}}
    for name, stations in expected.items():
        with open_log(plant.address.replace("postgres:@", f"{name}:@")) as log:
            attempts = log.attempts(Query())
            assert {a.station for a in attempts} == stations
            assert {y.group for y in log.yields(Query(), "station")} == stations
            assert all(log.attempt(a)["visits"] and log.frames(a) for a in attempts)
            assert len([c for c in log.changes(0, 1000) if c.what == "finish"]) == len(attempts)
            assert log.recipe_and_product(attempts[0])[1]
    with psycopg.connect(plant.address.replace("postgres:@", "anna:@"), autocommit=True) as db:
        assert db.execute("SELECT DISTINCT log.station FROM visit JOIN log ON log.id = visit.log").fetchall() == [
            ("bench-2",)
        ]
        for forbidden in ("SELECT * FROM grants", "DELETE FROM attempt", "SELECT * FROM visit_1", "TABLE quarantine"):
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                db.execute(forbidden.encode())
    grant(plant.connections, "anna", ["bench-1"], ["magnetometer"])
    with open_log(plant.address.replace("postgres:@", "anna:@")) as log:
        assert log.attempts(Query()) == []


def test_frames_are_retired_by_outcome_and_age_and_the_chain_stays_whole(plant: FakePlant, tmp_path: Path) -> None:
    station = FakeStation("bench-1", tmp_path)
    rng = np.random.default_rng(2)
    with station.store() as store:
        for number, outcome in enumerate(("PASS", "FAIL", "PASS")):
            attempt = store.begin(logs.begin(f"SN{number}", started_ns=STARTED_NS))
            store.visit([attempt], [logs.visit(0, rng)])
            store.finish(attempt, outcome, STARTED_NS + number * 10 * DAY_NS)
            store.tidy()
    plant.take_all(station)
    objects = plant.store._objects
    assert retire(plant.connections, objects, (5.0, None), STARTED_NS + 21 * DAY_NS)[0] == 1
    assert retire(plant.connections, objects, (5.0, None), STARTED_NS + 21 * DAY_NS)[0] == 0
    with plant.reader() as log:
        assert list(log.findings()) == []
        for found in log.attempts(Query()):
            if found.serial == "SN0":
                with pytest.raises(LogError, match="they were retired"):
                    log.frames(found)
            else:
                assert len(log.frames(found)) == 1
        assert asdict(log.head())["number"] == len(station.records())
