"""Reduced stops and what was made of them, many attempts a query: what a backtest reads, and what a run learns from."""

import json
import sqlite3
from collections.abc import Sequence
from typing import Any

from station.domain.records.stored_attempt import is_simulated
from station.ports.log_reader import ReducedAttempt
from station.ports.store import StoredCalibration

_BEFORE = "json_extract(c.document, '$.outcome', '$.offset', '$.matrix', '$.checks')"

#: Each attempt's results are found by the span of its records; CROSS and + keep SQLite from indexing all results first.
_QUERY = f"""
    SELECT a.seq, a.id, a.serial, a.product, s.document, {_BEFORE}, a.station, a.nest, a.lot, a.started_ns, a.software,
        coalesce((SELECT h.document FROM result h
            WHERE h.seq BETWEEN a.seq AND f.seq AND +h.attempt = a.seq AND +h.name = 'history'), '')
    FROM json_each(?) n CROSS JOIN attempt a ON a.seq = n.value CROSS JOIN finish f ON f.attempt = a.seq
    CROSS JOIN result s ON s.seq BETWEEN a.seq AND f.seq AND +s.attempt = a.seq AND +s.name = 'stops'
    CROSS JOIN result c ON c.seq BETWEEN s.seq AND f.seq AND +c.attempt = a.seq AND +c.name = 'calibration'
    ORDER BY a.seq"""

_DWELLS = """
    SELECT r.document FROM (SELECT seq FROM attempt WHERE recipe_hash = ? ORDER BY started_ns DESC LIMIT ?) a
    CROSS JOIN finish f ON f.attempt = a.seq
    CROSS JOIN result r ON r.seq BETWEEN a.seq AND f.seq AND +r.attempt = a.seq AND +r.name = 'dwell'
    ORDER BY a.seq DESC"""

_CALIBRATIONS = """
    SELECT a.serial, a.station, a.nest, a.software, a.started_ns, f.outcome,
        json_extract(c.document, '$.offset', '$.matrix', '$.budget', '$.residuals', '$.rules')
    FROM (SELECT * FROM attempt WHERE recipe_hash = ? ORDER BY started_ns DESC LIMIT ?) a
    CROSS JOIN finish f ON f.attempt = a.seq
    CROSS JOIN result c ON c.seq BETWEEN a.seq AND f.seq AND +c.attempt = a.seq AND +c.name = 'calibration'
    ORDER BY a.seq DESC"""


def read(db: sqlite3.Connection, numbers: Sequence[int]) -> list[ReducedAttempt]:
    """Those of the attempts that came to a calibration, in the order of their records."""
    rows = db.execute(_QUERY, (json.dumps(list(numbers)),))
    return [
        ReducedAttempt(
            number, attempt, serial, product, stops, before, station, nest, lot, began, is_simulated(software), history
        )
        for number, attempt, serial, product, stops, before, station, nest, lot, began, software, history in rows
    ]


def dwells(db: sqlite3.Connection, recipe_hash: str, newest: int) -> list[dict[str, Any]]:
    """See Store.dwells."""
    rows = db.execute(_DWELLS, (recipe_hash, newest)).fetchall()
    return [json.loads(text) for (text,) in reversed(rows)]


def read_calibrations(db: sqlite3.Connection, recipe_hash: str, newest: int) -> list[StoredCalibration]:
    """See Store.calibrations."""
    rows = db.execute(_CALIBRATIONS, (recipe_hash, newest)).fetchall()
    return [StoredCalibration(*row) for row in reversed(rows)]


def document(db: sqlite3.Connection, number: int) -> str:
    """The text that a document record holds."""
    (text,) = db.execute("SELECT text FROM document WHERE seq = ?", (number,)).fetchone()
    return str(text)
