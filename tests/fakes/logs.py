"""Logs with known content: one unit as a run would keep it, and ways to treat a log badly."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from station.adapters.store.sqlite import SqliteStore
from station.domain.core.types import Frames
from station.ports.store import AttemptStart, VisitRecord, WriteRecord

NOBODY = 65534


def begin(serial: str = "SN1", **changes: object) -> AttemptStart:
    """What is known of a unit before its device is touched."""
    plain = AttemptStart(
        serial=serial,
        station="bench-1",
        nest="A",
        node=17,
        recipe_name="six-point",
        recipe_version=3,
        recipe_hash="ab" * 32,
        recipe_json='{"name":"six-point"}',
        config_hash="cd" * 32,
        software="0.1.0",
        operator="Ada",
        started_ns=1_767_225_600_000_000_000,
        lot="L7",
        product_json='{"name":"accelerometer"}',
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


def frames(rng: np.random.Generator, n: int = 120) -> Frames:
    """Frames of one visit, 100 a second, with noise."""
    data = np.zeros((n, 8), np.uint8)
    data[:, 2:] = rng.normal([0, 0, 16000], 11, (n, 3)).astype("<i2").view(np.uint8).reshape(n, 6)
    data[:, 1] = np.arange(n) % 15
    time_ns = 1_767_225_600_000_000_000 + np.arange(n) * 10_000_000 + rng.integers(0, 50, n) * 1000
    return Frames(time_ns, np.full(n, 0x191, np.uint32), np.full(n, 8, np.uint8), data)


def visit(number: int, rng: np.random.Generator, kind: str = "tumble") -> VisitRecord:
    """One stop with its statistics."""
    statistics = {"mean": rng.normal(size=3), "std": [0.1, 0.2, 0.3], "count": 100, "gaps": 0, "kernel_drops": 0}
    return VisitRecord(0, number, f"p{number}", "home", kind, 10 + number, 20 + number, frames(rng), statistics)


def unit(store: SqliteStore, serial: str = "SN1", outcome: str = "PASS", **changes: object) -> str:
    """A whole attempt: two stops, a written object, results, an end; its id."""
    rng = np.random.default_rng(7)
    shown = begin(serial, **changes)
    attempt = store.begin(shown)
    store.result(attempt, "identity", {"serial": 1, "software": "1.0.0"})
    for number in range(2):
        store.visit([attempt], [visit(number, rng)])
    store.result(attempt, "calibration", {"offset": [0.1, float("nan"), -0.0], "outcome": outcome})
    write = WriteRecord(0x2101, 1, "matrix.xx", b"\0\0\x80?", b"\1\0\x80?", None, 1.0000001)
    store.write(attempt, write)
    store.write(attempt, replace(write, read_back=write.written, stage="verified"))
    store.result(attempt, "verdict", {"outcome": outcome, "reasons": []})
    store.finish(attempt, outcome, shown.started_ns + 28_000_000_000)
    store.tidy()
    return attempt


@contextmanager
def unguarded(path: Path) -> Iterator[sqlite3.Connection]:
    """The log as somebody sees it who has the file in hands and takes the guards off; they are back at the end."""
    db = sqlite3.connect(path)
    guards = db.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
    for name, _ in guards:
        db.execute(f"DROP TRIGGER {name}")
    yield db
    for _, sql in guards:
        db.execute(sql)
    db.commit()
    db.close()


@contextmanager
def as_nobody() -> Iterator[None]:
    """Rights of a plain user: to root, files are never read-only."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@contextmanager
def stranger() -> Iterator[None]:
    """Rights of a user who is in none of this process' groups."""
    if os.geteuid() != 0:
        yield
        return
    groups, group = os.getgroups(), os.getegid()
    os.setgroups([])
    os.setegid(NOBODY)
    try:
        with as_nobody():
            yield
    finally:
        os.setegid(group)
        os.setgroups(groups)
