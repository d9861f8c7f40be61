"""Edits a log at random behind the station's back, and counts the edits that `station audit --verify` finds.

    python tests/endurance/torture_edits.py [--edits 10000] [--seed 1] [--json]

Every edit is made in SQL with the guards off, as somebody with the file in hands would: any value of any record
changed, records deleted, inserted, copied, swapped, moved, the end cut off with the log's own note of it brought into
line, raw frames and notes altered. Then the log is checked, and the edit undone.
"""

import argparse
import json
import sqlite3
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from sqlite_utils import Database

from station.adapters.store import verify
from station.adapters.store.keys import Signer
from station.adapters.store.schema import COLUMNS
from station.adapters.store.sqlite import SqliteStore
from station.domain.core.types import Frames
from station.ports.store import AttemptStart, VisitRecord, WriteRecord

Rng = np.random.Generator
Edit = Callable[[sqlite3.Connection, Rng], str]
SEALS = ("previous", "hash", "signature")


def make(path: Path, signer: Signer | None = None, attempts: int = 4) -> None:
    """A log with a few attempts, the last of them unfinished, so that it has packed and plain frames."""
    rng = np.random.default_rng(1)
    with SqliteStore(path, signer=signer) as store:
        for number in range(attempts):
            attempt = store.begin(begin(f"SN{number}"))
            store.event(attempt, "identified", {"serial": number})
            store.result(attempt, "identity", {"software": "1.0", "serial": number})
            store.visit([attempt] * 2, [visit(v, rng) for v in range(2)])
            for stage in ("intent", "verified"):
                store.write(attempt, WriteRecord(0x2101, 1, "gain", b"\0\0\x80?", b"\1\0\x80?", None, 1.0, stage))
            store.result(attempt, "calibration", {"offset": rng.normal(size=3), "outcome": "PASS"})
            if number < attempts - 1:
                store.finish(attempt, "PASS", 2_000_000_000 + number)
                store.tidy()


def begin(serial: str) -> AttemptStart:
    """What the station would say of a unit."""
    shown = {"recipe_hash": "ab" * 32, "recipe_json": '{"name": "six-point"}', "config_hash": "cd" * 32}
    return AttemptStart(
        serial, "bench-1", "A", 1, "six-point", 1, software="0.1.0", operator="op", started_ns=1, **shown
    )


def visit(number: int, rng: Rng) -> VisitRecord:
    """A short stop."""
    data = rng.integers(0, 255, (20, 8), dtype=np.uint8)
    frames = Frames(np.arange(20) * 10**7, np.full(20, 0x181, np.uint32), np.full(20, 8, np.uint8), data)
    return VisitRecord(0, number, "z-up", "home", "tumble", 1, 2, frames, {"mean": rng.normal(size=3), "count": 20})


def pick(db: sqlite3.Connection, rng: Rng, table: str = "") -> tuple[str, int]:
    """A record at random: table and number."""
    tables = [table] if table else list(COLUMNS)
    rows = [(t, n) for t in tables for (n,) in db.execute(f"SELECT seq FROM {t}")]
    return rows[int(rng.integers(len(rows)))]


def other(value: object, rng: Rng) -> object:
    """Another value of the same type, near the old one or far away."""
    if value is None:
        return None
    if isinstance(value, bytes | str):
        raw = bytearray(value.encode() if isinstance(value, str) else value) or bytearray(b"?")
        raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(7))
        return raw.decode("utf-8", "replace") + "\u00b7" if isinstance(value, str) else bytes(raw)
    if isinstance(value, int):
        return value + int(rng.choice([-1, 1, 1000, 2**33]))
    assert isinstance(value, float)
    return float(np.nextafter(value, np.inf)) if rng.random() < 0.5 else -float(value) - 1


def change(db: sqlite3.Connection, rng: Rng) -> str:
    """One value of one record."""
    table, number = pick(db, rng)
    columns = [*SEALS, *COLUMNS[table]]
    column = columns[int(rng.integers(len(columns)))]
    (value,) = db.execute(f"SELECT {column} FROM {table} WHERE seq = ?", (number,)).fetchone()
    new = other(value, rng)
    if value is None:
        (kind,) = [row[2] for row in db.execute(f"PRAGMA table_info({table})") if row[1] == column]
        new = {"INTEGER": 1, "REAL": 0.5, "TEXT": "x", "BLOB": b"x"}[kind]
    db.execute(f"UPDATE {table} SET {column} = ? WHERE seq = ?", (new, number))
    return f"change {table}.{column}"


def renumber(db: sqlite3.Connection, rng: Rng) -> str:
    """A record moved to another number, past the end or below the start."""
    table, number = pick(db, rng)
    db.execute(f"UPDATE {table} SET seq = ? WHERE seq = ?", (int(rng.choice([-1, 0, 10**6, 10**12])), number))
    return f"renumber {table}"


def delete(db: sqlite3.Connection, rng: Rng) -> str:
    """One record, or a row of them in the middle."""
    if rng.random() < 0.7:
        table, number = pick(db, rng)
        db.execute(f"DELETE FROM {table} WHERE seq = ?", (number,))
        return f"delete {table}"
    _, number = pick(db, rng)
    for table in COLUMNS:
        db.execute(f"DELETE FROM {table} WHERE seq BETWEEN ? AND ?", (number, number + int(rng.integers(5))))
    return "delete a row of records"


def close_gap(db: sqlite3.Connection, rng: Rng) -> str:
    """A record deleted and all later ones moved up, so that no number is missing."""
    table, number = pick(db, rng)
    db.execute(f"DELETE FROM {table} WHERE seq = ?", (number,))
    for each in COLUMNS:
        later = [n for (n,) in db.execute(f"SELECT seq FROM {each} WHERE seq > ? ORDER BY seq", (number,))]
        db.executemany(f"UPDATE {each} SET seq = seq - 1 WHERE seq = ?", [(n,) for n in later])
    return f"delete {table} and close the gap"


def insert(db: sqlite3.Connection, rng: Rng) -> str:
    """A copy of a record under another number, with its own seal or with none that fits."""
    table, number = pick(db, rng, str(rng.choice(["event", "visit", "write", "result"])))
    (last,) = db.execute(f"SELECT max(seq) FROM (SELECT seq FROM attempt UNION SELECT seq FROM {table})").fetchone()
    wanted = int(rng.choice([last + 1, last + 2, -number, 10**7]))
    columns = ", ".join(("previous", "hash", "signature", *COLUMNS[table]))
    accepted = {n for t in COLUMNS for (n,) in db.execute(f"SELECT seq FROM {t} WHERE seq = ?", (wanted,))}
    target = 10**8 if accepted & {n for (n,) in db.execute(f"SELECT seq FROM {table}")} else wanted
    db.execute(f"INSERT INTO {table} (seq, {columns}) SELECT ?, {columns} FROM {table} WHERE seq = ?", (target, number))
    return f"insert {table}"


def swap(db: sqlite3.Connection, rng: Rng) -> str:
    """Two records of a table change places."""
    table = str(rng.choice(["event", "visit", "write", "result"]))
    (_, a), (_, b) = pick(db, rng, table), pick(db, rng, table)
    while a == b:
        _, b = pick(db, rng, table)
    for old, new in ((a, -1), (b, a), (-1, b)):
        db.execute(f"UPDATE {table} SET seq = ? WHERE seq = ?", (new, old))
    return f"swap {table}"


def swap_content(db: sqlite3.Connection, rng: Rng) -> str:
    """Two attempts change serial numbers; seals stay where they are."""
    a, b = (f"SN{n}" for n in rng.choice(4, 2, replace=False))
    swapped = "UPDATE attempt SET serial = CASE serial WHEN :a THEN :b ELSE :a END WHERE serial IN (:a, :b)"
    db.execute(swapped, {"a": a, "b": b})
    return "swap serials"


def truncate(db: sqlite3.Connection, rng: Rng) -> str:
    """The end cut off, and the log's own note of its head brought into line."""
    (last,) = db.execute(f"SELECT max(seq) FROM ({' UNION '.join(f'SELECT seq FROM {t}' for t in COLUMNS)})").fetchone()
    keep = int(rng.integers(0, last))
    for table in COLUMNS:
        db.execute(f"DELETE FROM {table} WHERE seq > ?", (keep,))
    db.execute("DELETE FROM frames WHERE visit NOT IN (SELECT seq FROM visit)")
    row = db.execute(
        "SELECT seq, hash FROM (SELECT seq, hash FROM attempt UNION SELECT seq, hash FROM finish) ORDER BY seq DESC"
    ).fetchone()
    if row:
        db.execute("UPDATE head SET number = ?, hash = ?", row)
    return "truncate"


def frames(db: sqlite3.Connection, rng: Rng) -> str:
    """Raw frames that still lie plain."""
    deed = int(rng.integers(3))
    (number,) = db.execute("SELECT visit FROM frames ORDER BY random() LIMIT 1").fetchone()
    stray = int(rng.integers(10**6, 10**7))
    if deed == 0:
        db.execute("DELETE FROM frames WHERE visit = ?", (number,))
    elif deed == 1:
        (data,) = db.execute("SELECT data FROM frames WHERE visit = ?", (number,)).fetchone()
        db.execute("UPDATE frames SET data = ? WHERE visit = ?", (other(data, rng), number))
    else:
        db.execute("INSERT INTO frames SELECT ?, data FROM frames WHERE visit = ?", (stray, number))
    return f"frames {('delete', 'change', 'insert')[deed]}"


def notes(db: sqlite3.Connection, rng: Rng) -> str:
    """What the log says about itself."""
    actions = (
        "UPDATE head SET number = number - 1",
        "UPDATE head SET hash = x'00'",
        "DELETE FROM head",
        "INSERT INTO head SELECT 2, number, hash FROM head",
        "UPDATE meta SET value = '00000000-0000-0000-0000-000000000000' WHERE key = 'log_id'",
        "UPDATE meta SET value = 'station.log/2' WHERE key = 'schema'",
        "DELETE FROM meta WHERE key = 'log_id'",
        "INSERT INTO meta VALUES ('more', 'x')",
    )
    deed = actions[int(rng.integers(len(actions)))]
    db.execute(deed)
    return "notes"


EDITS: tuple[Edit, ...] = (
    *(change,) * 6,
    renumber,
    delete,
    close_gap,
    insert,
    swap,
    swap_content,
    truncate,
    frames,
    notes,
)


def torture(path: Path, edits: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Makes and undoes that many edits; how many of each kind, and those that nobody noticed."""
    rng = np.random.default_rng(seed)
    writable = Database(sqlite3.connect(path, isolation_level=None), execute_plugins=False)
    connection = writable.conn
    assert list(verify.findings(path, writable)) == []
    made: Counter[str] = Counter()
    missed = []
    guards = connection.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
    while made.total() < edits:
        connection.execute("BEGIN")
        for name, _ in guards:
            connection.execute(f"DROP TRIGGER {name}")
        try:
            what = EDITS[int(rng.integers(len(EDITS)))](connection, rng)
        except sqlite3.Error:  # SQLite itself refuses, for an index over JSON or a number that is taken
            connection.execute("ROLLBACK")
            continue
        for _, sql in guards:
            connection.execute(sql)
        if next(verify.findings(path, writable), None) is None:
            missed.append(f"edit {made.total()}: {what}")
        connection.execute("ROLLBACK")
        made[what.split(" ")[0]] += 1
    assert list(verify.findings(path, writable)) == []
    writable.close()
    return made, missed


def both_kinds(edits: int, seed: int) -> list[tuple[str, int, list[str], Counter[str]]]:
    """(kind of log, edits, what was missed, edits by kind): four fifths on a plain log, the rest on a signed one."""
    key = Ed25519PrivateKey.generate()
    signer = Signer(key.sign, key.public_key().public_bytes_raw())
    shown = []
    for kind, used, share in (("plain", None, edits - edits // 5), ("signed", signer, edits // 5)):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "station.db"
            make(path, used)
            made, missed = torture(path, share, seed)
        shown.append((kind, share, missed, made))
    return shown


def main() -> int:
    """Prints the count; 1 when an edit was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--edits", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    begun_s = time.perf_counter()
    shown = both_kinds(given.edits, given.seed)
    missed = [f"{kind} log: {line}" for kind, _, lines, _ in shown for line in lines]
    if given.json:
        print(json.dumps({"edits": given.edits, "missed": len(missed), "seed": given.seed, "said": missed}))
        return int(bool(missed))
    found = given.edits - len(missed)
    print(f"random edits of the log found by --verify: {found} of {given.edits}   goal: all   seed {given.seed}")
    for kind, share, lines, made in shown:
        kinds = ", ".join(f"{k} {v}" for k, v in sorted(made.items()))
        print(f"  {kind} log: {share - len(lines)} of {share}; {kinds}")
    print(f"  {time.perf_counter() - begun_s:.0f} s")
    for line in missed[:20]:
        print(f"  missed: {line}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
