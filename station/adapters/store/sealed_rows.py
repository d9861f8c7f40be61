"""The sealed records of one attempt as they stand in the tables, for evidence that is checked elsewhere."""

import sqlite3
from collections.abc import Iterator, Mapping, Sequence

from station.adapters.store.schema import COLUMNS, SPAN
from station.ports.log_reader import Attempt, LogRecord


def of_attempt(db: sqlite3.Connection, attempt: Attempt) -> Iterator[LogRecord]:
    """Its beginning, visits, writes, results, events and finish, its packed frames, and the documents it names."""
    number = {"a": attempt.number}
    yield from _rows(db, "attempt", "seq = :a", number)
    for table in ("visit", "write", "result"):
        yield from _rows(db, table, SPAN, number)
    for table in ("event", "finish", "archive"):
        yield from _rows(db, table, "attempt = :a", number)
    named = "SELECT recipe FROM attempt WHERE seq = :a UNION SELECT product FROM attempt WHERE seq = :a"
    yield from _rows(db, "document", f"seq IN ({named}) OR (kind = 'config' AND sha256 = :config)",
                     {**number, "config": attempt.config_hash})  # fmt: skip


def _rows(db: sqlite3.Connection, table: str, condition: str, values: Mapping[str, int | str]) -> Iterator[LogRecord]:
    names: Sequence[str] = COLUMNS[table]
    listed = ", ".join(f'"{name}"' for name in names)
    for seq, previous, seal, signature, *fields in db.execute(
        f'SELECT seq, previous, hash, signature, {listed} FROM "{table}" WHERE {condition}', values
    ):
        yield LogRecord(seq, table, previous, seal, signature, dict(zip(names, fields, strict=True)))
