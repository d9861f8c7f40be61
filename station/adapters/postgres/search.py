"""Finds attempts in PostgreSQL, by the index that suits the question."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import psycopg

from station.ports.log_reader import Attempt, Query

_COLUMNS = (
    "a.seq, a.id, a.serial, a.station, a.nest, a.node, a.lot, a.recipe_name, a.recipe_version, a.recipe_hash, "
    "a.config_hash, a.software, a.operator, a.started_ns, f.outcome, f.ended_ns"
)
FROM = "attempt a LEFT JOIN finish f ON f.attempt = a.seq"

_CONDITIONS = {
    "serial_from": r"a.serial LIKE %(serial_like)s",
    "since_ns": "a.started_ns >= %(since_ns)s",
    "until_ns": "a.started_ns < %(until_ns)s",
    "before": "a.seq < %(before)s",
    "outcome": "f.outcome = %(outcome)s",
    "firmware": """a.seq IN (SELECT attempt FROM result WHERE name = 'identity'
        AND (document::json ->> 'software') = %(firmware)s)""",
}


def where(query: Query) -> tuple[str, dict[str, Any]]:
    """The SQL condition and its parameters."""
    given = {f.name: value for f in fields(query) if (value := getattr(query, f.name)) is not None}
    conditions = [_CONDITIONS.get(name, f"a.{name} = %({name})s") for name in given]
    if "serial_from" in given:
        escaped = given["serial_from"].replace("\\", r"\\").replace("%", r"\%").replace("_", r"\_")
        given["serial_like"] = escaped + "%"
    return " AND ".join(["true", *conditions]), given


def attempts(db: psycopg.Connection, query: Query, limit: int | None = None) -> Iterator[Attempt]:
    """Attempts that the query names, newest first."""
    condition, parameters = where(query)
    rows = db.execute(
        f"SELECT {_COLUMNS} FROM {FROM} WHERE {condition} ORDER BY a.seq DESC LIMIT %(limit)s".encode(),
        {**parameters, "limit": limit},
    )
    return (Attempt(*row) for row in rows)


def count(db: psycopg.Connection, query: Query) -> int:
    """How many attempts the query names."""
    condition, parameters = where(query)
    row = db.execute(f"SELECT count(*) FROM {FROM} WHERE {condition}".encode(), parameters).fetchone()
    assert row
    return int(row[0])
