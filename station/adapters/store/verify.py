"""Walks the whole log, one record at a time, and yields everything that was done to it behind the station's back."""

import heapq
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from operator import attrgetter
from pathlib import Path

from sqlite_utils import Database

from station.adapters.store import anchor, keys
from station.adapters.store.file import altered_objects
from station.adapters.store.log_anchors import StoredLogEnd
from station.adapters.store.schema import COLUMNS
from station.adapters.store.sqlite_errors import is_damage, sqlite_reason
from station.domain.records import chain
from station.domain.records.chain import ChainVerifier, IntegrityFinding, SealedRecord
from station.domain.records.framepack import plain
from station.domain.records.head import SealedHead, against, missing
from station.errors import LogError
from station.messages import Message
from station.ports.log_reader import NO_EXTRA_TRUST, AnchorState, Trust, ignore_progress

#: Raw frames of every visit must lie in one of two places, and in the plain one only as they were sealed.
_FRAMES = """
    SELECT v.seq, v.frames_sha256, f.data, a.seq FROM visit v LEFT JOIN frames f ON f.visit = v.seq
    LEFT JOIN archive a ON a.attempt = v.attempt WHERE f.visit IS NOT NULL OR a.seq IS NULL"""

_STRAY = "SELECT visit FROM frames WHERE visit NOT IN (SELECT seq FROM visit)"

#: How often progress is reported, in records.
_PROGRESS = 1000


def findings(
    path: Path, db: Database, trust: Trust = NO_EXTRA_TRUST, progress: Callable[[int], None] = ignore_progress
) -> Iterator[IntegrityFinding]:
    """Everything wrong with the log; nothing when it is whole. The log may grow meanwhile: a snapshot is checked.

    progress is given the record's number now and then.
    """
    # Heads are read first: they may lag behind the snapshot, never run ahead of it.
    anchored = anchors_of(path, trust)
    connection = db.conn
    connection.text_factory = lambda data: data.decode("utf-8", "surrogateescape")
    try:
        connection.execute("SAVEPOINT verification")
        yield from _schema(db)
        yield from _chain(db, anchored, trust, progress)
        yield from _head(db)
        yield from _places(db, anchored)
        yield from _frames(db)
        yield from _pages(db)
    except sqlite3.DatabaseError as exc:
        if not is_damage(exc):
            raise LogError("log-not-read", path=str(path), reason=sqlite_reason(exc)) from exc
        yield IntegrityFinding("damaged", "", 0, Message("log-file-damaged", path=str(path), why=sqlite_reason(exc)))
    finally:
        with suppress(sqlite3.DatabaseError):  # of a damaged file even the end of a snapshot fails
            connection.execute("RELEASE verification")
        connection.text_factory = str


def log_id(db: Database) -> str:
    """What sets this log apart from all others."""
    row = db.execute("SELECT value FROM meta WHERE key = 'log_id'").fetchone()
    return str(row[0]) if row else ""


def _schema(db: Database) -> Iterator[IntegrityFinding]:
    for name in altered_objects(db):
        yield IntegrityFinding("unguarded", name, 0, Message("log-schema-altered", object=name))
    meta = dict(db.execute("SELECT key, value FROM meta").fetchall())
    if set(meta) != {"schema", "log_id"} or meta["schema"] != chain.SCHEMA:
        yield IntegrityFinding("edited", "meta", 0, Message("log-meta-edited"))


def anchors_of(path: Path, trust: Trust) -> dict[str, SealedHead | None]:
    """Heads by place: the file beside the log, unless seals are known from elsewhere, and the anchors."""
    adjacent = dict[str, SealedHead | None]()
    if not trust.known:
        place = anchor.HeadFile(path)
        try:
            adjacent[place.name] = place.read()
        except (OSError, ValueError):
            adjacent[place.name] = None
    return adjacent | dict(trust.anchors)


def _seals(db: Database, anchored: Mapping[str, SealedHead | None], trust: Trust) -> dict[int, bytes]:
    """Seals by number that something outside the tables of evidence knows of this log."""
    noted = {number: seal for number, seal in db.execute("SELECT number, hash FROM head") if number}
    own = [head for head in anchored.values() if head and head.number and head.log_id == log_id(db)]
    return noted | {head.number: bytes.fromhex(head.hash) for head in own} | dict(trust.known)


def _chain(
    db: Database,
    anchored: Mapping[str, SealedHead | None],
    trust: Trust,
    progress: Callable[[int], None],
) -> Iterator[IntegrityFinding]:
    anchors = _seals(db, anchored, trust)
    schedule = keys.schedule(db.conn, log_id(db), trust.public_key)
    yield from schedule.findings()
    walk = ChainVerifier(chain.genesis(log_id(db)), anchors, schedule.check if schedule.signs else None)
    streams = [_records(db, table) for table in COLUMNS]
    for record in heapq.merge(*streams, key=attrgetter("number")):
        yield from walk.step(record)
        if record.number % _PROGRESS == 0:
            progress(record.number)
    yield from chain.check_tail(walk.number, anchors)
    if trust.public_key is not None and not walk.signed:
        yield IntegrityFinding("unsigned", "", 0, Message("log-not-signed"))


def _records(db: Database, table: str) -> Iterator[SealedRecord]:
    """A table's records in the order of their numbers, one at a time."""
    names = COLUMNS[table]
    query = f"SELECT seq, previous, hash, signature, {', '.join(names)} FROM {table} ORDER BY seq"
    for number, previous, seal, signature, *values in db.execute(query):
        yield SealedRecord(number, table, previous, seal, chain.canonical(table, names, values), signature)


def _head(db: Database) -> Iterator[IntegrityFinding]:
    """The note inside the log is made with every beginning and every finish."""
    (due,) = db.execute(
        "SELECT max(coalesce(max(a.seq), 0), (SELECT coalesce(max(seq), 0) FROM finish)) FROM attempt a"
    )
    noted = db.execute("SELECT number, hash FROM head").fetchall()
    if [number for number, _ in noted] != list(due):
        yield IntegrityFinding("edited", "head", 0, Message("log-head-edited"))


def _places(db: Database, anchored: Mapping[str, SealedHead | None]) -> Iterator[IntegrityFinding]:
    """What the chain's walk does not see: no head, one of another log, one that is too old, one that nobody signed."""
    for place, state in compared(db, anchored).items():
        if state.message is not None and state.what not in ("replaced", "truncated"):
            what = "forged" if state.what == "forged" else "unanchored"
            yield IntegrityFinding(what, place, 0, state.message)


def compared(db: Database, anchored: Mapping[str, SealedHead | None]) -> dict[str, AnchorState]:
    """What each place says of the log."""
    end = StoredLogEnd(db.conn, log_id(db))
    states = dict[str, AnchorState]()
    for place, head in anchored.items():
        found = (
            missing(place) if head is None else against(place, head, end, lags=not place.startswith(anchor.HEAD_FILE))
        )
        number = head.number if head else 0
        states[place] = AnchorState(number, found.what if found else "agrees", found.message if found else None)
    return states


def _frames(db: Database) -> Iterator[IntegrityFinding]:
    for number, sha256, data, archive in db.execute(_FRAMES):
        if data is None:
            yield IntegrityFinding("deleted", "frames", number, Message("log-frames-missing", number=number))
        elif archive is not None or plain.digest(data) != sha256:
            yield IntegrityFinding("edited", "frames", number, Message("log-frames-edited", number=number))
    for (number,) in db.execute(_STRAY):
        yield IntegrityFinding("inserted", "frames", number, Message("log-frames-stray", number=number))


def _pages(db: Database) -> Iterator[IntegrityFinding]:
    """SQLite's own check of its pages and indices."""
    for (report,) in db.execute("PRAGMA integrity_check(20)"):
        if report != "ok":
            yield IntegrityFinding("damaged", "", 0, Message("log-pages-damaged", report=" ".join(report.split())))
