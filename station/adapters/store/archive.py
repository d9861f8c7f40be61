"""Raw frames of an attempt: plain while it runs, packed into one sealed record after its finish."""

import sqlite3

from station.adapters.store.schema import SPAN
from station.domain.core.types import Frames
from station.domain.records.framepack import codec, plain

_VISITS = f"SELECT seq FROM visit WHERE {SPAN}"

_PLAIN = f"SELECT data FROM frames WHERE visit IN ({_VISITS}) ORDER BY visit"

_UNPACKED = """
    SELECT DISTINCT v.attempt FROM frames f JOIN visit v ON v.seq = f.visit JOIN finish e ON e.attempt = v.attempt"""


def frames(db: sqlite3.Connection, attempt: int) -> list[Frames]:
    """Frames of each visit of the attempt with this record number, in order. Errors: LogError on damaged bytes."""
    row = db.execute("SELECT data FROM archive WHERE attempt = ?", (attempt,)).fetchone()
    if row is not None:
        return codec.unpack(row[0])
    return [plain.from_bytes(data) for (data,) in db.execute(_PLAIN, {"a": attempt})]


def unpacked_attempts(db: sqlite3.Connection) -> list[int]:
    """Finished attempts whose frames are still plain."""
    return [number for (number,) in db.execute(_UNPACKED)]


def pack_frames(db: sqlite3.Connection, attempt: int) -> bytes | None:
    """The plain frames of all visits of an attempt as one archive; None where packing could lose anything."""
    stored = [data for (data,) in db.execute(_PLAIN, {"a": attempt})]
    if not stored or len(stored) != count_visits(db, attempt):
        return None
    data = codec.pack([plain.from_bytes(one) for one in stored])
    forms = map(plain.form_of, stored)
    same = [plain.to_bytes(one, form) for one, form in zip(codec.unpack(data), forms, strict=True)] == stored
    return data if same else None


def count_visits(db: sqlite3.Connection, attempt: int) -> int:
    """Number of visits of an attempt."""
    return len(db.execute(_VISITS, {"a": attempt}).fetchall())


def drop_plain(db: sqlite3.Connection, attempt: int) -> None:
    """Removes the plain frames of an attempt that has its archive."""
    db.execute(f"DELETE FROM frames WHERE visit IN ({_VISITS})", {"a": attempt})
