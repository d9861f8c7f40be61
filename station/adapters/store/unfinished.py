"""What a start-up finds: attempts that have begun and not ended, and units that may be half written."""

import json
import sqlite3

from station.adapters.store.schema import SPAN
from station.domain.recipe.serial import spellings
from station.ports.store import SuspectAttempt, UnfinishedAttempt, WriteRecord

_ATTEMPTS = """
    SELECT a.seq, a.id, a.serial, a.station, a.nest, a.node, a.started_ns, coalesce(d.text, ''),
        (SELECT kind FROM event WHERE attempt = a.seq ORDER BY seq DESC LIMIT 1),
        (SELECT count(*) FROM visit WHERE seq > a.seq AND attempt = a.seq)
    FROM attempt a LEFT JOIN document d ON d.seq = a.product
    WHERE NOT EXISTS (SELECT 1 FROM finish f WHERE f.attempt = a.seq) ORDER BY a.seq"""

_WRITES = f"""
    SELECT object, sub, name, old, written, read_back, value, stage FROM "write" WHERE {SPAN} ORDER BY seq"""


def find_unfinished(db: sqlite3.Connection) -> list[tuple[int, UnfinishedAttempt]]:
    """Record number and content of every attempt without an end, oldest first."""
    begun, ended = db.execute("SELECT (SELECT count(*) FROM attempt), (SELECT count(*) FROM finish)").fetchone()
    if begun == ended:
        return []
    unfinished = []
    for number, uid, serial, station, nest, node, started_ns, product, event, visits in db.execute(_ATTEMPTS):
        writes = tuple(WriteRecord(*row) for row in db.execute(_WRITES, {"a": number}))
        state = UnfinishedAttempt(uid, serial, station, nest, node, started_ns, event or "", visits, writes, product)
        unfinished.append((number, state))
    return unfinished


_OF_SERIALS = "SELECT seq, id, started_ns FROM attempt WHERE serial IN ({}) ORDER BY seq DESC"

_RESULT = f"SELECT document FROM result WHERE {SPAN} AND name = :name ORDER BY seq DESC LIMIT 1"

_LAST_WORD = f"""
    SELECT state FROM (
        SELECT seq, json_extract(document, '$.state') AS state FROM result WHERE {SPAN} AND name = 'device-state'
        UNION ALL
        SELECT seq, json_extract(detail, '$.state') FROM event WHERE attempt = :a AND kind = 'device-state'
    ) ORDER BY seq DESC LIMIT 1"""


def find_suspect(db: sqlite3.Connection, serial: str) -> SuspectAttempt | None:
    """See Store.suspect. A serial with other leading zeros is the same device."""
    spelt = spellings(serial)
    query = _OF_SERIALS.format(", ".join("?" * len(spelt)))
    for number, uid, started_ns in db.execute(query, spelt).fetchall():
        planned = _objects(db, number, "write-plan")
        if planned is None:
            continue
        word = db.execute(_LAST_WORD, {"a": number}).fetchone()
        state = word[0] if word is not None else ""
        if state in ("old", "new"):
            return None
        return SuspectAttempt(uid, serial, started_ns, state, _objects(db, number, "old-calibration") or {}, planned)
    return None


def _objects(db: sqlite3.Connection, number: int, name: str) -> dict[str, str] | None:
    row = db.execute(_RESULT, {"a": number, "name": name}).fetchone()
    return None if row is None else dict(json.loads(row[0])["objects"])
