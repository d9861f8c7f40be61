"""What a line asks of its own log: the newest events of the station of one kind, and the verdicts of a unit since."""

import sqlite3

from station.ports.log_reader import EventRecord

#: The index of events by attempt serves it: the station's own have none.
_EVENTS = "SELECT seq, at_ns, detail FROM event WHERE attempt IS NULL AND kind = ? ORDER BY seq DESC LIMIT ?"

_OUTCOMES = """SELECT f.outcome FROM attempt a JOIN finish f ON f.attempt = a.seq
    WHERE a.serial = ? AND a.nest = ? AND a.seq > ? ORDER BY a.seq"""


def newest_events(db: sqlite3.Connection, kind: str, newest: int) -> list[EventRecord]:
    """The newest events of the station of a kind, oldest first."""
    rows = db.execute(_EVENTS, (kind, newest)).fetchall()
    return [EventRecord(number, "", at_ns, kind, detail) for number, at_ns, detail in reversed(rows)]


def outcomes(db: sqlite3.Connection, serial: str, nest: str, beyond: int) -> list[str]:
    """Outcomes of the finished attempts of a unit in a nest that began after that record, oldest first."""
    return [str(row[0]) for row in db.execute(_OUTCOMES, (serial, nest, beyond))]
