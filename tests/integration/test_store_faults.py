"""Storage faults, real ones: each is a StoreFault with its sentence, and nothing is falsely kept or lost."""

import resource
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from sqlite_utils import Database
from sqlite_utils.migrations import Migrations

from station.adapters.store import file, schema
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.errors import LogError, StationError, StoreFault
from station.ports.log_reader import Query, Trust
from tests.fakes import logs

SIDES = ("", "-wal", ".head")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "station.db"


def findings(path: Path) -> list[str]:
    with SqliteLogReader(path) as log:
        return [f.what for f in log.findings(Trust())]


def outcomes(path: Path) -> list[str | None]:
    with SqliteLogReader(path) as log:
        return [a.outcome for a in log.attempts(Query())]


def records(path: Path) -> int:
    with SqliteLogReader(path) as log:
        return log.head().number


def steps(store: SqliteStore) -> Iterator[Callable[[], object]]:
    """The calls of one attempt, one after the other."""
    rng = np.random.default_rng(1)
    attempt = store.begin(logs.begin())
    yield lambda: store.result(attempt, "identity", {"software": "1.0.0"})
    for number in range(3):
        yield partial(_visit, store, attempt, number, rng)
    yield lambda: store.event(attempt, "x", {"text": "y" * 3000})
    yield lambda: store.result(attempt, "verdict", {"outcome": "PASS"})
    yield lambda: store.finish(attempt, "PASS", 1)
    yield store.tidy


def _visit(store: SqliteStore, attempt: str, number: int, rng: np.random.Generator) -> None:
    store.visit([attempt], [logs.visit(number, rng)])


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """No file may grow beyond `size` bytes: what a full disk or a quota does to writes (EFBIG in place of ENOSPC)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_at_any_write_is_a_sentence_and_every_acknowledged_record_is_kept(tmp_path: Path) -> None:
    fresh = tmp_path / "fresh.db"
    SqliteStore(fresh).close()
    refused = 0
    for limit in range(4096, 240_000, 8192):
        path = tmp_path / f"{limit}.db"
        for side in ("", ".head"):
            shutil.copy(f"{fresh}{side}", f"{path}{side}")
        acknowledged, failed = 0, False
        store = SqliteStore(path)
        with largest_file(limit):
            try:
                for step in steps(store):
                    acknowledged = store.head().number
                    step()
                acknowledged = store.head().number
            except StoreFault as fault:
                failed = True
                assert "cannot be written: the disk" in fault.sentence
        refused += failed
        assert store.head().number >= acknowledged
        if failed:
            assert set(outcomes(path)) <= {None}, "no PASS without its record"
        store.close()
        assert records(path) >= acknowledged
        assert findings(path) == []
    assert 5 < refused < 28, "some limits stop the attempt at some write, the largest let it through"


def test_after_a_full_disk_the_same_store_goes_on(path: Path) -> None:
    with SqliteStore(path) as store:
        attempt = store.begin(logs.begin())
        with largest_file(1000), pytest.raises(StoreFault, match="the disk"):
            store.event(attempt, "x", {"text": "y" * 9000})
        store.event(attempt, "space again", {})
        store.finish(attempt, "ERROR", 1)
    with SqliteLogReader(path) as log:
        assert [e.kind for e in log.events()] == ["space again"]
    assert findings(path) == []


@pytest.fixture
def public_path() -> Iterator[Path]:
    """A log in a folder that plain users may enter; pytest's own are closed to them."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder) / "station.db"
        Path(folder).chmod(0o755)


def test_a_read_only_file_is_refused_at_the_start(public_path: Path) -> None:
    with SqliteStore(public_path) as store:
        logs.unit(store)
    public_path.chmod(0o444)
    public_path.with_name("station.db.lock").chmod(0o666)
    public_path.parent.chmod(0o555)
    with logs.as_nobody(), pytest.raises(StoreFault, match="read-only; let the station write the file"):
        SqliteStore(public_path)


def test_a_log_on_a_medium_that_cannot_be_written_can_still_be_read(public_path: Path) -> None:
    with SqliteStore(public_path) as store:
        logs.unit(store)
    for side in ("", ".head"):
        Path(f"{public_path}{side}").chmod(0o444)
    public_path.parent.chmod(0o555)
    with logs.as_nobody():
        assert findings(public_path) == []


def test_a_locked_file_is_a_sentence_after_a_short_wait(path: Path) -> None:
    with SqliteStore(path, busy_s=0.05) as store:
        attempt = store.begin(logs.begin())
        other = sqlite3.connect(path)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreFault, match="another program has locked it"):
            store.event(attempt, "x", {})
        other.close()
        store.finish(attempt, "ERROR", 1)
    assert findings(path) == []


@pytest.mark.parametrize("page", range(1, 8))
def test_a_corrupt_page_is_told_by_whoever_meets_it(path: Path, page: int) -> None:
    with SqliteStore(path) as store:
        for number in range(20):
            logs.unit(store, f"SN{number}")
    data = bytearray(path.read_bytes())
    at = page * (len(data) // 4096 // 8) * 4096
    data[at : at + 4096] = np.random.default_rng(page).bytes(4096)
    path.write_bytes(data)
    try:
        found = findings(path)
    except LogError as error:
        found = ["damaged"]
        assert "damaged" in error.sentence or "cannot be read" in error.sentence
    assert found, "a damaged log is never called whole"


def test_a_log_without_its_header_is_no_log(path: Path) -> None:
    with SqliteStore(path) as store:
        logs.unit(store)
    data = bytearray(path.read_bytes())
    data[:100] = bytes(100)
    path.write_bytes(data)
    for opened in (SqliteStore, SqliteLogReader):
        with pytest.raises(StationError, match="its first page is damaged"):
            opened(path)


def extended(step: Callable[[Database], None]) -> Migrations:
    """The schema of a newer station: one step more."""
    newer = Migrations("station.log")
    newer()(schema.first_tables)
    newer(name="one_more")(step)
    return newer


def add_column(db: Database) -> None:
    db.execute("ALTER TABLE attempt ADD COLUMN shift TEXT")


def test_an_old_schema_is_migrated_with_a_backup_and_old_seals_still_hold(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SqliteStore(path) as store:
        logs.unit(store)
        head = store.head()
    monkeypatch.setattr(file, "migrations", extended(add_column))
    with pytest.raises(LogError, match="has an older schema: run `station run` on it once"):
        SqliteLogReader(path)
    monkeypatch.setitem(schema.COLUMNS, "attempt", (*schema.COLUMNS["attempt"], "shift"))
    with SqliteStore(path) as store:
        assert store.head() == head
    assert findings(path) == []
    (backup,) = path.parent.glob("station.db.before-migration-*.bak")
    monkeypatch.undo()
    with SqliteLogReader(backup) as log:
        assert (log.head(), log.count(Query())) == (head, 1)


def test_a_migration_that_fails_leaves_the_log_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(db: Database) -> None:
        add_column(db)
        db.execute("ALTER TABLE nowhere ADD COLUMN x TEXT")

    with SqliteStore(path) as store:
        logs.unit(store)
    monkeypatch.setattr(file, "migrations", extended(half))
    with pytest.raises(StoreFault, match="cannot be opened"):
        SqliteStore(path)
    monkeypatch.undo()
    with SqliteStore(path) as store:
        logs.unit(store)
    assert findings(path) == []


def test_a_newer_schema_is_refused_by_writer_and_reader(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file, "migrations", extended(add_column))
    SqliteStore(path).close()
    monkeypatch.undo()
    with pytest.raises(StoreFault, match=r"written by a newer station .* update this one"):
        SqliteStore(path)
    with pytest.raises(LogError, match="written by a newer station"):
        SqliteLogReader(path)


def copy(path: Path, folder: Path) -> Path:
    """The files as a power cut would leave them: shared memory is gone."""
    folder.mkdir()
    for side in SIDES:
        if Path(f"{path}{side}").exists():
            shutil.copy(f"{path}{side}", f"{folder / path.name}{side}")
    return folder / path.name


def test_a_power_cut_after_any_call_loses_nothing_that_was_acknowledged(path: Path, tmp_path: Path) -> None:
    left = []
    with SqliteStore(path) as store:
        for number, step in enumerate(steps(store)):
            left.append((copy(path, tmp_path / f"cut{number}"), store.head()))
            step()
        left.append((copy(path, tmp_path / "cut"), store.head()))
    over = [restored for restored, _ in left[-2:]]  # cut after the finish: before the frames are packed, and after
    for restored, head in left:
        with SqliteStore(restored) as store:
            assert store.head().number >= head.number
            assert len(store.unfinished()) == (0 if restored in over else 1)
        assert findings(restored) == []


def test_a_torn_write_ahead_log_gives_a_shorter_log_and_the_head_file_says_so(path: Path, tmp_path: Path) -> None:
    SqliteStore(path).close()
    with SqliteStore(path) as store:
        for step in steps(store):
            step()
        head = store.head()
        torn = copy(path, tmp_path / "torn")
    wal = Path(f"{torn}-wal")
    main, whole = torn.read_bytes(), wal.read_bytes().rstrip(b"\0")
    shown = set()
    for cut in np.linspace(0, len(whole) - 1, 25).astype(int):
        Path(f"{torn}-shm").unlink(missing_ok=True)
        torn.write_bytes(main)
        wal.write_bytes(whole[:cut])
        assert records(torn) < head.number
        assert findings(torn) == ["truncated"]
        shown.add(records(torn))
    assert len(shown) > 5


def test_a_log_that_could_not_be_made_whole_is_not_made_at_all(path: Path) -> None:
    with largest_file(20_000), pytest.raises(StoreFault, match=r"cannot be opened: the disk"):
        SqliteStore(path)
    assert not path.exists()
    with SqliteStore(path) as store:
        logs.unit(store)
    assert findings(path) == []


def test_what_a_deleted_log_left_behind_is_not_written_into_the_new_one(path: Path, tmp_path: Path) -> None:
    with SqliteStore(path) as store:
        logs.unit(store)
        left = Path(f"{path}-wal").read_bytes()
    for side in ("", ".head"):
        Path(f"{path}{side}").unlink()
    Path(f"{path}-wal").write_bytes(left)
    with SqliteStore(path) as store:
        assert store.head().number == 0
        logs.unit(store, "SN7")
    assert findings(path) == []
