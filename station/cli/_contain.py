"""The answer of `station contain`: one row a unit."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from station.cli import _output
from station.cli._audit_text import print_rows
from station.domain.records.stored_attempt import utc
from station.errors import UsageError
from station.ports.log_reader import Query
from station.service import time_text
from station.service.containment import TouchedUnit, touched

if TYPE_CHECKING:
    from station.ports.log_reader import LogReader


def contain(log: "LogReader", query: Query, *, as_json: bool) -> int:
    """Prints the units. Errors: UsageError where nothing narrows the question."""
    if query == Query():
        raise UsageError("contain-what")
    units = touched(log, query)
    if as_json:
        head = {"schema": "station.containment/1", "log": log.location, "head": asdict(log.head())}
        question = {k: v for k, v in asdict(query).items() if v is not None}
        _output.print_json({**head, "question": question, "count": len(units), "units": [_document(u) for u in units]})
        return 0
    zone = time_text.zone()
    rows = [
        [u.serial, u.attempts, time_text.local_short(u.first_ns), time_text.local_short(u.last_ns), u.outcome, u.now]
        for u in units
    ]
    columns = ("serial", "attempts", f"first, {zone}", f"last, {zone}", "outcome", "now")
    print_rows(f"{len(units)} {'unit' if len(units) == 1 else 'units'} touched", columns, rows)
    if not units:
        _output.print_line("no such unit")
    return 0


def _document(unit: TouchedUnit) -> dict[str, Any]:
    times = {"first": utc(unit.first_ns), "last": utc(unit.last_ns)}
    return {"serial": unit.serial, "attempts": unit.attempts, **times, "outcome": unit.outcome, "now": unit.now}
