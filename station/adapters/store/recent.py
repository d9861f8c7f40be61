"""The newest records in figures: what a monitor asks for every few seconds."""

import sqlite3

from station.ports.log_reader import RecentFigures

_OUTCOMES = "SELECT outcome, count(*) FROM finish GROUP BY outcome"
# The + keeps the walk on the newest records; by the index of outcomes every PASS there is would be sorted.
_CYCLE = """SELECT avg(f.ended_ns - a.started_ns) / 1e9, max(f.ended_ns) / 1e9
    FROM (SELECT attempt, ended_ns FROM finish WHERE +outcome = 'PASS' ORDER BY seq DESC LIMIT ?) f
    JOIN attempt a ON a.seq = f.attempt"""
_STREAM = """SELECT sum(json_extract(statistics, '$.kernel_drops')), sum(json_extract(statistics, '$.lost')),
    sum(json_extract(statistics, '$.crc_errors')), sum(kind = 'rejected'), count(*),
    sum(json_array_length(statistics, '$.bus_errors') > 0)
    FROM (SELECT kind, statistics FROM visit ORDER BY seq DESC LIMIT ?)"""


def figures(db: sqlite3.Connection, units: int, visits: int) -> RecentFigures:
    """See LogReader.recent."""
    cycle_s, last_pass_s = db.execute(_CYCLE, [units]).fetchone()
    drops, lost, crc, rejected, count, bus = db.execute(_STREAM, [visits]).fetchone()
    return RecentFigures(
        outcomes=dict(db.execute(_OUTCOMES).fetchall()),
        cycle_s=cycle_s,
        last_pass_s=last_pass_s,
        visits=count,
        kernel_drops=drops or 0,
        lost=lost or 0,
        crc_errors=crc or 0,
        bus_error_visits=bus or 0,
        rejected=rejected or 0,
    )
