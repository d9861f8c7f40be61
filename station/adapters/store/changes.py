"""What is new in the log since a record: each table is asked by its primary key only."""

import sqlite3
from dataclasses import dataclass

#: Table → SQL for its time and what it is about, in a word.
_TIME_AND_DETAIL = {
    "attempt": ("t.started_ns", "t.serial"),
    "event": ("t.at_ns", "t.kind"),
    "visit": ("t.left_ns", "t.kind || ' ' || t.position"),
    "write": ("t.at_ns", "t.stage || ' ' || t.name"),
    "result": ("t.at_ns", "t.name"),
    "finish": ("t.ended_ns", "t.outcome"),
}


@dataclass(frozen=True, slots=True)
class LogChange:
    """One new record. number: the cursor for the next call; what: attempt | event | visit | write | result | finish;
    attempt: its id, "" for an event of the station; detail: serial, kind, position, name or outcome."""

    number: int
    what: str
    attempt: str
    at_ns: int
    detail: str


def _part(table: str) -> str:
    time, detail = _TIME_AND_DETAIL[table]
    of = "t.seq" if table == "attempt" else "t.attempt"
    return f"""SELECT * FROM (SELECT t.seq, '{table}', coalesce(a.id, ''), {time}, {detail} FROM "{table}" t
        LEFT JOIN attempt a ON a.seq = {of} WHERE t.seq > :after ORDER BY t.seq LIMIT :limit)"""


_QUERY = " UNION ALL ".join(map(_part, _TIME_AND_DETAIL)) + " ORDER BY 1 LIMIT :limit"


def since(db: sqlite3.Connection, after: int, limit: int) -> list[LogChange]:
    """Records with numbers beyond `after`, oldest first, at most `limit`."""
    return [LogChange(*row) for row in db.execute(_QUERY, {"after": after, "limit": limit})]
