"""Raw frames of an attempt: plain while it runs, packed into one sealed record after its finish."""

import sqlite3

from station.domain.framepack import codec, plain
from station.domain.types import Frames

_PLAIN = "SELECT f.data FROM frames f JOIN visit v ON v.seq = f.visit WHERE v.attempt = ? ORDER BY v.seq"

_LEFT = """
    SELECT DISTINCT v.attempt FROM frames f JOIN visit v ON v.seq = f.visit JOIN finish e ON e.attempt = v.attempt"""


def frames(db: sqlite3.Connection, attempt: int) -> list[Frames]:
    """Frames of each visit of the attempt with this record number, in order. Errors: LogError on damaged bytes."""
    row = db.execute("SELECT data FROM archive WHERE attempt = ?", (attempt,)).fetchone()
    if row is not None:
        return codec.unpack(row[0])
    return [plain.from_bytes(data) for (data,) in db.execute(_PLAIN, (attempt,))]


def left(db: sqlite3.Connection) -> list[int]:
    """Finished attempts whose frames are still plain."""
    return [number for (number,) in db.execute(_LEFT)]


def packed(db: sqlite3.Connection, attempt: int) -> bytes | None:
    """The plain frames of all visits of an attempt as one archive; None where packing could lose anything."""
    kept = [data for (data,) in db.execute(_PLAIN, (attempt,))]
    if not kept or len(kept) != visits(db, attempt):
        return None
    data = codec.pack([plain.from_bytes(one) for one in kept])
    same = [plain.to_bytes(one) for one in codec.unpack(data)] == kept
    return data if same else None


def visits(db: sqlite3.Connection, attempt: int) -> int:
    """Number of visits of an attempt."""
    (number,) = db.execute("SELECT count(*) FROM visit WHERE attempt = ?", (attempt,)).fetchone()
    return int(number)


def drop_plain(db: sqlite3.Connection, attempt: int) -> None:
    """Removes the plain frames of an attempt that has its archive."""
    db.execute("DELETE FROM frames WHERE visit IN (SELECT seq FROM visit WHERE attempt = ?)", (attempt,))
