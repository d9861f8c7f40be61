"""What a start-up finds: attempts that have begun and not ended."""

import sqlite3

from station.adapters.store.schema import SPAN
from station.ports.store import Unfinished, WriteRecord

_ATTEMPTS = """
    SELECT a.seq, a.id, a.serial, a.station, a.nest, a.node, a.started_ns, coalesce(d.text, ''),
        (SELECT kind FROM event WHERE attempt = a.seq ORDER BY seq DESC LIMIT 1),
        (SELECT count(*) FROM visit WHERE seq > a.seq AND attempt = a.seq)
    FROM attempt a LEFT JOIN document d ON d.seq = a.product
    WHERE NOT EXISTS (SELECT 1 FROM finish f WHERE f.attempt = a.seq) ORDER BY a.seq"""

_WRITES = f"""
    SELECT object, sub, name, old, written, read_back, value, stage FROM "write" WHERE {SPAN} ORDER BY seq"""


def find(db: sqlite3.Connection) -> list[tuple[int, Unfinished]]:
    """Record number and content of every attempt without an end, oldest first."""
    begun, ended = db.execute("SELECT (SELECT count(*) FROM attempt), (SELECT count(*) FROM finish)").fetchone()
    if begun == ended:
        return []
    found = []
    for number, uid, serial, station, nest, node, started_ns, product, event, visits in db.execute(_ATTEMPTS):
        writes = tuple(WriteRecord(*row) for row in db.execute(_WRITES, {"a": number}))
        state = Unfinished(uid, serial, station, nest, node, started_ns, event or "", visits, writes, product)
        found.append((number, state))
    return found
