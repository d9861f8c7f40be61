"""Finds attempts in PostgreSQL, by the index that suits the question."""

import re
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import psycopg

from station.ports.log_reader import Attempt, Query, SelectedAttempt

_COLUMNS = (
    "a.seq, a.id, a.serial, a.station, a.nest, a.node, a.lot, a.recipe_name, a.recipe_version, a.recipe_hash, "
    "a.config_hash, a.software, a.operator, a.started_ns, f.outcome, f.ended_ns"
)
#: What stands for others in a serial's pattern; `[[]` is a bracket as such.
_GLOB = {"*": ".*", "?": "."}
#: Rows that come from the server at a time where all are wanted.
_ROWS = 10_000
FROM = "attempt a LEFT JOIN finish f ON f.attempt = a.seq"

_CONDITIONS = {
    "serial_from": "a.serial LIKE %(serial_prefix)s",
    "since_ns": "a.started_ns >= %(since_ns)s",
    "until_ns": "a.started_ns < %(until_ns)s",
    "before": "a.seq < %(before)s",
    "outcome": "f.outcome = %(outcome)s",
    "firmware": """a.seq IN (SELECT attempt FROM result WHERE name = 'identity'
        AND (document::json ->> 'software') = %(firmware)s)""",
    "serial_like": "a.serial ~ %(serial_pattern)s",
    "fixture": """a.config_hash IN (SELECT sha256 FROM document WHERE kind = 'config'
        AND (text::json ->> 'fixture') = %(fixture)s)""",
    "reference": """a.recipe IN (SELECT seq FROM document WHERE kind = 'recipe' AND jsonb_path_exists(
        text::jsonb, '$.reference.**?(@.serial == $r || @.certificate == $r || @.item == $r || @.name == $r)',
        jsonb_build_object('r', %(reference)s::text)))""",
    "check": """f.outcome IN ('FAIL', 'ERROR') AND EXISTS (SELECT 1 FROM result r,
        json_array_elements(r.document::json -> 'reasons') e
        WHERE r.attempt = a.seq AND r.name = 'verdict' AND (e ->> 'check') = %(check)s)""",
}


def where(query: Query) -> tuple[str, dict[str, Any]]:
    """The SQL condition and its parameters."""
    given = {f.name: value for f in fields(query) if (value := getattr(query, f.name)) is not None}
    conditions = [_CONDITIONS.get(name, f"a.{name} = %({name})s") for name in given]
    if "serial_from" in given:
        escaped = given["serial_from"].replace("\\", r"\\").replace("%", r"\%").replace("_", r"\_")
        given["serial_prefix"] = escaped + "%"
    if "serial_like" in given:
        given["serial_pattern"] = (
            "^" + "".join(_GLOB.get(c) or re.escape(c) for c in given["serial_like"].replace("[[]", "[")) + "$"
        )
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


def selection(db: psycopg.Connection, query: Query) -> Iterator[SelectedAttempt]:
    """See LogReader.selection. The rows come portion by portion from a cursor at the server."""
    condition, parameters = where(query)
    sql = f"SELECT a.seq, a.id, f.outcome FROM attempt a JOIN finish f ON f.attempt = a.seq WHERE {condition}"
    with db.transaction(), db.cursor("selection") as cursor:
        cursor.itersize = _ROWS
        for row in cursor.execute(f"{sql} ORDER BY a.seq".encode(), parameters):
            yield SelectedAttempt(*row)


def recipes(db: psycopg.Connection, query: Query) -> list[str]:
    """See LogReader.recipes."""
    condition, parameters = where(query)
    sql = f"""SELECT coalesce(d.text, '') FROM (SELECT min(a.recipe) AS recipe FROM attempt a
        JOIN finish f ON f.attempt = a.seq WHERE {condition} GROUP BY a.recipe_hash) u
        LEFT JOIN document d ON d.seq = u.recipe ORDER BY u.recipe"""
    return [str(text) for (text,) in db.execute(sql.encode(), parameters)]
