"""Walks every chain that a plant has, with the very check by which its records came in."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import psycopg

from station.adapters.postgres.signatures import verify
from station.domain.records.arrival import REFERENCES, Arrival, Tip
from station.domain.records.chain import IntegrityFinding, Value, canonical
from station.domain.records.tables import COLUMNS
from station.domain.records.wire import WireRecord
from station.errors import LogError
from station.messages import Message
from station.ports.objects import ObjectStore

_LOGS = """SELECT l.id, l.station, l.log_id, l.base, l.base_seal, l.base_key, l.number, l.seal, l.signature, p.revoked
    FROM log l LEFT JOIN log p ON p.id = l.parent ORDER BY l.station, l.id"""
_PORTIONS = "SELECT first_seq, first_seq + last - first FROM batch WHERE log = %s ORDER BY first"


def findings(
    db: psycopg.Connection, objects: ObjectStore | None, progress: Callable[[int], None]
) -> Iterator[IntegrityFinding]:
    """Everything wrong with what the plant has; nothing when it is whole. objects: None leaves the frames out."""
    for log in db.execute(_LOGS).fetchall():
        yield from _of_log(db, objects, log, progress)


def _of_log(
    db: psycopg.Connection, objects: ObjectStore | None, log: Any, progress: Callable[[int], None]
) -> Iterator[IntegrityFinding]:
    id_, station, log_id, base, base_seal, base_key, number, seal = log[:8]
    tip = Tip(log_id, station, bytes(base_key), int(base), bytes(base_seal), names=_names(db, id_))
    for first, last in db.execute(_PORTIONS, [id_]).fetchall():
        records, retired = _records(db, objects, id_, first, last)
        for record in records:
            tip, finding = _step(tip, record, retired)
            if finding is not None:
                yield finding
        progress(tip.number)
    if (tip.number, tip.seal) != (number, bytes(seal)):
        yield _altered(station, tip.number + 1, "missing")


def _names(db: psycopg.Connection, log: int) -> frozenset[str]:
    """What the attempts call the station was checked when they came."""
    rows = db.execute("SELECT DISTINCT station FROM attempt WHERE log = %s", [log]).fetchall()
    return frozenset(str(name) for (name,) in rows)


def _step(tip: Tip, record: WireRecord, retired: set[int]) -> tuple[Tip, IntegrityFinding | None]:
    after = replace(tip, number=record.number, seal=record.hash, signature=record.signature)
    if record.number in retired:
        genuine = bool(record.signature) and verify(tip.key, record.signature, record.hash)
        return after, None if genuine else _altered(tip.station, record.number, "forged")
    arrival = Arrival(tip, verify)
    arrival.take([record])
    refusal = arrival.refusal
    if refusal is None:
        return arrival.tip, None
    if refusal.reason == "unsigned" and not tip.signature:  # before the log's first signature
        return after, None
    return after, _altered(tip.station, refusal.number, refusal.reason)


def _altered(station: str, number: int, what: str) -> IntegrityFinding:
    message = Message("plant-record-altered", station=station, number=number, what=what)
    return IntegrityFinding(what, "", number, message)


def _records(
    db: psycopg.Connection, objects: ObjectStore | None, log: int, first: int, last: int
) -> tuple[list[WireRecord], set[int]]:
    """Records of the plant's numbers first … last of a log as they came; and those whose frames are not there."""
    found, retired = list[WireRecord](), set[int]()
    for table, names in COLUMNS.items():
        columns = ", ".join(f'"{name}"' for name in names)
        query = f"SELECT number, hash, signature, {columns} FROM {table} WHERE log = %s AND seq BETWEEN %s AND %s"
        rows = db.execute(query.encode(), [log, first, last]).fetchall()
        numbers = _numbers(db, table, rows)
        for number, seal, signature, *values in rows:
            own = list[Value](values)
            for at, of in REFERENCES[table]:
                own[at] = None if values[at] is None else numbers.get((of, values[at]), 0)
            if table == "archive" and not _with_frames(own, objects):
                retired.add(number)
            found.append(WireRecord(number, bytes(seal), bytes(signature or b""), canonical(table, names, own)))
    found.sort(key=lambda record: record.number)
    return found, retired


def _with_frames(values: list[Value], objects: ObjectStore | None) -> bool:
    """Puts the packed frames in the place of their hash; False where they are not at hand."""
    sha256 = values[2]
    assert isinstance(sha256, bytes)
    try:
        data = objects.get(sha256) if objects else None
    except LogError:
        data = None
    values[2] = data if data is not None else sha256
    return data is not None


def _numbers(db: psycopg.Connection, table: str, rows: Sequence[Any]) -> dict[tuple[str, int], int]:
    """Numbers in their log of the records that rows refer to by the plant's."""
    found = dict[tuple[str, int], int]()
    for of in ("attempt", "document"):
        wanted = {row[3 + at] for row in rows for at, to in REFERENCES[table] if to == of} - {None}
        if wanted:
            query = f"SELECT seq, number FROM {of} WHERE seq = ANY(%s)"
            found |= {(of, seq): number for seq, number in db.execute(query.encode(), [sorted(wanted)])}
    return found
