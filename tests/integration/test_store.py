"""The log keeps everything that docs/formats.md promises, and lets nothing be changed."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import uuid
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from station.adapters.store import ids
from station.adapters.store.log_anchors import Acknowledgement
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.domain.records.framepack import plain
from station.errors import LogError, StoreFault
from station.ports.log_reader import Query, Trust
from tests.fakes import logs


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "station.db"


def whole(path: Path) -> bool:
    with SqliteLogReader(path) as log:
        return list(log.findings(Trust())) == []


def test_everything_that_was_kept_comes_back(path: Path) -> None:
    rng = np.random.default_rng(7)
    with SqliteStore(path, epoch_ns=lambda: 42) as store:
        attempt = logs.unit(store)
        store.event(attempt, "label-printed", {"by": b"\x01\xff", "at": np.float64(1.5)})
    with SqliteLogReader(path) as log:
        (life,) = log.life(Query(serial="SN1"))
        (row,) = log.attempts(Query())
        raw = log.frames(row)
        assert log.recipe_and_product(row) == ('{"name":"six-point"}', '{"name":"accelerometer"}')
    shown = asdict(logs.begin())
    assert {k: life[k] for k in shown if not k.endswith("_json")} == {
        k: v for k, v in shown.items() if not k.endswith("_json")
    }
    assert (life["attempt"], life["outcome"], life["ended_ns"]) == (attempt, "PASS", shown["started_ns"] + 28 * 10**9)
    expected = [logs.visit(n, rng) for n in range(2)]
    assert [plain.to_bytes(f) for f in raw] == [plain.to_bytes(v.frames) for v in expected]
    assert [v["statistics"]["mean"] for v in life["visits"]] == [v.statistics["mean"].tolist() for v in expected]
    assert [v["frames_sha256"] for v in life["visits"]] == [plain.digest(plain.to_bytes(f)) for f in raw]
    assert [(w["object"], w["stage"], w["old"], w["written"], w["read_back"]) for w in life["writes"]] == [
        ("2101:01", "intent", "0000803f", "0100803f", None),
        ("2101:01", "verified", "0000803f", "0100803f", "0100803f"),
    ]
    assert life["writes"][0]["value"] == 1.0000001
    assert [r["name"] for r in life["results"]] == ["identity", "calibration", "verdict"]
    assert life["results"][1]["document"] == {"offset": [0.1, None, -0.0], "outcome": "PASS"}
    assert [(e["kind"], e["at_ns"], e["detail"]) for e in life["events"]] == [
        ("label-printed", 42, {"at": 1.5, "by": "01ff"})
    ]
    assert whole(path)


def test_plain_frames_of_an_earlier_log_are_checked_and_packed_as_they_were_sealed(path: Path) -> None:
    shown = logs.visit(0, np.random.default_rng(3))
    by_columns = plain.to_bytes(shown.frames, plain.COLUMNS)
    earlier = replace(shown, encoded=plain.PlainFrames(by_columns, plain.digest(by_columns), len(shown.frames)))
    with SqliteStore(path) as store:
        attempt = store.begin(logs.begin())
        store.visit([attempt], [earlier])
        store.visit([attempt], [logs.visit(1, np.random.default_rng(4))])
        assert whole(path)
        store.finish(attempt, "PASS", 5)
        store.tidy()
    with SqliteLogReader(path) as log:
        assert log.db.execute("SELECT (SELECT count(*) FROM frames), (SELECT count(*) FROM archive)").fetchone() == (
            0,
            1,
        )
        (row,) = log.attempts(Query())
        raw, (life,) = log.frames(row), log.life(Query())
    assert [plain.digest_matches(f, v["frames_sha256"]) for f, v in zip(raw, life["visits"], strict=True)] == [
        True,
        True,
    ]
    assert life["visits"][0]["frames_sha256"] == plain.digest(by_columns)
    assert whole(path)


def test_each_call_is_there_for_others_as_soon_as_it_returns(path: Path) -> None:
    rng = np.random.default_rng(1)
    with SqliteStore(path) as store, SqliteLogReader(path) as log:
        attempt = store.begin(logs.begin())
        assert [u.attempt for u in log.running()] == [attempt]
        store.visit([attempt], [logs.visit(0, rng)])
        assert log.running()[0].visits == 1
        store.event(attempt, "paused", {})
        store.event("", "log-in", {"name": "Ada"})
        events = log.events()
        assert [(e.attempt, e.kind) for e in events] == [(attempt, "paused"), ("", "log-in")]
        assert log.events(after=events[0].number) == events[1:]
        store.finish(attempt, "ABORTED", 1)
        assert log.running() == []
        assert [a.outcome for a in log.attempts(Query())] == ["ABORTED"]
        assert log.head() == store.head()


def test_a_running_attempt_has_its_frames_and_a_finished_one_the_same_packed(path: Path) -> None:
    rng = np.random.default_rng(3)
    made = logs.visit(0, rng)
    with SqliteStore(path) as store, SqliteLogReader(path) as log:
        attempt = store.begin(logs.begin())
        store.visit([attempt], [made])
        (row,) = log.attempts(Query())
        before = log.frames(row)
        store.finish(attempt, "PASS", 1)
        store.tidy()
        after = log.frames(row)
        (plain_left,) = log.db.execute("SELECT count(*) FROM frames").fetchone()
    assert [plain.to_bytes(f) for f in before] == [plain.to_bytes(f) for f in after] == [plain.to_bytes(made.frames)]
    assert plain_left == 0


def test_frames_that_a_crash_left_plain_are_packed_at_the_next_opening(path: Path) -> None:
    with SqliteStore(path) as store:
        attempt = store.begin(logs.begin())
        store.visit([attempt], [logs.visit(0, np.random.default_rng(3))])
    with SqliteStore(path) as store:
        assert [u.visits for u in store.unfinished()] == [1]
        store.finish(attempt, "INTERRUPTED", 1)
    SqliteStore(path).close()
    with SqliteLogReader(path) as log:
        left = [log.db.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in ("frames", "archive")]
    assert left == [0, 1]
    assert whole(path)


def test_nothing_but_events_follows_a_finish(path: Path) -> None:
    with SqliteStore(path) as store:
        attempt = logs.unit(store)
        calls: tuple[Callable[[], object], ...] = (
            lambda: store.result(attempt, "verdict", {"outcome": "PASS"}),
            lambda: store.finish(attempt, "PASS", 1),
            lambda: store.visit([attempt], [logs.visit(9, np.random.default_rng(1))]),
        )
        for call in calls:
            with pytest.raises(StoreFault, match="is not open in the log"):
                call()
        with pytest.raises(StoreFault, match="holds no attempt nobody"):
            store.event("nobody", "x", {})
        store.event(attempt, "returned", {})
    assert whole(path)


@pytest.mark.parametrize("deed", ["UPDATE {t} SET hash = x'00'", "DELETE FROM {t}"])
@pytest.mark.parametrize("table", ["document", "attempt", "event", "visit", "write", "result", "finish", "archive"])
def test_the_database_itself_refuses_to_change_evidence(path: Path, table: str, deed: str) -> None:
    with SqliteStore(path) as store:
        attempt = logs.unit(store)
        store.event(attempt, "x", {})
    db = sqlite3.connect(path)
    with pytest.raises(sqlite3.IntegrityError, match=f"append-only: {table} refuses"):
        db.execute(deed.format(t=f'"{table}"'))
    db.close()


def test_raw_frames_stay_until_they_are_packed(path: Path) -> None:
    with SqliteStore(path) as store:
        attempt = store.begin(logs.begin())
        store.visit([attempt], [logs.visit(0, np.random.default_rng(3))])
    db = sqlite3.connect(path)
    with pytest.raises(sqlite3.IntegrityError, match="stay until they are packed"):
        db.execute("DELETE FROM frames")
    db.close()


def test_recipe_and_product_are_kept_once(path: Path) -> None:
    with SqliteStore(path) as store:
        for number in range(3):
            logs.unit(store, f"SN{number}")
    with SqliteLogReader(path) as log:
        assert log.db.execute("SELECT count(*) FROM document").fetchone() == (2,)


HOSTILE = ["'; DROP TABLE attempt; --", "a\nb\tc\x00d", "\u202eSN1", "../../etc/passwd", "\udcff broken", "x" * 100_000]


@pytest.mark.parametrize("serial", HOSTILE)
def test_any_text_is_kept_as_text(path: Path, serial: str) -> None:
    with SqliteStore(path) as store:
        attempt = store.begin(logs.begin(serial, operator=serial, lot=serial))
        store.event(attempt, serial, {serial: serial})
        store.result(attempt, serial, {"x": [serial]})
        store.finish(attempt, "ABORTED", 1)
    stored = serial.encode("utf-8", "backslashreplace").decode()
    with SqliteLogReader(path) as log:
        (life,) = log.life(Query(serial=stored))
    assert life["serial"] == life["operator"] == life["lot"] == life["events"][0]["kind"] == stored
    assert life["events"][0]["detail"] == {stored: stored}
    assert whole(path)


def test_a_number_beyond_64_bits_is_a_sentence_and_leaves_nothing_behind(path: Path) -> None:
    with SqliteStore(path) as store:
        with pytest.raises(StoreFault, match="more than 64 bits"):
            store.begin(logs.begin(started_ns=2**70))
        before = store.head()
        logs.unit(store)
        assert before.number == 0
    assert whole(path)


def test_attempt_ids_are_uuids_of_version_7_in_the_order_of_time() -> None:
    made = [ids.uuid7(1_767_225_600_000_000_000 + 300_000 * n) for n in range(50)]
    assert made == sorted(made)
    assert {uuid.UUID(i).version for i in made} == {7}
    assert {uuid.UUID(i).variant for i in made} == {uuid.RFC_4122}
    assert len({ids.uuid7(5) for _ in range(1000)}) == 1000, "two nests in the same millisecond"
    assert uuid.UUID(made[0]).int >> 80 == 1_767_225_600_000


def test_a_clock_that_steps_back_changes_no_order(path: Path) -> None:
    times = iter([100, 50, 10, 200, 1, 2, 3, 4, 5])
    with SqliteStore(path, epoch_ns=lambda: next(times)) as store:
        attempt = store.begin(logs.begin())
        for kind in "abc":
            store.event(attempt, kind, {})
    with SqliteLogReader(path) as log:
        assert [e.kind for e in log.events()] == ["a", "b", "c"]
    assert whole(path)


def test_threads_may_share_a_store(path: Path) -> None:
    with SqliteStore(path) as store:
        attempts = [store.begin(logs.begin(f"SN{n}")) for n in range(4)]

        def tick(attempt: str) -> None:
            for n in range(25):
                store.event(attempt, "tick", {"n": n})

        threads = [threading.Thread(target=tick, args=(attempt,)) for attempt in attempts]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
    with SqliteLogReader(path) as log:
        lives = [log.life(Query(serial=f"SN{n}"))[0] for n in range(4)]
    assert [[e["detail"]["n"] for e in life["events"]] for life in lives] == [list(range(25))] * 4
    assert whole(path)


def test_a_record_of_another_thread_between_a_finish_and_its_reading_back_hurts_neither(path: Path) -> None:
    """The other thread's record comes at the worst instant: when the finish is committed and not yet read back."""
    store = SqliteStore(path)
    read_back = store._read_back

    def late(number: int, seal: bytes) -> None:
        other = threading.Thread(target=store.event, args=("", "tick", {}))
        other.start()
        other.join()
        read_back(number, seal)

    store._read_back = late  # type: ignore[method-assign]
    with store:
        store.finish(store.begin(logs.begin()), "PASS", 1)
    assert whole(path)


def test_a_half_written_unit_is_recognised_under_any_spelling_of_its_number(path: Path) -> None:
    with SqliteStore(path) as store:
        attempt = store.begin(logs.begin("SN0042"))
        store.result(attempt, "write-plan", {"objects": {"2101:01": "00"}})
        store.finish(attempt, "INTERRUPTED", 1)
        for serial in ("SN0042", "SN00042", "SN42"):
            found = store.suspect(serial)
            assert found is not None and found.attempt == attempt, serial
        assert [store.suspect(serial) for serial in ("SN0420", "SN0043", "S0042")] == [None] * 3


OWN = """
import sys, time
from pathlib import Path
from station.adapters.store.sqlite import SqliteStore
sys.path.insert(0, {root!r})
from tests.fakes import logs
store = SqliteStore(Path(sys.argv[1]), owner="bench-1")
attempt = store.begin(logs.begin())
while True:
    store.event(attempt, "tick", {{}})
    print(store.head().number, flush=True)
"""


def test_a_second_process_is_refused_by_name_and_a_killed_one_blocks_nobody(path: Path) -> None:
    root = str(Path(__file__).parents[2])
    command = [sys.executable, "-c", OWN.format(root=root), str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=root) as other:
        assert other.stdout is not None
        acknowledged = int(other.stdout.readline())
        with pytest.raises(StoreFault, match=rf"in use by bench-1 \(pid {other.pid}\) since 20\d\d-"):
            SqliteStore(path)
        for _ in range(50):
            acknowledged = int(other.stdout.readline())
        os.kill(other.pid, signal.SIGKILL)
        acknowledged = max([acknowledged, *(int(line) for line in other.stdout if line.endswith("\n"))])
    with SqliteStore(path) as store:
        assert store.head().number >= acknowledged, "what was acknowledged is there"
        (left,) = store.unfinished()
        assert (left.serial, left.last_event) == ("SN1", "tick")
        store.finish(left.attempt, "INTERRUPTED", 1)
    assert whole(path)


def test_the_same_process_cannot_own_a_log_twice_and_closing_frees_it(path: Path) -> None:
    store = SqliteStore(path, owner="first")
    with pytest.raises(StoreFault, match="in use by first"):
        SqliteStore(path)
    store.close()
    store.close()
    SqliteStore(path).close()


def test_containment_by_every_question(path: Path) -> None:
    hour = 3_600_000_000_000
    with SqliteStore(path) as store:
        logs.unit(store, "SN1", started_ns=hour)
        logs.unit(store, "SN2", "FAIL", started_ns=2 * hour, nest="B")
        logs.unit(store, "SN2", started_ns=3 * hour, nest="B", recipe_name="tilt-24", recipe_hash="ee" * 32)
        logs.unit(store, "XX3", started_ns=4 * hour, station="bench-2", operator="Bo", lot="L8", software="0.2.0")
    with SqliteLogReader(path) as log:

        def serials(**requested: object) -> list[str]:
            return [a.serial for a in log.attempts(Query(**requested))]  # type: ignore[arg-type]

        assert serials() == ["XX3", "SN2", "SN2", "SN1"]
        assert serials(recipe_name="six-point", nest="A", since_ns=hour, until_ns=4 * hour) == ["SN1"]
        assert serials(recipe_hash="ee" * 32) == serials(recipe_name="tilt-24") == ["SN2"]
        assert serials(station="bench-2") == serials(operator="Bo") == serials(lot="L8") == ["XX3"]
        assert serials(software="0.2.0") == ["XX3"]
        assert serials(outcome="FAIL") == ["SN2"]
        assert serials(serial_from="SN") == ["SN2", "SN2", "SN1"]
        assert serials(firmware="1.0.0", nest="B") == ["SN2", "SN2"]
        assert serials(firmware="9") == []
        assert log.count(Query(nest="B")) == 2
        first_page = log.attempts(Query(), limit=2)
        assert [a.serial for a in log.attempts(Query(before=first_page[-1].number))] == ["SN2", "SN1"]


def test_yield_counts_every_attempt_and_fail_pass_pass_is_no_first_pass(path: Path) -> None:
    with SqliteStore(path) as store:
        for outcome in ("FAIL", "PASS", "PASS"):
            logs.unit(store, "SN1", outcome)
        logs.unit(store, "SN2", "PASS", nest="B")
        logs.unit(store, "SN3", "ERROR", nest="B")
    with SqliteLogReader(path) as log:
        (all_units,) = log.yields(Query())
        by_nest = {y.group: y for y in log.yields(Query(), "nest")}
        with pytest.raises(Exception, match="no yield by 'colour'"):
            log.yields(Query(), "colour")
    assert (all_units.attempts, all_units.passed, all_units.failed, all_units.errors) == (5, 3, 1, 1)
    assert (all_units.units, all_units.first_pass, all_units.final, all_units.final_pass) == (3, 1, 3, 2)
    assert by_nest["bench-1/A"].first_pass_yield == 0
    assert by_nest["bench-1/A"].final_yield == 1
    assert by_nest["bench-1/B"].first_pass_yield == 0.5
    assert all_units.mean_duration_s == 28


def test_what_is_no_log_is_said_so(tmp_path: Path) -> None:
    other, empty, text = tmp_path / "other.db", tmp_path / "empty.db", tmp_path / "text.db"
    db = sqlite3.connect(other)
    db.execute("CREATE TABLE t (a)")
    db.close()
    empty.touch()
    text.write_text("not a database, but long enough to have a header of its own " * 50)
    for path, sentence in ((other, "not a station log"), (empty, "is empty"), (text, "not a station log")):
        with pytest.raises(LogError, match=sentence):
            SqliteLogReader(path)
    for path in (other, text):
        with pytest.raises(StoreFault, match="not a station log"):
            SqliteStore(path)
    with pytest.raises(LogError, match="There is no log"):
        SqliteLogReader(tmp_path / "none.db")
    with pytest.raises(StoreFault, match="its folder does not exist"):
        SqliteStore(tmp_path / "no" / "where.db")


def test_the_head_file_says_where_the_log_ends(path: Path) -> None:
    with SqliteStore(path) as store:
        logs.unit(store)
        head = store.head()
    printed = json.loads(path.with_name("station.db.head").read_text())
    assert (printed["number"], printed["hash"]) == (head.number, head.hash)


def test_a_log_whose_end_was_cut_off_is_not_gone_on_with(path: Path) -> None:
    with SqliteStore(path) as store:
        logs.unit(store)
        logs.unit(store, "SN2")
    with logs.unguarded(path) as db:
        db.execute("DELETE FROM archive WHERE seq > 12")
    with pytest.raises(StoreFault, match="its end was cut off"):
        SqliteStore(path)
    with pytest.raises(StoreFault, match="its end was cut off"):
        SqliteStore(path)


def test_a_lost_head_file_is_refused_until_somebody_takes_note(path: Path) -> None:
    with SqliteStore(path) as store:
        logs.unit(store)
    head = path.with_name("station.db.head")
    head.unlink()
    with SqliteLogReader(path) as log:
        assert [f.what for f in log.findings(Trust())] == ["unanchored"]
    for _ in range(2):
        with pytest.raises(StoreFault, match="is missing, although the log's head was kept there"):
            SqliteStore(path)
    with SqliteStore(path, acknowledgement=Acknowledgement("Ada", "the disk was full")):
        assert head.exists()
    with SqliteLogReader(path) as log:
        assert [e.kind for e in log.events()] == ["log-acknowledged"]
        (accepted,) = log.acknowledgements()
    assert (accepted["by"], accepted["reason"], [f["what"] for f in accepted["findings"]]) == (
        "Ada", "the disk was full", ["missing"]
    )  # fmt: skip
    assert whole(path)
    SqliteStore(path).close()


def test_whoever_follows_the_log_sees_every_record_once_and_in_order(path: Path) -> None:
    with SqliteStore(path) as store, SqliteLogReader(path) as log:
        attempt = logs.unit(store)
        store.event("", "log-in", {})
        observed = log.changes(limit=4)
        while more := log.changes(after=observed[-1].number, limit=4):
            observed += more
        store.event(attempt, "returned", {})
        assert [(c.what, c.detail) for c in log.changes(after=observed[-1].number)] == [("event", "returned")]
    shown = [(c.what, c.detail, c.attempt == attempt) for c in observed]
    assert shown[0] == ("attempt", "SN1", True)
    assert shown[2:4] == [("visit", "tumble p0", True), ("visit", "tumble p1", True)]
    assert shown[-3:] == [("result", "verdict", True), ("finish", "PASS", True), ("event", "log-in", False)]
    assert [c.number for c in observed] == sorted({c.number for c in observed})


def test_what_earlier_units_of_a_recipe_told_of_their_dwells_comes_oldest_first(path: Path) -> None:
    """The newest so many attempts of that recipe; one without a result `dwell` counts, one still running too."""
    with SqliteStore(path) as store:
        for n, recipe in enumerate(("one", "one", "other", "one", "one")):
            attempt = store.begin(logs.begin(f"SN{n}", recipe_hash=recipe, started_ns=n))
            if n != 3:
                store.result(attempt, "dwell", {"n": n})
            if n != 4:
                store.finish(attempt, "PASS", 10 + n)
        assert store.dwells("one", 50) == [{"n": 0}, {"n": 1}]
        assert store.dwells("one", 3) == [{"n": 1}]
        assert store.dwells("none", 50) == []
