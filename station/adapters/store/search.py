"""Finds attempts: one query for every question of containment, by the index that suits it."""

import sqlite3
from collections.abc import Iterator
from dataclasses import fields

from station.ports.log_reader import Attempt, Query

_COLUMNS = (
    "a.seq, a.id, a.serial, a.station, a.nest, a.node, a.lot, a.recipe_name, a.recipe_version, a.recipe_hash, "
    "a.config_hash, a.software, a.operator, a.started_ns, f.outcome, f.ended_ns"
)


#: Columns with an index, the most telling first.
_KEYS = ("serial", "lot", "nest", "recipe_hash", "recipe_name")

_FIRMWARE = "name = 'identity' AND json_extract(document, '$.software') = :firmware"
#: Where other conditions leave few attempts, each is looked up; else the index of firmwares says which they are.
_FIRMWARE_PROBED = f"EXISTS (SELECT 1 FROM result WHERE {_FIRMWARE} AND attempt = a.seq)"

_CONDITIONS = {
    "serial_from": "a.serial >= :serial_from AND a.serial < :serial_from || char(1114111)",
    "since_ns": "a.started_ns >= :since_ns",
    "until_ns": "a.started_ns < :until_ns",
    "before": "a.seq < :before",
    "outcome": "f.outcome = :outcome",
    "firmware": f"a.seq IN (SELECT attempt FROM result WHERE {_FIRMWARE})",
}


def where(query: Query) -> tuple[str, dict[str, object]]:
    """The SQL condition and its parameters.

    A plus before a column keeps SQLite from its index: without statistics it would often take the wrong one.
    """
    given = {f.name: getattr(query, f.name) for f in fields(query) if getattr(query, f.name) is not None}
    by = next((name for name in _KEYS if name in given), "")
    conditions = {name: _CONDITIONS.get(name, f"{'' if name == by else '+'}a.{name} = :{name}") for name in given}
    if set(given) - {"firmware"}:
        conditions |= {"firmware": _FIRMWARE_PROBED} if "firmware" in given else {}
    return " AND ".join(["1", *conditions.values()]), given


def attempts(db: sqlite3.Connection, query: Query, limit: int | None = None) -> Iterator[Attempt]:
    """Attempts that the query names, newest first, one at a time."""
    condition, parameters = where(query)
    rows = f"SELECT {_COLUMNS} FROM attempt a LEFT JOIN finish f ON f.attempt = a.seq WHERE {condition}"
    for row in db.execute(
        f"{rows} ORDER BY a.seq DESC LIMIT :limit", {**parameters, "limit": -1 if limit is None else limit}
    ):
        yield Attempt(*row)


def count(db: sqlite3.Connection, query: Query) -> int:
    """How many attempts the query names."""
    condition, parameters = where(query)
    sql = f"SELECT count(*) FROM attempt a LEFT JOIN finish f ON f.attempt = a.seq WHERE {condition}"
    return int(db.execute(sql, parameters).fetchone()[0])
