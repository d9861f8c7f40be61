"""Tables of the log, `station.log/1`, as migrations: each runs in one transaction with the record that it ran.

Evidence tables share one numbering (`seq`, the place in the chain of hashes) and are append-only: triggers refuse
UPDATE and DELETE. A later schema adds a migration at the end and columns at the end of a tuple in `COLUMNS`.

Raw frames: while an attempt runs, each visit's lie in `frames` as plain bytes, whose SHA-256 the visit has sealed;
after its finish all of them are packed into one sealed `archive` record, and only then may the plain ones go.
"""

from __future__ import annotations

import uuid
from functools import cache
from typing import TYPE_CHECKING

from sqlite_utils.migrations import Migrations

from station.domain.records.chain import SCHEMA, genesis
from station.domain.records.tables import COLUMNS

if TYPE_CHECKING:
    from sqlite_utils import Database

__all__ = ["COLUMNS", "INDICES", "SPAN", "foreign_objects", "guard", "migrations"]

_SEALS = "seq INTEGER PRIMARY KEY, previous BLOB NOT NULL, hash BLOB NOT NULL, signature BLOB"
_OF = "attempt INTEGER NOT NULL REFERENCES attempt(seq)"

_TABLES = {
    "document": "sha256 TEXT NOT NULL UNIQUE, kind TEXT NOT NULL, text TEXT NOT NULL",
    "attempt": """id TEXT NOT NULL UNIQUE, serial TEXT NOT NULL, station TEXT NOT NULL, nest TEXT NOT NULL,
        node INTEGER NOT NULL, lot TEXT NOT NULL, recipe_name TEXT NOT NULL, recipe_version INTEGER NOT NULL,
        recipe_hash TEXT NOT NULL, recipe INTEGER REFERENCES document(seq), product INTEGER REFERENCES document(seq),
        config_hash TEXT NOT NULL, software TEXT NOT NULL, operator TEXT NOT NULL, started_ns INTEGER NOT NULL""",
    "event": """attempt INTEGER REFERENCES attempt(seq), at_ns INTEGER NOT NULL, kind TEXT NOT NULL,
        detail TEXT NOT NULL""",
    "visit": f"""{_OF}, run INTEGER NOT NULL, visit INTEGER NOT NULL, position TEXT NOT NULL, seating TEXT NOT NULL,
        kind TEXT NOT NULL, arrived_ns INTEGER NOT NULL, left_ns INTEGER NOT NULL, frame_count INTEGER NOT NULL,
        frames_sha256 TEXT NOT NULL, statistics TEXT NOT NULL""",
    "write": f"""{_OF}, at_ns INTEGER NOT NULL, object INTEGER NOT NULL, sub INTEGER NOT NULL, name TEXT NOT NULL,
        stage TEXT NOT NULL, value REAL, old BLOB, written BLOB NOT NULL, read_back BLOB""",
    "result": f"{_OF}, at_ns INTEGER NOT NULL, name TEXT NOT NULL, document TEXT NOT NULL",
    "finish": f"{_OF} UNIQUE, outcome TEXT NOT NULL, ended_ns INTEGER NOT NULL",
    "archive": f"{_OF} UNIQUE, visits INTEGER NOT NULL, data BLOB NOT NULL",
}

#: One index a question: a serial's life, a time span, a recipe, a lot, a nest, a firmware. Visits, writes and results
#: of an attempt need none: their numbers lie between those of its beginning and its finish. Events may come later.
INDICES = (
    "attempt_serial ON attempt(serial, recipe_name)",
    "attempt_started ON attempt(started_ns)",
    "attempt_recipe ON attempt(recipe_name, started_ns)",
    "attempt_recipe_hash ON attempt(recipe_hash, started_ns)",
    "attempt_lot ON attempt(lot)",
    "attempt_nest ON attempt(nest, started_ns)",
    "event_attempt ON event(attempt)",
    "finish_outcome ON finish(outcome, ended_ns)",
    "result_firmware ON result(json_extract(document, '$.software'), attempt) WHERE name = 'identity'",
)

#: The records of attempt :a among a table's: those between its beginning and its finish that name it.
SPAN = """
    seq BETWEEN :a AND coalesce((SELECT seq FROM finish WHERE attempt = :a), 9223372036854775807) AND attempt = :a"""

_FRAMES_STAY = """
    CREATE TRIGGER frames_stay BEFORE DELETE ON frames
    WHEN NOT EXISTS (SELECT 1 FROM visit v JOIN archive a ON a.attempt = v.attempt WHERE v.seq = OLD.visit)
    BEGIN SELECT RAISE(ABORT, 'raw frames stay until they are packed'); END"""

migrations = Migrations("station.log")


@migrations()
def first_tables(db: Database) -> None:
    """Evidence tables with their guards, the head of the chain, and what the log is."""
    for table, columns in _TABLES.items():
        db.execute(f"CREATE TABLE {table} ({_SEALS}, {columns}) STRICT")
        guard(db, table)
    for index in INDICES:
        db.execute(f"CREATE INDEX {index}")
    db.execute("CREATE TABLE frames (visit INTEGER PRIMARY KEY REFERENCES visit(seq), data BLOB NOT NULL) STRICT")
    db.execute(_FRAMES_STAY)
    log_id = str(uuid.uuid4())
    db.execute("CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT")
    db.execute("INSERT INTO meta VALUES ('schema', ?), ('log_id', ?)", [SCHEMA, log_id])
    db.execute("CREATE TABLE head (id INTEGER PRIMARY KEY, number INTEGER NOT NULL, hash BLOB NOT NULL) STRICT")
    db.execute("INSERT INTO head VALUES (1, 0, ?)", [genesis(log_id)])


def guard(db: Database, table: str) -> None:
    """Makes a table append-only for everyone who does not first drop the guard, which the chain would show."""
    for action in ("UPDATE", "DELETE"):
        db.execute(
            f"CREATE TRIGGER {table}_no_{action.lower()} BEFORE {action} ON {table} "
            f"BEGIN SELECT RAISE(ABORT, 'the log is append-only: {table} refuses {action}'); END"
        )


def foreign_objects(db: Database, steps: Migrations) -> list[str]:
    """What the file defines otherwise than these migrations would have made it: tables, indices, triggers, views.

    A trigger, view or index that somebody added can swallow a record or show another; one that is altered, too.
    SQLite keeps every definition as text in sqlite_master, so the texts are compared.
    """
    made = _made_by(steps)
    found = _definitions(db)
    return sorted(
        f"{kind} {name}"
        for kind, name in made.keys() | found.keys()
        if made.get((kind, name)) != found.get((kind, name)) and name not in _OF_SQLITE
    )


#: Statistics that SQLite keeps for itself where somebody ran ANALYZE: they change the speed, never an answer.
_OF_SQLITE = frozenset({"sqlite_stat1", "sqlite_stat4", "sqlite_sequence"})


@cache
def _made_by(steps: Migrations) -> dict[tuple[str, str], str]:
    """What these migrations define; kept as text, for a connection belongs to its thread."""
    from sqlite_utils import Database

    made = Database(memory=True, execute_plugins=False)
    try:
        steps.apply(made)
        return _definitions(made)
    finally:
        made.close()


def _definitions(db: Database) -> dict[tuple[str, str], str]:
    rows = db.execute("SELECT type, name, coalesce(sql, '') FROM sqlite_master").fetchall()
    return {(kind, name): " ".join(sql.split()) for kind, name, sql in rows}
