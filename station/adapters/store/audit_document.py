"""A unit's whole life as one JSON document, `station.audit/1`: every attempt with everything that was kept of it."""

import json
import sqlite3
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from station.adapters.store import search
from station.adapters.store.schema import SPAN
from station.domain.records.stored_attempt import utc
from station.ports.log_reader import Attempt, Query

_VISITS = f"""
    SELECT seq, run, visit, position, seating, kind, arrived_ns, left_ns, frame_count, frames_sha256, statistics
    FROM visit WHERE {SPAN} ORDER BY seq"""
_WRITES = f"""
    SELECT seq, at_ns, object, sub, name, stage, value, old, written, read_back
    FROM "write" WHERE {SPAN} ORDER BY seq"""
_RESULTS = f"SELECT seq, at_ns, name, document FROM result WHERE {SPAN} ORDER BY seq"
_EVENTS = "SELECT seq, at_ns, kind, detail FROM event WHERE attempt = :a ORDER BY seq"
_SEAL = "SELECT seq, hash FROM finish WHERE attempt = :a"


def of_query(db: sqlite3.Connection, query: Query, limit: int | None = None) -> list[dict[str, Any]]:
    """Every attempt that the query names, the newest `limit` of them, oldest first."""
    attempts = list(search.attempts(db, query, limit))
    return [of_attempt(db, attempt) for attempt in reversed(attempts)]


def of_attempt(db: sqlite3.Connection, attempt: Attempt) -> dict[str, Any]:
    """One attempt: identity, visits, results, object writes, events, and the seal of its end."""
    a = {"a": attempt.number}
    sealed = db.execute(_SEAL, a).fetchone()
    columns = {k: v for k, v in asdict(attempt).items() if k != "number"}
    return {
        **columns,
        "record": attempt.number,
        "started": utc(attempt.started_ns),
        "ended": None if attempt.ended_ns is None else utc(attempt.ended_ns),
        "seal": {"number": sealed[0], "hash": sealed[1].hex()} if sealed else None,
        "visits": [_visit(row) for row in _rows(db, _VISITS, a)],
        "results": [{**row, "document": json.loads(row["document"])} for row in _rows(db, _RESULTS, a)],
        "writes": [_write(row) for row in _rows(db, _WRITES, a)],
        "events": [{**row, "detail": json.loads(row["detail"])} for row in _rows(db, _EVENTS, a)],
    }


def _rows(db: sqlite3.Connection, query: str, parameters: dict[str, int]) -> Iterator[dict[str, Any]]:
    cursor = db.execute(query, parameters)
    names = ["record", *(c[0] for c in cursor.description[1:])]
    return (dict(zip(names, row, strict=True)) for row in cursor)


def _visit(row: dict[str, Any]) -> dict[str, Any]:
    return {**row, "statistics": json.loads(row["statistics"])}


def _write(row: dict[str, Any]) -> dict[str, Any]:
    """Objects as `2101:01`, bytes as hexadecimal in the order on the wire."""
    held = {key: None if row[key] is None else row[key].hex() for key in ("old", "written", "read_back")}
    place = f"{row.pop('object'):04X}:{row.pop('sub'):02X}"
    return {**row, "object": place, **held}
