"""Makes a big log fast: real records of one simulated unit, sealed and numbered as the station would, many times over.

What differs from unit to unit is drawn anew: serial, nest, lot, times, offsets. One unit in `every` has all its
records; the others have beginning, identity, verdict and end, so that a log of a million units fits on a disk.
Fsync is off while it is made; the result is a log like any other, and `station audit --verify` walks it.
"""

import json
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.adapters.store import anchor, ids
from station.adapters.store.schema import COLUMNS
from station.adapters.store.sqlite import SqliteStore
from station.domain.records import chain
from station.domain.records.head import SealedHead

#: A day of an eight-station plant: one unit every 15 s.
FIRST_NS, STEP_NS = 1_735_689_600_000_000_000, 15_000_000_000
NESTS = "ABCD"
CHECKS = ("gain", "offset", "residual", "noise", "stuck")
_LEAN = {"attempt", "finish"}

Row = tuple[str, tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class Template:
    """Records of one attempt in order, table and values; the attempt's own number is left as 0."""

    rows: tuple[Row, ...]
    documents: tuple[Row, ...]


def template(path: Path, serial: str) -> Template:
    """Taken from a log that the run itself wrote."""
    db = sqlite3.connect(path)
    (number,) = db.execute("SELECT seq FROM attempt WHERE serial = ?", (serial,)).fetchone()
    found = []
    for table, columns in COLUMNS.items():
        where = "seq = ?" if table == "attempt" else "attempt = ?" if "attempt" in columns else "0 = ?"
        query = f"SELECT seq, {', '.join(columns)} FROM {table} WHERE {where}"
        found += [(seq, table, tuple(values)) for seq, *values in db.execute(query, (number,))]
    documents = [
        ("document", tuple(values)) for values in db.execute("SELECT sha256, kind, text FROM document ORDER BY seq")
    ]
    db.close()
    return Template(tuple((table, values) for _, table, values in sorted(found)), tuple(documents))


def build(path: Path, made_from: Template, units: int, every: int) -> None:
    """Writes the log at `path`, which must not exist."""
    SqliteStore(path).close()
    db = sqlite3.connect(path, isolation_level=None)
    for setting in ("synchronous = OFF", "journal_mode = MEMORY", "cache_size = -400000"):
        db.execute(f"PRAGMA {setting}")
    (log_id,) = db.execute("SELECT value FROM meta WHERE key = 'log_id'").fetchone()
    writer = _Writer(db, chain.genesis(log_id))
    numbers = [writer.append(table, values) for table, values in made_from.documents]
    for start in range(0, units, 5000):
        db.execute("BEGIN")
        for unit in range(start, min(start + 5000, units)):
            writer.unit(_unit(made_from.rows, unit, numbers, full=unit % every == 0))
        writer.flush()
        db.execute("COMMIT")
    last = db.execute("SELECT seq, hash FROM finish ORDER BY seq DESC LIMIT 1").fetchone()
    db.execute("UPDATE head SET number = ?, hash = ?", last)
    db.execute("PRAGMA journal_mode = WAL")
    db.close()
    head_file = anchor.HeadFile(path)
    head_file.open()
    head_file.write(SealedHead(log_id, "", writer.number, writer.hash.hex()), durable=True)
    head_file.close()


class _Writer:
    """Seals records and inserts them by the thousand."""

    def __init__(self, db: sqlite3.Connection, start: bytes) -> None:
        self._db, self.number, self.hash = db, 0, start
        self._waiting: dict[str, list[tuple[Any, ...]]] = {table: [] for table in COLUMNS}

    def append(self, table: str, values: tuple[Any, ...]) -> int:
        """One record; its number."""
        previous, self.number = self.hash, self.number + 1
        self.hash = chain.link(previous, chain.canonical(table, COLUMNS[table], values))
        self._waiting[table].append((self.number, previous, self.hash, None, *values))
        return self.number

    def unit(self, rows: Iterator[Row]) -> None:
        """One attempt: its first record's number goes into all others."""
        attempt = self.append(*next(rows))
        for table, values in rows:
            self.append(table, (attempt, *values[1:]))

    def flush(self) -> None:
        """Inserts what waits."""
        for table, rows in self._waiting.items():
            names = ("seq", "previous", "hash", "signature", *COLUMNS[table])
            marks = ", ".join("?" * len(names))
            self._db.executemany(f"INSERT INTO {table} ({', '.join(names)}) VALUES ({marks})", rows)
            rows.clear()


def _unit(rows: Sequence[Row], unit: int, documents: Sequence[int], *, full: bool) -> Iterator[Row]:
    started = FIRST_NS + unit * STEP_NS
    for table, values in rows:
        if table == "attempt":
            yield table, _attempt(values, unit, started, documents)
        elif table == "finish":
            yield table, (0, "FAIL" if unit % 41 == 0 else "PASS", started + 28_000_000_000)
        elif full or (table == "result" and values[2] in ("identity", "verdict")):
            yield table, _moved(table, values, unit)


def _attempt(values: tuple[Any, ...], unit: int, started: int, documents: Sequence[int]) -> tuple[Any, ...]:
    printed = dict(zip(COLUMNS["attempt"], values, strict=True))
    printed |= {"id": ids.uuid7(started), "serial": f"SN{unit:08d}", "nest": NESTS[unit % 4], "lot": f"L{unit // 5000}"}
    printed |= {"station": f"bench-{unit % 8}", "started_ns": started, "recipe": documents[0], "product": documents[1]}
    return tuple(printed[name] for name in COLUMNS["attempt"])


def _moved(table: str, values: tuple[Any, ...], unit: int) -> tuple[Any, ...]:
    """Stops of a unit with an offset of its own, so that a backtest has something to compute; reasons of one that
    failed, so that an audit has something to find."""
    if table == "result" and values[2] == "verdict" and unit % 41 == 0:
        verdict = json.loads(values[3])
        verdict["reasons"] = [{"check": CHECKS[unit // 41 % len(CHECKS)], "sentence": "simulated"}]
        return (*values[:3], json.dumps(verdict, sort_keys=True, separators=(",", ":")))
    if table != "result" or values[2] != "stops":
        return values
    stops = json.loads(values[3])
    shift = [((unit * 7919 + 17 * axis) % 1000 - 500) * 1e-4 for axis in range(3)]
    stops["mean"] = [[v + s for v, s in zip(row, shift, strict=True)] for row in stops["mean"]]
    return (*values[:3], json.dumps(stops, sort_keys=True, separators=(",", ":")))
