"""What a page, an auditor and a report ask of a plant: the questions of the log, in PostgreSQL's words."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, fields
from typing import Any

import psycopg
from psycopg.rows import dict_row

from station.adapters.postgres import search
from station.domain.records.stored_attempt import is_simulated, utc
from station.domain.records.tables import TIME_AND_DETAIL, YIELD_GROUPS
from station.errors import UsageError
from station.ports.log_reader import (
    YIELD_CELL,
    YIELD_SEPARATOR,
    Attempt,
    LogChange,
    Query,
    RecentFigures,
    ReducedAttempt,
    Yield,
)
from station.ports.store import StoredCalibration

_VISITS = """SELECT attempt, seq AS record, run, visit, "position", seating, kind, arrived_ns, left_ns, frame_count,
    frames_sha256, statistics FROM visit WHERE attempt = ANY(%s) ORDER BY seq"""
_WRITES = """SELECT attempt, seq AS record, at_ns, object, sub, name, stage, value, old, written, read_back FROM write
    WHERE attempt = ANY(%s) ORDER BY seq"""
_RESULTS = "SELECT attempt, seq AS record, at_ns, name, document FROM result WHERE attempt = ANY(%s) ORDER BY seq"
_EVENTS = "SELECT attempt, seq AS record, at_ns, kind, detail FROM event WHERE attempt = ANY(%s) ORDER BY seq"
_SEALS = "SELECT attempt, seq, hash FROM finish WHERE attempt = ANY(%s)"
#: Attempts whose lives are read together.
_LIVES = 100


def lives_of(db: psycopg.Connection, attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
    """Each attempt: identity, visits, results, object writes, events, and the seal of its end (station.audit/1)."""
    return [life for i in range(0, len(attempts), _LIVES) for life in _lives(db, attempts[i : i + _LIVES])]


def _lives(db: psycopg.Connection, attempts: Sequence[Attempt]) -> Iterator[dict[str, Any]]:
    numbers = [attempt.number for attempt in attempts]
    with db.pipeline():  # the five questions on one way to the server and back
        asked = [
            db.cursor(row_factory=dict_row).execute(query.encode(), [numbers])
            for query in (_VISITS, _RESULTS, _WRITES, _EVENTS, _SEALS)
        ]
    visits, results, writes, events, seals = map(_by_attempt, asked)
    for attempt in attempts:
        own = attempt.number
        sealed = seals.get(own)
        yield {
            **{k: v for k, v in asdict(attempt).items() if k != "number"},
            "record": own,
            "started": utc(attempt.started_ns),
            "ended": None if attempt.ended_ns is None else utc(attempt.ended_ns),
            "seal": {"number": sealed[0]["seq"], "hash": bytes(sealed[0]["hash"]).hex()} if sealed else None,
            "visits": [{**r, "statistics": json.loads(r["statistics"])} for r in visits.get(own, ())],
            "results": [{**r, "document": json.loads(r["document"])} for r in results.get(own, ())],
            "writes": [_write(r) for r in writes.get(own, ())],
            "events": [{**r, "detail": json.loads(r["detail"])} for r in events.get(own, ())],
        }


def _by_attempt(rows: Iterable[dict[str, Any]]) -> dict[int, list[dict[str, Any]]]:
    found: dict[int, list[dict[str, Any]]] = {}
    for row in rows:
        found.setdefault(row.pop("attempt"), []).append(row)
    return found


def _write(row: dict[str, Any]) -> dict[str, Any]:
    held = {key: None if row[key] is None else bytes(row[key]).hex() for key in ("old", "written", "read_back")}
    place = f"{row.pop('object'):04X}:{row.pop('sub'):02X}"
    return {**row, "object": place, **held}


def _part(table: str) -> str:
    time, detail = TIME_AND_DETAIL[table]
    of = "t.seq" if table == "attempt" else "t.attempt"
    return f"""(SELECT t.seq, '{table}', coalesce(a.id, ''), {time}, {detail} FROM {table} t
        LEFT JOIN attempt a ON a.seq = {of} WHERE t.seq > %(after)s ORDER BY t.seq LIMIT %(limit)s)"""


_CHANGES = " UNION ALL ".join(map(_part, TIME_AND_DETAIL)) + " ORDER BY 1 LIMIT %(limit)s"


def changes(db: psycopg.Connection, after: int, limit: int) -> list[LogChange]:
    """See LogReader.changes."""
    return [LogChange(*row) for row in db.execute(_CHANGES.encode(), {"after": after, "limit": limit})]


_DAY_NS = 86_400 * 10**9
_CHANGED_DAYS = f"""
    SELECT a.started_ns / {_DAY_NS} FROM finish f JOIN attempt a ON a.seq = f.attempt WHERE f.seq > %(after)s
    UNION SELECT p.started_ns / {_DAY_NS} FROM attempt a JOIN attempt p
        ON p.serial = a.serial AND p.recipe_name = a.recipe_name AND p.seq < a.seq WHERE a.seq > %(after)s"""


def changed_days(db: psycopg.Connection, after: int) -> frozenset[int]:
    """See LogReader.changed_days."""
    return frozenset(int(day) for (day,) in db.execute(_CHANGED_DAYS.encode(), {"after": after}))


#: What a yield may be grouped by, as SQL.
GROUPS = {
    **YIELD_GROUPS,
    "day": "to_char(to_timestamp(a.started_ns / 1000000000) AT TIME ZONE 'UTC', 'YYYY-MM-DD')",
}
GROUPS["cell"] = f" || '{YIELD_SEPARATOR}' || ".join(GROUPS[name] for name in YIELD_CELL)


#: Of the counts by day (migration 0005) these may be asked, and these are not among their groups.
_COUNTED = {"station", "nest", "recipe_name", "recipe_version", "since_ns", "until_ns"}
_UNCOUNTED_GROUPS = {"lot", "operator"}
_DAYS = f"(SELECT *, day * {_DAY_NS} AS started_ns FROM day_yield) a"
_SUMS = ", ".join(
    f"sum({name})::bigint"
    for name in (
        *("attempts", "passed", "failed", "errors", "aborted", "interrupted"),
        *("units", "first_pass", "final", "final_pass"),
    )
)


def yields(db: psycopg.Connection, query: Query, by: str) -> list[Yield]:
    """See LogReader.yields. Whole days come from the counts that are kept at arrival. Errors: UsageError."""
    if by not in GROUPS:
        raise UsageError("yield-unknown-group", group=by, groups=tuple(GROUPS))
    return _kept_yields(db, query, by) if _is_counted(query, by) else _scanned_yields(db, query, by)


def _is_counted(query: Query, by: str) -> bool:
    given = {f.name for f in fields(query) if getattr(query, f.name) is not None}
    whole = all((time_ns or 0) % _DAY_NS == 0 for time_ns in (query.since_ns, query.until_ns))
    return given <= _COUNTED and whole and by not in _UNCOUNTED_GROUPS


def _kept_yields(db: psycopg.Connection, query: Query, by: str) -> list[Yield]:
    condition, parameters = search.where(query)
    rows = db.execute(
        f"""SELECT ({GROUPS[by]}) COLLATE "C" AS g, {_SUMS},
            (sum(took_ns) / sum(attempts) / 1e9)::double precision
        FROM {_DAYS} WHERE {condition} GROUP BY g ORDER BY g""".encode(),
        parameters,
    )
    return [Yield(*row) for row in rows]


def _scanned_yields(db: psycopg.Connection, query: Query, by: str) -> list[Yield]:
    condition, parameters = search.where(query)
    outcomes = ", ".join(
        f"count(*) FILTER (WHERE outcome = '{o}')" for o in ("PASS", "FAIL", "ERROR", "ABORTED", "INTERRUPTED")
    )
    rows = db.execute(
        f"""WITH picked AS (SELECT ({GROUPS[by]}) COLLATE "C" AS g, f.outcome, f.ended_ns - a.started_ns AS took,
                n.seq IS NULL AS first, e.seq IS NULL AS last
            FROM attempt a JOIN finish f ON f.attempt = a.seq LEFT JOIN repeat n ON n.seq = a.seq
            LEFT JOIN repeat e ON e.earlier = a.seq WHERE {condition})
        SELECT g, count(*), {outcomes}, count(*) FILTER (WHERE first),
            count(*) FILTER (WHERE first AND outcome = 'PASS'), count(*) FILTER (WHERE last),
            count(*) FILTER (WHERE last AND outcome = 'PASS'), (avg(took) / 1e9)::double precision
        FROM picked GROUP BY g ORDER BY g""".encode(),
        parameters,
    )
    return [Yield(*row) for row in rows]


_OUTCOMES = "SELECT outcome, count(*) FROM finish GROUP BY outcome"
_CYCLE = """SELECT (avg(f.ended_ns - a.started_ns) / 1e9)::double precision, (max(f.ended_ns) / 1e9)::double precision
    FROM (SELECT attempt, ended_ns FROM finish WHERE outcome = 'PASS' ORDER BY seq DESC LIMIT %s) f
    JOIN attempt a ON a.seq = f.attempt"""
_STREAM = """SELECT sum((s ->> 'kernel_drops')::bigint), sum((s ->> 'lost')::bigint),
    sum((s ->> 'crc_errors')::bigint), count(*) FILTER (WHERE kind = 'rejected'), count(*),
    count(*) FILTER (WHERE json_typeof(s -> 'bus_errors') = 'array' AND json_array_length(s -> 'bus_errors') > 0)
    FROM (SELECT kind, statistics::json AS s FROM visit ORDER BY seq DESC LIMIT %s) v"""


def recent(db: psycopg.Connection, units: int, visits: int) -> RecentFigures:
    """See LogReader.recent."""
    cycle, stream = db.execute(_CYCLE, [units]).fetchone(), db.execute(_STREAM, [visits]).fetchone()
    assert cycle is not None
    assert stream is not None
    drops, lost, crc, rejected, number, bus = (int(value or 0) for value in stream)
    return RecentFigures(
        outcomes={str(outcome): int(n) for outcome, n in db.execute(_OUTCOMES)},
        cycle_s=cycle[0],
        last_pass_s=cycle[1],
        visits=number,
        kernel_drops=drops,
        lost=lost,
        crc_errors=crc,
        bus_error_visits=bus,
        rejected=rejected,
    )


_REDUCED = """SELECT a.seq, a.id, a.serial, a.product, s.document, c.document::json, a.station, a.nest, a.lot,
    a.started_ns, a.software, coalesce(h.document, '')
    FROM attempt a JOIN finish f ON f.attempt = a.seq
    JOIN result s ON s.attempt = a.seq AND s.name = 'stops'
    JOIN result c ON c.attempt = a.seq AND c.name = 'calibration' AND c.seq > s.seq
    LEFT JOIN result h ON h.attempt = a.seq AND h.name = 'history'
    WHERE a.seq = ANY(%s) ORDER BY a.seq"""


def reduced(db: psycopg.Connection, numbers: Sequence[int]) -> Iterator[ReducedAttempt]:
    """See LogReader.reduced."""
    for number, attempt, serial, product, stops, fit, *place in db.execute(_REDUCED, [list(numbers)]):
        before = json.dumps([fit.get(name) for name in ("outcome", "offset", "matrix", "checks")])
        station, nest, lot, started_ns, software, history = place
        origin = is_simulated(software), history
        yield ReducedAttempt(number, attempt, serial, product, stops, before, station, nest, lot, started_ns, *origin)


_CALIBRATIONS = """SELECT a.serial, a.station, a.nest, a.software, a.started_ns, f.outcome, c.document::json
    FROM (SELECT * FROM attempt WHERE recipe_hash = %s ORDER BY started_ns DESC LIMIT %s) a
    JOIN finish f ON f.attempt = a.seq
    JOIN result c ON c.attempt = a.seq AND c.name = 'calibration' ORDER BY a.seq"""


def query_calibrations(db: psycopg.Connection, recipe_hash: str, newest: int) -> list[StoredCalibration]:
    """See LogReader.calibrations."""
    rows = db.execute(_CALIBRATIONS, [recipe_hash, newest]).fetchall()
    return [
        StoredCalibration(
            serial,
            station,
            nest,
            software,
            started_ns,
            outcome,
            json.dumps([document.get(k) for k in ("offset", "matrix", "budget", "residuals", "rules")]),
        )
        for serial, station, nest, software, started_ns, outcome, document in rows
    ]
