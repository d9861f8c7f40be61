"""What is new in the log since a record: each table is asked by its primary key only."""

import sqlite3

from station.domain.records.tables import TIME_AND_DETAIL
from station.ports.log_reader import LogChange


def _part(table: str) -> str:
    time, detail = TIME_AND_DETAIL[table]
    of = "t.seq" if table == "attempt" else "t.attempt"
    return f"""SELECT * FROM (SELECT t.seq, '{table}', coalesce(a.id, ''), {time}, {detail} FROM "{table}" t
        LEFT JOIN attempt a ON a.seq = {of} WHERE t.seq > :after ORDER BY t.seq LIMIT :limit)"""


_QUERY = " UNION ALL ".join(map(_part, TIME_AND_DETAIL)) + " ORDER BY 1 LIMIT :limit"


def since(db: sqlite3.Connection, after: int, limit: int) -> list[LogChange]:
    """Records with numbers beyond `after`, oldest first, at most `limit`."""
    return [LogChange(*row) for row in db.execute(_QUERY, {"after": after, "limit": limit})]


_DAY_NS = 86_400 * 10**9

# Days (UTC) whose counts may differ since record :after: of attempts that ended since, and of earlier attempts of units
# that came again since, which are no longer the unit's last.
_CHANGED_DAYS = f"""
    SELECT a.started_ns / {_DAY_NS} FROM finish f JOIN attempt a ON a.seq = f.attempt WHERE f.seq > :after
    UNION SELECT p.started_ns / {_DAY_NS} FROM attempt a JOIN attempt p INDEXED BY attempt_serial
        ON p.serial = a.serial AND p.recipe_name = a.recipe_name AND p.seq < a.seq WHERE a.seq > :after"""


def changed_days(db: sqlite3.Connection, after: int) -> frozenset[int]:
    """See LogReader.changed_days."""
    return frozenset(day for (day,) in db.execute(_CHANGED_DAYS, {"after": after}))
