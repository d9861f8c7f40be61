"""The plant's database as a receiver needs it (`ports.plant.PlantStore`), and what a person decides about it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psycopg

from station.adapters.postgres.arriving import LogRow, PostgresArrivingLog
from station.adapters.postgres.connections import Connections
from station.domain.records.arrival import RecordRefusal, RefusalReason, Tip, refuse
from station.errors import StoreFault
from station.messages import Message
from station.ports.objects import ObjectStore
from station.ports.plant import QuarantineEntry, StationStanding

#: Of all who open a station's first log, one at a time: "plan" in hexadecimal of its letters, and the name's hash.
_FIRST = "SELECT pg_advisory_xact_lock(1886150000, hashtext(%s))"
_ROW = "id, log_id, number, seal, signature, key, revoked, parent, base"
_DECIDE = """UPDATE quarantine SET resolved_ns = %s, resolved_by = %s, resolution = %s
    WHERE station = %s AND log_id = %s AND resolved_ns IS NULL"""


class PostgresPlant:
    """names: further names of a station that its attempts may bear, by station. Errors: StoreFault."""

    def __init__(self, connections: Connections, objects: ObjectStore, names: dict[str, frozenset[str]]) -> None:
        self._connections, self._objects, self._names = connections, objects, names

    @contextmanager
    def arriving(self, station: str, log_id: str, key: bytes) -> Iterator[PostgresArrivingLog]:
        """The log, its row locked until the block ends."""
        names = self._names.get(station, frozenset({station}))
        start = Tip.start(log_id, station, key, names)
        with self._connections.one() as connection, connection.transaction():
            query = f"SELECT {_ROW} FROM log WHERE station = %s AND current FOR UPDATE"
            current = connection.execute(query, [station]).fetchone()
            if current is None:  # there is no row to lock yet
                connection.execute(_FIRST, [station])
                current = connection.execute(query, [station]).fetchone()
            foreign = connection.execute(
                "SELECT station FROM log WHERE log_id = %s AND station <> %s LIMIT 1", [log_id, station]
            ).fetchone()
            row, other = None, None
            if current is not None and current[1] == log_id:
                row = _log_row(connection, current, station, names)
            elif current is not None:
                other = refuse(RefusalReason.OTHER_LOG, station, 1), int(current[2])
            if foreign:
                other = refuse(RefusalReason.OTHER_STATION, station, 1), 0
            yield PostgresArrivingLog(connection, self._objects, station, start, row, other)

    def standings(self) -> list[StationStanding]:
        """Every station's current log, by name."""
        query = """SELECT l.station, l.log_id, l.number, l.newest, l.last_ns,
            (SELECT count(*) FROM quarantine q WHERE q.station = l.station AND q.resolved_ns IS NULL)
            FROM log l WHERE l.current ORDER BY l.station"""
        with self._connections.one() as connection:
            return [StationStanding(*row) for row in connection.execute(query)]

    def quarantined(self, *, resolved: bool = False) -> list[QuarantineEntry]:
        """What waits for a person, oldest first; resolved: what was decided, too."""
        query = f"""SELECT id, station, log_id, number, reason, message, first_ns, last_ns, times, resolved_ns
            FROM quarantine WHERE {"true" if resolved else "resolved_ns IS NULL"} ORDER BY id"""
        with self._connections.one() as connection:
            return [_entry(row) for row in connection.execute(query)]

    def adopt(self, station: str, log_id: str, by: str, reason: str, at_ns: int) -> str:
        """Takes a log that was set apart as the station's from here on; what the plant has stays as it is.

        A fork or a log that ends earlier becomes a branch from the last record that both share; another log takes the
        place of the one before. What was decided. Errors: StoreFault where nothing of that log is set apart.
        """
        with self._connections.one() as connection, connection.transaction():
            found = connection.execute(
                """SELECT reason, min(number) FROM quarantine WHERE station = %s AND log_id = %s AND resolved_ns IS NULL
                AND reason IN ('fork', 'older', 'other-log') GROUP BY reason ORDER BY reason LIMIT 1""",
                [station, log_id],
            ).fetchone()
            if found is None:
                raise StoreFault(Message("plant-nothing-apart", station=station, log_id=log_id))
            kind, number = str(found[0]), int(found[1])
            current = connection.execute(
                f"SELECT {_ROW} FROM log WHERE station = %s AND current FOR UPDATE", [station]
            ).fetchone()
            connection.execute("UPDATE log SET current = false WHERE station = %s", [station])
            if kind == RefusalReason.OTHER_LOG or current is None:
                self._replace(connection, station, log_id, current)
            else:
                self._branch(connection, station, current, number - 1)
            connection.execute(_DECIDE, [at_ns, by, reason, station, log_id])
        return kind

    def reject(self, station: str, log_id: str, by: str, reason: str, at_ns: int) -> int:
        """Decides that what is set apart of a log stays out; it is kept, and waits again if it comes again. How much.

        Errors: StoreFault where nothing of that log waits.
        """
        with self._connections.one() as connection:
            count = connection.execute(_DECIDE, [at_ns, by, reason, station, log_id]).rowcount
        if not count:
            raise StoreFault(Message("plant-nothing-waits", station=station, log_id=log_id))
        return count

    def _replace(self, connection: psycopg.Connection, station: str, log_id: str, current: Any) -> None:
        """The newest branch of that log goes on, or a new one begins."""
        known = connection.execute(
            "UPDATE log SET current = true WHERE id = (SELECT max(id) FROM log WHERE log_id = %s AND station = %s) "
            "RETURNING id",
            [log_id, station],
        ).fetchone()
        if known is None:
            start = Tip.start(log_id, station, bytes(current[5]) if current else b"")
            connection.execute(
                """INSERT INTO log (station, log_id, base_seal, base_key, number, seal, key)
                VALUES (%s, %s, %s, %s, 0, %s, %s)""",
                [station, log_id, start.seal, start.key, start.seal, start.key],
            )

    def _branch(self, connection: psycopg.Connection, station: str, current: Any, base: int) -> None:
        row = _log_row(connection, current, station, frozenset())
        before = PostgresArrivingLog(connection, self._objects, station, row.tip, row, None)
        start = Tip.start(row.tip.log_id, station, row.tip.key)
        seal = before.seals(base, base)[0] if base else start.seal
        connection.execute(
            """INSERT INTO log (station, log_id, branch, parent, base, base_seal, base_key, number, seal, key, revoked)
            SELECT station, log_id, branch + 1, id, %s, %s, key, %s, %s, key, revoked FROM log WHERE id = %s""",
            [base, seal, base, seal, row.id],
        )

    def location(self) -> str:
        """As sentences name the database."""
        return self._connections.location


def _log_row(connection: psycopg.Connection, found: Any, station: str, names: frozenset[str]) -> LogRow:
    id_, log_id, number, seal, signature, key, revoked, parent, base = found
    tip = Tip(log_id, station, bytes(key), number, bytes(seal), bytes(signature), json.loads(revoked), names)
    lineage = [(int(id_), int(number))]
    until = int(base)
    while parent is not None:
        lineage.append((int(parent), until))
        above = connection.execute("SELECT parent, base FROM log WHERE id = %s", [parent]).fetchone()
        assert above
        parent, until = above[0], min(until, int(above[1]))
    return LogRow(int(id_), tip, tuple(lineage))


def _entry(row: Any) -> QuarantineEntry:
    id_, station, log_id, number, reason, message, first_ns, last_ns, times, resolved_ns = row
    refusal = RecordRefusal(RefusalReason(reason), number, Message.of(json.loads(message)))
    return QuarantineEntry(id_, station, log_id, number, refusal, first_ns, last_ns, times, resolved_ns)
