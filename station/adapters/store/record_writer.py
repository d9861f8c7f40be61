"""The end of a log that this process owns: sealed records are appended in durable transactions, and by nobody else."""

import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

from station.adapters.store import file, keys
from station.adapters.store.schema import COLUMNS
from station.adapters.store.sqlite_errors import Doing, translate_errors
from station.domain.records import chain, plain_json
from station.domain.records.chain import Value
from station.domain.records.head import SealedHead
from station.errors import StoreFault

_INSERT = {
    table: f"INSERT INTO {table} (seq, previous, hash, signature, {', '.join(columns)}) "
    f"VALUES (?, ?, ?, ?{', ?' * len(columns)})"
    for table, columns in COLUMNS.items()
}


class RecordWriter:
    """number, hash: of the newest record. Safe to call from several threads. Errors: StoreFault.

    committed: told the new head after each transaction, before another may begin.
    """

    def __init__(
        self,
        path: Path,
        connection: sqlite3.Connection,
        station: str,
        signer: keys.Signer | None,
        epoch_ns: Callable[[], int],
        committed: Callable[[SealedHead], object],
    ) -> None:
        self._path, self._db, self._station, self._signer = path, connection, station, signer
        self._epoch_ns, self._committed = epoch_ns, committed
        self._turn = Lock()
        self._data_version, self._files = self._read_data_version(), file.FilesInPlace(path)
        self.log_id = str(connection.execute("SELECT value FROM meta WHERE key = 'log_id'").fetchone()[0])
        self.number, self.hash = file.newest(connection, self.log_id)
        self._signature = file.signature_of(connection, self.number)

    def head(self) -> SealedHead:
        """The log's end, as it is kept elsewhere. For the holder of the turn."""
        return SealedHead(self.log_id, self._station, self.number, self.hash.hex(), self._signature.hex())

    @contextmanager
    def turn(self, doing: Doing = "read") -> Iterator[None]:
        """The connection is the caller's alone, and what SQLite says against it becomes a StoreFault."""
        with self._turn, translate_errors(StoreFault, self._path, doing):
            yield

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """What is appended inside is on the disk when this ends, all of it or nothing."""
        with self._turn:
            before = self.number, self.hash, self._signature
            with translate_errors(StoreFault, self._path, "written"):
                try:
                    self._db.execute("BEGIN IMMEDIATE")
                    self._check_nobody_else_wrote()
                    yield
                    self._db.execute("COMMIT")
                except BaseException:
                    self.number, self.hash, self._signature = before
                    if self._db.in_transaction:
                        self._db.execute("ROLLBACK")
                    raise
            self._committed(self.head())

    def append(self, table: str, *values: Value) -> int:
        """One sealed record inside the open transaction; its number."""
        return self.append_all(table, [values])[0]

    def append_all(self, table: str, records: Sequence[tuple[Value, ...]]) -> range:
        """Sealed records of one table inside the open transaction; their numbers."""
        first, sealed = self.number + 1, []
        for number, values in enumerate(records, first):
            previous, self.hash = self.hash, chain.link(self.hash, chain.canonical(table, COLUMNS[table], values))
            signature = self._signer.sign(self.hash) if self._signer else None
            self._signature = signature or b""
            sealed.append((number, previous, self.hash, signature, *values))
        self.insert(table, _INSERT[table], sealed)
        self.number += len(sealed)
        return range(first, self.number + 1)

    def insert(self, table: str, statement: str, rows: Sequence[tuple[Value, ...]]) -> None:
        """Every row, or StoreFault: a trigger may swallow one without an error (SQLite, RAISE(IGNORE))."""
        if (count := self._db.executemany(statement, rows).rowcount) != len(rows):
            raise StoreFault("log-rows-swallowed", path=str(self._path), table=table, kept=count, rows=len(rows))

    def event(self, attempt: int | None, kind: str, detail: Mapping[str, Any]) -> None:
        """An event inside the open transaction; attempt None: of the station itself."""
        self.append("event", attempt, self._epoch_ns(), plain_json.text(kind), plain_json.document(detail))

    def note_head(self) -> None:
        """Once an attempt, inside its transaction: the log's own note of how far it has come."""
        self._db.execute("UPDATE head SET number = ?, hash = ?", (self.number, self.hash))

    def check_in_place(self) -> None:
        """StoreFault where the log is not where it was."""
        self._files.check()

    def _check_nobody_else_wrote(self) -> None:
        """StoreFault where the log is not where it was, or its newest record not the one that this owner made last."""
        self._files.check_if_folder_changed()
        if (version := self._read_data_version()) == self._data_version:
            return
        if file.newest(self._db, self.log_id) != (self.number, self.hash):
            raise StoreFault("log-written-by-another", path=str(self._path), number=self.number)
        self._data_version = version

    def _read_data_version(self) -> int:
        """Another number after each commit of another connection, and only then (SQLite, PRAGMA data_version)."""
        return int(self._db.execute("PRAGMA data_version").fetchone()[0])
