"""One station's log inside one transaction: what has arrived is looked up, appended, or set apart."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import psycopg
from psycopg import errors, sql

from station.domain.product import product_record
from station.domain.records.arrival import REFERENCES, ArrivedRecord, RecordRefusal, RefusalReason, Tip, refuse
from station.domain.records.chain import Value
from station.domain.records.tables import COLUMNS, TABLES
from station.domain.records.wire import WireRecord, encode
from station.ports.objects import ObjectStore
from station.ports.plant import Claim

#: Of a record that is set apart, so much is kept.
_MOST_QUARANTINED_BYTES = 65_536
#: What PostgreSQL refuses for the values themselves.
_UNSTORABLE = (psycopg.DataError, psycopg.IntegrityError, errors.ProgramLimitExceeded)

_HEAD = {"seq": "int8", "log": "int4", "number": "int8", "hash": "bytea", "signature": "bytea"}
_TYPES: Mapping[type, str] = {int: "int8", float: "float8", str: "text", bytes: "bytea"}
#: Of each table, its columns and their types in the database.
_COLUMNS = {
    table: _HEAD | {c.name: _TYPES[c.type] for c in columns} | ({"product_name": "text"} if table == "attempt" else {})
    for table, columns in TABLES.items()
}
_COPY = {
    table: sql.SQL("COPY {} ({}) FROM STDIN (FORMAT BINARY)").format(
        sql.Identifier(table), sql.SQL(", ").join(map(sql.Identifier, columns))
    )
    for table, columns in _COLUMNS.items()
}

_SEALS = " UNION ALL ".join(
    f'SELECT t.number, t.hash FROM "{table}" t JOIN s ON t.seq BETWEEN s.from_seq AND s.to_seq' for table in COLUMNS
)
#: A record's own number is its portion's first one and its distance from there.
_SEALS_BETWEEN = f"""WITH s AS (SELECT first_seq + greatest(%(first)s - first, 0) AS from_seq,
        first_seq + least(%(last)s, last) - first AS to_seq
    FROM batch WHERE log = %(log)s AND first <= %(last)s AND last >= %(first)s)
    SELECT number, hash FROM ({_SEALS}) x ORDER BY number"""

_ADD_PORTION = """INSERT INTO batch (log, first, last, first_seq, seal, signature, at_ns)
    VALUES (%s, %s, %s, %s, %s, %s, %s)"""

_MOVE_TIP = """UPDATE log SET number = %s, seal = %s, signature = %s, key = %s, revoked = %s, newest = %s, last_ns = %s
    WHERE id = %s"""

_ARRIVED_AFTER_ALL = """UPDATE quarantine SET resolved_ns = %s, resolved_by = 'plant', resolution = 'arrived'
    WHERE station = %s AND log_id = %s AND number <= %s AND number >= %s AND resolved_ns IS NULL
    AND reason NOT IN ('fork', 'older', 'other-log', 'other-station')"""

_NOTE_REPEATS = """INSERT INTO repeat SELECT a.seq, e.seq FROM attempt a CROSS JOIN LATERAL (
        SELECT max(b.seq) AS seq FROM attempt b WHERE b.serial = a.serial AND b.recipe_name = a.recipe_name
        AND b.seq < a.seq) e
    WHERE a.seq BETWEEN %s AND %s AND e.seq IS NOT NULL"""

_KEEP_OBJECT = """INSERT INTO object (sha256, bytes, kept_ns) VALUES (%s, %s, %s)
    ON CONFLICT (sha256) DO UPDATE SET retired_ns = NULL"""

_QUARANTINE = """INSERT INTO quarantine (station, log_id, number, reason, message, seal, records, first_ns, last_ns)
    VALUES (%s, %s, %s, %s, %s, %s, %s, %s, %s)
    ON CONFLICT (station, log_id, number, reason, seal) DO UPDATE
    SET last_ns = excluded.last_ns, times = quarantine.times + 1, resolved_ns = NULL"""


@dataclass(frozen=True, slots=True)
class LogRow:
    """The row of a log. lineage: ids of the branches that it goes on from, itself first, each with the last number
    that counts."""

    id: int
    tip: Tip
    lineage: tuple[tuple[int, int], ...]


class PostgresArrivingLog:
    """Implements `ports.plant.ArrivingLog`; the transaction and the lock of the log's row are its maker's."""

    def __init__(
        self,
        connection: psycopg.Connection,
        objects: ObjectStore,
        station: str,
        start: Tip,
        row: LogRow | None,
        other: tuple[RecordRefusal, int] | None,
    ) -> None:
        self._connection, self._objects, self._station, self._start = connection, objects, station, start
        self._row, self.other = row, other

    @property
    def tip(self) -> Tip | None:
        """How far the log has come."""
        return self._row.tip if self._row else None

    def seals(self, first: int, last: int) -> list[bytes]:
        """The seals of records first … last."""
        if self._row is None:
            return []
        found = dict[int, bytes]()
        for log, until in reversed(self._row.lineage):
            query = {"log": log, "first": first, "last": min(last, until)}
            found |= {number: bytes(seal) for number, seal in self._connection.execute(_SEALS_BETWEEN, query)}
        return [found[number] for number in range(first, last + 1) if number in found]

    def append(self, tip: Tip, records: Sequence[ArrivedRecord], claim: Claim, at_ns: int) -> RecordRefusal | None:
        """Keeps the records; why not, where one cannot be kept."""
        try:
            with self._connection.transaction():
                return self._append(tip, records, claim, at_ns)
        except _UNSTORABLE:
            return refuse(RefusalReason.UNSTORABLE, self._station, self._first_unstorable(tip, records, claim, at_ns))

    def _append(self, tip: Tip, records: Sequence[ArrivedRecord], claim: Claim, at_ns: int) -> RecordRefusal | None:
        if not records:
            # A log is known by its first record, and by whose key it is signed. What brings nothing new says nothing of
            # the station: anybody who has recorded a portion can send it again.
            return None
        row = self._row or self._open()
        last = self._numbers(len(records))
        first_seq = last - len(records) + 1
        known = _Known(self._connection, row, records, first_seq)
        if (stranger := known.first_stranger(records)) is not None:
            return refuse(RefusalReason.UNKNOWN_ATTEMPT, self._station, stranger)
        self._copy(row.id, records, first_seq, known, at_ns)
        if any(record.table == "attempt" for record in records):
            self._connection.execute(_NOTE_REPEATS, (first_seq, last))
        if any(record.table in ("attempt", "finish") for record in records):
            self._connection.execute("SELECT count_yields(%s, %s)", (first_seq, last))
        self._connection.execute(
            _ADD_PORTION,
            (row.id, records[0].number, tip.number, first_seq, tip.seal, tip.signature, at_ns),
        )
        arrived = (at_ns, self._station, tip.log_id, tip.number, records[0].number)
        self._connection.execute(_ARRIVED_AFTER_ALL, arrived)
        revoked = json.dumps(dict(tip.revoked))
        newest = max(claim.newest, tip.number)
        moved = (tip.number, tip.seal, tip.signature, tip.key, revoked, newest, at_ns, row.id)
        self._connection.execute(_MOVE_TIP, moved)
        self._row = LogRow(row.id, tip, ((row.id, tip.number), *row.lineage[1:]))
        return None

    def _open(self) -> LogRow:
        start = self._start
        made = self._connection.execute(
            """INSERT INTO log (station, log_id, base_seal, base_key, number, seal, key)
            VALUES (%s, %s, %s, %s, 0, %s, %s) RETURNING id""",
            [self._station, start.log_id, start.seal, start.key, start.seal, start.key],
        ).fetchone()
        assert made
        return LogRow(int(made[0]), start, ((int(made[0]), 0),))

    def _numbers(self, count: int) -> int:
        """The last of so many numbers of the plant; partitions for them are there."""
        found = self._connection.execute("UPDATE counter SET last = last + %s RETURNING last, room", [count]).fetchone()
        assert found
        last, room = int(found[0]), int(found[1])
        if last > room:
            self._connection.execute("SELECT make_room(%s)", [last])
        return last

    def _copy(self, log: int, records: Sequence[ArrivedRecord], first_seq: int, known: "_Known", at_ns: int) -> None:
        rows: dict[str, list[tuple[Value, ...]]] = {}
        objects = list[tuple[bytes, int, int]]()
        for seq, record in enumerate(records, first_seq):
            values = known.resolved(record)
            if record.table == "archive":
                data = values[2]
                assert isinstance(data, bytes)
                objects.append((self._objects.put(data), len(data), at_ns))
                values = (*values[:2], objects[-1][0])
            head = (seq, log, record.number, record.hash, record.signature or None)
            rows.setdefault(record.table, []).append((*head, *values))
        with self._connection.cursor() as cursor:
            if objects:
                cursor.executemany(_KEEP_OBJECT, objects)
            for table, found in rows.items():
                with cursor.copy(_COPY[table]) as copy:
                    copy.set_types(list(_COLUMNS[table].values()))
                    for row in found:
                        copy.write_row(row)

    def _first_unstorable(self, tip: Tip, records: Sequence[ArrivedRecord], claim: Claim, at_ns: int) -> int:
        """By halves: how many of the first records can be kept."""
        row, good, bad = self._row, 0, len(records)
        while bad - good > 1:
            middle = (good + bad) // 2
            try:
                with self._connection.transaction(force_rollback=True):
                    self._append(tip, records[:middle], claim, at_ns)
                good = middle
            except _UNSTORABLE:
                bad = middle
            self._row = row
        return records[bad - 1].number

    def quarantine(self, refusal: RecordRefusal, records: Sequence[WireRecord], at_ns: int) -> None:
        """Keeps what was refused as it came, apart from all that counts."""
        own = next((r for r in records if r.number == refusal.number), records[0] if records else None)
        kept = encode([own])[:_MOST_QUARANTINED_BYTES] if own else b""
        what = refusal.number, refusal.reason, json.dumps(refusal.message.document()), own.hash if own else b""
        self._connection.execute(_QUARANTINE, (self._station, self._start.log_id, *what, kept, at_ns, at_ns))


class _Known:
    """Where the records are that a portion's records refer to, and what a product is called."""

    def __init__(
        self, connection: psycopg.Connection, row: LogRow, records: Sequence[ArrivedRecord], first_seq: int
    ) -> None:
        self._connection, self._row = connection, row
        here = {
            table: {r.number: first_seq + i for i, r in enumerate(records) if r.table == table} for table in _REFERRED
        }
        self._seq: Mapping[str, dict[int, int]] = here
        for table in _REFERRED:
            here[table] |= self._elsewhere(table, {n for n in _referred(records, table) if n not in here[table]})
        self._names = self._product_names(records)

    def first_stranger(self, records: Sequence[ArrivedRecord]) -> int | None:
        """The first record that refers to one that the log does not hold before it."""
        for record in records:
            for at, table in REFERENCES[record.table]:
                number = record.values[at]
                if number is not None and (number not in self._seq[table] or int(number) >= record.number):
                    return record.number
        return None

    def resolved(self, record: ArrivedRecord) -> tuple[Value, ...]:
        """The record's values, its references being the plant's numbers."""
        values = list(record.values)
        for at, table in REFERENCES[record.table]:
            number = values[at]
            values[at] = None if number is None else self._seq[table][int(number)]
        if record.table == "attempt":
            values.append(self._names.get(record.values[_PRODUCT], ""))
        return tuple(values)

    def _elsewhere(self, table: str, numbers: set[int]) -> dict[int, int]:
        if not numbers:
            return {}
        query = sql.SQL("SELECT number, seq FROM {} WHERE log = %s AND number <= %s AND number = ANY(%s)")
        found = dict[int, int]()
        for log, until in reversed(self._row.lineage):
            until_now = until if log != self._row.id else self._row.tip.number
            rows = self._connection.execute(
                query.format(sql.Identifier(table)), [log, until_now, sorted(numbers)]
            ).fetchall()
            found |= {int(number): int(seq) for number, seq in rows}
        return found

    def _product_names(self, records: Sequence[ArrivedRecord]) -> dict[Value, str]:
        texts = {r.number: str(r.values[2]) for r in records if r.table == "document"}
        wanted = {r.values[_PRODUCT] for r in records if r.table == "attempt"} - {None}
        missing = {self._seq["document"][int(n)]: n for n in wanted if n not in texts and n in self._seq["document"]}
        if missing:
            query = "SELECT seq, text FROM document WHERE seq = ANY(%s)"
            rows = self._connection.execute(query, [sorted(missing)]).fetchall()
            texts |= {int(missing[seq] or 0): text for seq, text in rows}
        return {number: product_record.name_in(texts.get(int(number or 0), "")) for number in wanted}


_REFERRED = ("attempt", "document")
_PRODUCT = COLUMNS["attempt"].index("product")


def _referred(records: Sequence[ArrivedRecord], table: str) -> set[int]:
    return {
        int(number)
        for r in records
        for at, of in REFERENCES[r.table]
        if of == table and isinstance(number := r.values[at], int)
    }
