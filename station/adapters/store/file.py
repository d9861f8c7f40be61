"""Opens the log's file: checks what it is, sets how it is kept, makes or migrates its tables."""

import errno
import os
import sqlite3
import time
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path

from sqlite_utils import Database

from station.adapters.store.anchor import sync_folder
from station.adapters.store.index_check import misleading_indices
from station.adapters.store.schema import COLUMNS, foreign_objects, migrations
from station.adapters.store.sqlite_errors import translate_errors
from station.domain.records.chain import SCHEMA, genesis
from station.errors import LogError, StationError, StoreFault
from station.files.lock import take
from station.files.ordinary import is_alone, open_ordinary
from station.files.real_path import real_path
from station.messages import Message

#: Pages of write-ahead log that are kept on disk after a checkpoint; a long-reading page may not let it grow for ever.
_WAL_LIMIT_BYTES = 64 * 1024 * 1024
#: What it needs between two checkpoints: SQLite's 1000 pages with their headers, and the last commit's beyond them.
_WAL_USUAL_BYTES = 5 * 1024 * 1024
_PAGE_BYTES = 4096
#: More than a tick of the clock that stamps files; where they bear whole seconds, no stamp is trusted.
COARSE_TICK_NS = 50_000_000


def check_companions(path: Path, fault: type[StationError]) -> None:
    """Raises `fault` where SQLite's own files beside the log are a link, a pipe or another file's second name: it would
    wait for a pipe for ever, and write the log into the other file."""
    for ending in ("-wal", "-shm", "-journal"):
        companion = path.with_name(path.name + ending)
        with suppress(FileNotFoundError):
            if not is_alone(companion.lstat()):
                raise fault("log-companion-refused", file=str(companion))


def open_for_writing(path: Path, busy_s: float) -> sqlite3.Connection:
    """The log, made or migrated as needed: WAL, synchronous FULL. Errors: StoreFault."""
    with translate_errors(StoreFault, path, "opened"):
        if path.exists() and not path.is_file():
            what = Message("log-is-folder" if path.is_dir() else "log-no-ordinary-file")
            raise StoreFault("log-not-opened", path=str(path), reason=what)
        check_companions(path, StoreFault)
        if not path.exists() or not path.stat().st_size:
            _make(real_path(path))
        connection = sqlite3.connect(path, timeout=busy_s, isolation_level=None, check_same_thread=False)
    try:
        with translate_errors(StoreFault, path, "opened"):
            _prepare(connection, path)
            _preallocate_wal(path.with_name(path.name + "-wal"))
    except StoreFault:
        connection.close()
        raise
    return connection


def _make(path: Path) -> None:
    """A new log takes its name when it is whole: a disk that fills up meanwhile leaves nothing that is half a log."""
    new = path.with_name(path.name + ".new")
    new.unlink(missing_ok=True)
    try:
        with closing(sqlite3.connect(new, isolation_level=None)) as connection:
            migrations.apply(Database(connection, execute_plugins=False))
        for ending in ("-wal", "-shm"):  # of a log that was deleted: SQLite would write it into this one
            path.with_name(path.name + ending).unlink(missing_ok=True)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)
    sync_folder(path)


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA journal_size_limit = {_WAL_LIMIT_BYTES}")
    db = Database(connection, execute_plugins=False)
    tables = set(db.table_names())
    check_schema(db, tables, path, StoreFault)
    if not migrations.pending(db):
        if altered := altered_objects(db):
            raise StoreFault("log-schema-refused", path=str(path), objects=altered)
        if astray := misleading_indices(connection):
            raise StoreFault("log-index-misleads", path=str(path), indices=astray)
        return
    _back_up(connection, path)
    migrations.apply(db)
    sync_folder(path)


def altered_objects(db: Database) -> list[str]:
    """What in the log's schema is not as this version makes it."""
    return foreign_objects(db, migrations)


def own_inode(path: Path) -> int:
    """Locks the file itself, which a bind mount may show under another path too; the handle that holds the lock.

    Errors: StoreFault where another process has it, or where the file has further names (hard links): SQLite would
    keep a write-ahead log for each of them, and neither would know of the other's records.
    """
    if (names := path.stat().st_nlink) > 1:
        raise StoreFault("log-hard-linked", path=str(path), names=names)
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        take(handle)
    except BlockingIOError:
        os.close(handle)
        raise StoreFault("log-owned-elsewhere", path=str(path)) from None
    return handle


class FilesInPlace:
    """What files the log, its write-ahead log and the index of that are, as they were found when this was made.

    Whoever opens the log while the index is gone makes another one: its locks and ours then know nothing of each other.
    Errors: OSError where one of them is missing.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._names = path, tuple(f"{path}{ending}" for ending in ("", "-wal", "-shm"))
        self._folder, self._unchanged = str(path.parent), (0, 0, 0)
        self._found = self._inodes()

    def check_if_folder_changed(self) -> None:
        """As `check`, which is spared where nothing in the folder was made, renamed or removed since: at each commit.

        A file that is asked for its times has a new time, and an inode to journal, with its next write (Linux,
        "Multigrain Timestamps"): the write-ahead log at each commit. A change within the same tick of a coarse clock
        would bear the same time, so a folder that changed just now is not taken for unchanged.
        """
        try:
            folder = os.stat(self._folder)  # noqa: PTH116  # a path's own stat takes three times as long
        except OSError:
            raise self._moved() from None
        now = folder.st_dev, folder.st_ino, folder.st_ctime_ns
        if now == self._unchanged:
            return
        self.check()
        if time.time_ns() - folder.st_ctime_ns > COARSE_TICK_NS and folder.st_ctime_ns % 10**9:
            self._unchanged = now

    def check(self) -> None:
        """StoreFault where the log has been renamed, removed or exchanged under the hands of its owner: what is written
        to an open file whose name is gone, nobody finds again."""
        try:
            if self._inodes() == self._found:
                return
        except OSError:
            pass
        raise self._moved()

    def _moved(self) -> StoreFault:
        return StoreFault("log-moved", path=str(self._path))

    def _inodes(self) -> list[tuple[int, int]]:
        return [((stat := os.stat(name)).st_dev, stat.st_ino) for name in self._names]  # noqa: PTH116


def _preallocate_wal(wal: Path) -> None:
    """Gives the write-ahead log its usual length from the start: a commit's fsync then waits for its data alone.

    A file that grows has its new length and blocks to write with each fsync. What follows the last frame is passed
    over: no zeros are a frame (SQLite, "Database File Format", 4.2). On a disk without room the file keeps its size.
    Written page by page: the kernel keeps what is written in one go as one piece, and a commit would write all of it.
    """
    handle = open_ordinary(wal, os.O_WRONLY | os.O_CREAT)
    try:
        size = os.fstat(handle).st_size
        starts = range(size, _WAL_USUAL_BYTES, _PAGE_BYTES)
        try:
            whole = all(os.pwrite(handle, bytes(_PAGE_BYTES), start) == _PAGE_BYTES for start in starts)
        except OSError:
            whole = False
        if not whole:
            os.ftruncate(handle, size)
        os.fsync(handle)
    finally:
        os.close(handle)


def open_for_reading(path: Path) -> Database:
    """The log, opened so that nothing can be changed. Errors: LogError."""
    with translate_errors(LogError, path, "read"):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "", str(path))
        if not path.is_file():
            raise LogError("log-missing", path=str(path))
        check_companions(real_path(path), LogError)
        connection = sqlite3.connect(_uri(path), uri=True, isolation_level=None, check_same_thread=False)
    try:
        with translate_errors(LogError, path, "read"):
            db = Database(connection, execute_plugins=False)
            check_schema(db, set(db.table_names()), path, LogError)
            if migrations.pending(db):
                raise LogError("log-older", path=str(path))
    except LogError:
        connection.close()
        raise
    return db


def newest(connection: sqlite3.Connection, log_id: str) -> tuple[int, bytes]:
    """Number and seal of the log's last record; of an empty log 0 and its genesis."""
    lasts = (f"SELECT * FROM (SELECT seq, hash FROM {table} ORDER BY seq DESC LIMIT 1)" for table in COLUMNS)
    row = connection.execute(f"{' UNION ALL '.join(lasts)} ORDER BY seq DESC LIMIT 1").fetchone()
    return (row[0], row[1]) if row else (0, genesis(log_id))


def seal_of(connection: sqlite3.Connection, number: int) -> bytes | None:
    """The seal of the record with that number, whatever table it is in; None where there is none."""
    query = " UNION ALL ".join(f"SELECT hash FROM {table} WHERE seq = :n" for table in COLUMNS)
    row = connection.execute(query, {"n": number}).fetchone()
    return None if row is None else bytes(row[0])


def signature_of(connection: sqlite3.Connection, number: int) -> bytes:
    """The signature of the record with that number; empty where it has none."""
    found = " UNION ALL ".join(f"SELECT signature FROM {table} WHERE seq = :n" for table in COLUMNS)
    row = connection.execute(found, {"n": number}).fetchone()
    return bytes(row[0]) if row and row[0] else b""


def seals(connection: sqlite3.Connection, first: int, count: int) -> list[bytes]:
    """The seals of records first + 1 … first + count."""
    parts = (f"SELECT seq, hash FROM {table} WHERE seq > :a AND seq <= :b" for table in COLUMNS)
    rows = connection.execute(f"{' UNION ALL '.join(parts)} ORDER BY seq", {"a": first, "b": first + count})
    return [bytes(seal) for _, seal in rows]


def _uri(path: Path) -> str:
    """Read-only; on a medium that cannot be written, where SQLite could not make its index of the WAL, immutable."""
    alone = not path.with_name(path.name + "-wal").exists()
    still = alone and not os.access(path.parent, os.W_OK, effective_ids=True)
    return f"{real_path(path).as_uri()}?mode=ro{'&immutable=1' if still else ''}"


def check_schema(db: Database, tables: set[str], path: Path, kind: type[StationError]) -> None:
    """Raises `kind` unless this is an empty file or a station log of a schema that this program knows."""
    if not tables:
        if kind is LogError:
            raise LogError("log-empty", path=str(path))
        return
    row = db.execute("SELECT value FROM meta WHERE key = 'schema'").fetchone() if "meta" in tables else None
    if row is None:
        raise kind("log-other-database", path=str(path))
    applied = {m.name for m in migrations.applied(db)}
    unknown = applied - {m.name for m in migrations.pending(Database(memory=True))}
    if row[0] != SCHEMA or unknown:
        raise kind("log-newer", path=str(path), schema=str(row[0]), count=len(unknown))


def _back_up(connection: sqlite3.Connection, path: Path) -> None:
    """A whole copy next to the log, on the disk before the first change."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    copy = path.with_name(f"{path.name}.before-migration-{stamp}.bak")
    target = sqlite3.connect(copy)
    try:
        connection.backup(target)
    finally:
        target.close()
    with copy.open("rb") as file:
        os.fsync(file.fileno())
