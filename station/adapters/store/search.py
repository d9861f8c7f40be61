"""Finds attempts: one query for every question of containment, by the index that suits it."""

import json
import sqlite3
from collections.abc import Collection, Iterator, Sequence
from dataclasses import fields
from typing import Any

from station.ports.log_reader import Attempt, Query, SelectedAttempt

_COLUMNS = (
    "a.seq, a.id, a.serial, a.station, a.nest, a.node, a.lot, a.recipe_name, a.recipe_version, a.recipe_hash, "
    "a.config_hash, a.software, a.operator, a.started_ns, f.outcome, f.ended_ns"
)


#: Columns with an index, the most telling first.
_KEYS = ("serial", "lot", "nest", "recipe_hash", "recipe_name")

_REFERENCE = (
    "kind = 'recipe' AND :reference IN (SELECT value FROM json_tree(text, '$.reference') "
    "WHERE key IN ('serial', 'certificate', 'item', 'name'))"
)
_FIRMWARE = "name = 'identity' AND json_extract(document, '$.software') = :firmware"
#: Where other conditions leave few attempts, each is looked up; else the index of firmwares says which they are.
_FIRMWARE_PROBED = f"EXISTS (SELECT 1 FROM result WHERE {_FIRMWARE} AND attempt = a.seq)"

#: The newest of so many are found sooner by going back from the end than by sorting what an index names.
_COMMON = 20_000
_COMMON_IN = {
    "nest": "SELECT 1 FROM attempt WHERE nest = :nest",
    "recipe_hash": "SELECT 1 FROM attempt WHERE recipe_hash = :recipe_hash",
    "recipe_name": "SELECT 1 FROM attempt WHERE recipe_name = :recipe_name",
    "firmware": f"SELECT 1 FROM result WHERE {_FIRMWARE}",
}

_CONDITIONS = {
    "serial_from": "a.serial >= :serial_from AND a.serial < :serial_from || char(1114111)",
    "since_ns": "a.started_ns >= :since_ns",
    "until_ns": "a.started_ns < :until_ns",
    "before": "a.seq < :before",
    "serial_like": "a.serial GLOB :serial_like",
    # The first half is looked up once: a fixture or a reference that nobody ever had ends the search.
    "fixture": "EXISTS (SELECT 1 FROM document WHERE kind = 'config' AND json_extract(text, '$.fixture') = :fixture) "
    "AND a.config_hash IN (SELECT sha256 FROM document WHERE kind = 'config' "
    "AND json_extract(text, '$.fixture') = :fixture)",
    "reference": f"EXISTS (SELECT 1 FROM document WHERE {_REFERENCE}) "
    f"AND a.recipe IN (SELECT seq FROM document WHERE {_REFERENCE})",
    # Only what did not pass has reasons; a verdict lies between the attempt and its finish; text is searched faster
    # than it is parsed.
    "check": "a.seq IN (SELECT v.attempt FROM finish v WHERE v.outcome IN ('FAIL', 'ERROR') AND EXISTS (SELECT 1 "
    "FROM result r, json_each(r.document, '$.reasons') e WHERE r.seq BETWEEN v.attempt AND v.seq "
    "AND r.attempt = v.attempt AND r.name = 'verdict' AND instr(r.document, :check) "
    "AND json_extract(e.value, '$.check') = :check))",
    "outcome": "f.outcome = :outcome",
    "firmware": f"a.seq IN (SELECT attempt FROM result WHERE {_FIRMWARE})",
}


def where(query: Query, common: Collection[str] = ()) -> tuple[str, dict[str, object]]:
    """The SQL condition and its parameters. common: fields that so many attempts share that an index does not help.

    A plus before a column keeps SQLite from its index: without statistics it would often take the wrong one.
    """
    given = {f.name: getattr(query, f.name) for f in fields(query) if getattr(query, f.name) is not None}
    by = next((name for name in _KEYS if name in given and name not in common), "")
    conditions = {name: _CONDITIONS.get(name, f"{'' if name == by else '+'}a.{name} = :{name}") for name in given}
    if set(given) - {"firmware"} or "firmware" in common:
        conditions |= {"firmware": _FIRMWARE_PROBED} if "firmware" in given else {}
    return " AND ".join(["1", *conditions.values()]), given


def attempts(db: sqlite3.Connection, query: Query, limit: int | None = None) -> Iterator[Attempt]:
    """Attempts that the query names, newest first, one at a time."""
    condition, parameters = where(query, () if limit is None else _common(db, query))
    rows = f"SELECT {_COLUMNS} FROM attempt a LEFT JOIN finish f ON f.attempt = a.seq WHERE {condition}"
    for row in db.execute(
        f"{rows} ORDER BY a.seq DESC LIMIT :limit", {**parameters, "limit": -1 if limit is None else limit}
    ):
        yield Attempt(*row)


def _common(db: sqlite3.Connection, query: Query) -> list[str]:
    """Fields whose value very many attempts share; with a span of time an index names few enough."""
    if query.since_ns is not None or query.until_ns is not None:
        return []
    given = {name: getattr(query, name) for name in _COMMON_IN if getattr(query, name) is not None}
    found = ((name, f"{_COMMON_IN[name]} LIMIT 1 OFFSET {_COMMON}") for name in given)
    return [name for name, sql in found if db.execute(sql, {name: given[name]}).fetchone()]


def count(db: sqlite3.Connection, query: Query) -> int:
    """How many attempts the query names."""
    condition, parameters = where(query)
    sql = f"SELECT count(*) FROM attempt a LEFT JOIN finish f ON f.attempt = a.seq WHERE {condition}"
    return int(db.execute(sql, parameters).fetchone()[0])


def selection(db: sqlite3.Connection, query: Query) -> Iterator[SelectedAttempt]:
    """See LogReader.selection."""
    condition, parameters = where(query)
    sql = f"SELECT a.seq, a.id, f.outcome FROM attempt a JOIN finish f ON f.attempt = a.seq WHERE {condition}"
    return (SelectedAttempt(*row) for row in db.execute(f"{sql} ORDER BY a.seq", parameters))


def recipes(db: sqlite3.Connection, query: Query) -> list[str]:
    """See LogReader.recipes."""
    condition, parameters = where(query)
    sql = f"""SELECT coalesce(d.text, '') FROM (SELECT min(a.recipe) AS recipe FROM attempt a
        JOIN finish f ON f.attempt = a.seq WHERE {condition} GROUP BY a.recipe_hash) u
        LEFT JOIN document d ON d.seq = u.recipe ORDER BY u.recipe"""
    return [str(text) for (text,) in db.execute(sql, parameters)]


def verdict_reasons(db: sqlite3.Connection, numbers: Sequence[int]) -> dict[int, list[dict[str, Any]]]:
    """The reasons of the verdicts of those attempts, by their record numbers."""
    query = """SELECT json_extract(r.document, '$.reasons')
        FROM finish f JOIN result r ON r.seq BETWEEN f.attempt AND f.seq
        WHERE f.attempt = ? AND r.attempt = f.attempt AND r.name = 'verdict' ORDER BY r.seq DESC LIMIT 1"""
    found = ((number, db.execute(query, [number]).fetchone()) for number in numbers)
    return {number: json.loads(row[0]) for number, row in found if row and row[0]}
