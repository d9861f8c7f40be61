"""Finds attempts: one query for every question of containment, by the index that suits it."""

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, fields

_COLUMNS = (
    "a.seq, a.id, a.serial, a.station, a.nest, a.node, a.lot, a.recipe_name, a.recipe_version, a.recipe_hash, "
    "a.config_hash, a.software, a.operator, a.started_ns, f.outcome, f.ended_ns"
)


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt's row; outcome and ended_ns are None while it runs. number: its record in the chain."""

    number: int
    attempt: str
    serial: str
    station: str
    nest: str
    node: int
    lot: str
    recipe_name: str
    recipe_version: int
    recipe_hash: str
    config_hash: str
    software: str
    operator: str
    started_ns: int
    outcome: str | None
    ended_ns: int | None


@dataclass(frozen=True, slots=True)
class Query:
    """Which attempts; what is None does not matter. Times are of the start, since_ns included, until_ns not.

    serial_from: serials that begin with it. before: only records numbered below, to page backwards.
    """

    serial: str | None = None
    serial_from: str | None = None
    station: str | None = None
    nest: str | None = None
    lot: str | None = None
    operator: str | None = None
    software: str | None = None
    recipe_name: str | None = None
    recipe_hash: str | None = None
    firmware: str | None = None
    outcome: str | None = None
    since_ns: int | None = None
    until_ns: int | None = None
    before: int | None = None

    def where(self) -> tuple[str, dict[str, object]]:
        """The SQL condition and its parameters.

        A plus before a column keeps SQLite from its index: without statistics it would often take the wrong one.
        """
        said = {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) is not None}
        by = next((name for name in _KEYS if name in said), "")
        conditions = {name: _CONDITIONS.get(name, f"{'' if name == by else '+'}a.{name} = :{name}") for name in said}
        if set(said) - {"firmware"}:
            conditions |= {"firmware": _FIRMWARE_PROBED} if "firmware" in said else {}
        return " AND ".join(["1", *conditions.values()]), said


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


def attempts(db: sqlite3.Connection, query: Query, limit: int | None = None) -> Iterator[Attempt]:
    """Attempts that the query names, newest first, one at a time."""
    where, parameters = query.where()
    sql = f"SELECT {_COLUMNS} FROM attempt a LEFT JOIN finish f ON f.attempt = a.seq WHERE {where} ORDER BY a.seq DESC"
    for row in db.execute(f"{sql} LIMIT :limit", {**parameters, "limit": -1 if limit is None else limit}):
        yield Attempt(*row)


def count(db: sqlite3.Connection, query: Query) -> int:
    """How many attempts the query names."""
    where, parameters = query.where()
    sql = f"SELECT count(*) FROM attempt a LEFT JOIN finish f ON f.attempt = a.seq WHERE {where}"
    return int(db.execute(sql, parameters).fetchone()[0])
