"""A fleet as rows: one an attempt, one a coefficient, one a visit, of whatever log or plant is read."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from station.domain.product import product_record
from station.domain.records import stored_attempt
from station.ports.log_reader import Attempt, LogReader

#: Which attempt a row is of; the same in each table.
_COMMON = ("attempt", "serial", "station", "nest", "lot", "recipe_name", "recipe_version", "recipe_hash", "outcome")
_VISIT, _AXES = ("run", "visit", "position", "seating", "kind", "frame_count"), "xyz"
_COUNTS = ("count", "gaps", "lost", "kernel_drops", "crc_errors", "late", "repeats")


@dataclass(frozen=True, slots=True)
class FleetRows:
    """The rows of one attempt. day: of its start, UTC."""

    product: str
    day: str
    attempts: list[dict[str, Any]]
    coefficients: list[dict[str, Any]]
    visits: list[dict[str, Any]]
    reduced: list[dict[str, Any]]


def fleet_rows(log: LogReader, attempts: Sequence[Attempt]) -> Iterator[FleetRows]:
    """Of each attempt, in the order of their starts. Errors: LogError."""
    for attempt in sorted(attempts, key=lambda a: (a.started_ns, a.number)):
        stored = log.attempt(attempt)
        product = product_record.name_in(log.recipe_and_product(attempt)[1]) or "unknown"
        common = {name: getattr(attempt, name) for name in _COMMON} | {"started": _utc(attempt.started_ns)}
        common["simulated"] = stored_attempt.mark_of(attempt.software)
        yield FleetRows(
            product,
            f"{_utc(attempt.started_ns):%Y-%m-%d}",
            [common | _attempt(attempt, stored)],
            [common | row for row in _coefficients(stored)],
            [common | _visit(visit) for visit in stored["visits"]],
            [common | row for row in _reduced(log, attempt)],
        )


def _reduced(log: LogReader, attempt: Attempt) -> Iterator[dict[str, Any]]:
    """What `station backtest` and `calibrate` read of a fleet's tables."""
    recipe, product = log.recipe_and_product(attempt)
    for row in log.reduced([attempt.number]):
        yield {
            "stops": row.stops,
            "before": row.before,
            "recipe": recipe,
            "product_json": product,
            "history": row.history,
        }


def _attempt(attempt: Attempt, stored: dict[str, Any]) -> dict[str, Any]:
    fit = stored_attempt.result(stored, "calibration") or {}
    verdict = stored_attempt.result(stored, "verdict") or {}
    identity = stored_attempt.result(stored, "identity") or {}
    ended = attempt.ended_ns
    return {
        "ended": None if ended is None else _utc(ended),
        "duration_s": None if ended is None else (ended - attempt.started_ns) / 1e9,
        **{name: getattr(attempt, name) for name in ("node", "operator", "software", "config_hash")},
        "firmware": identity.get("software"),
        **{name: fit.get(name) for name in ("residual_rms", "false_accept", "false_reject")},
        **{name: verdict.get(name) for name in ("written", "verified")},
        "reasons": [reason["sentence"] for reason in verdict.get("reasons", ())],
        "seal": "" if stored["seal"] is None else f"{stored['seal']['number']}:{stored['seal']['hash']}",
    }


def _coefficients(stored: dict[str, Any]) -> Iterator[dict[str, Any]]:
    fit = stored_attempt.result(stored, "calibration") or {}
    if fit.get("offset") is None or fit.get("matrix") is None:
        return
    values = [*fit["offset"], *(value for row in fit["matrix"] for value in row)]
    for line, value in zip(fit.get("budget") or (), values, strict=False):
        known = {name: line.get(name) for name in ("std", "expanded", "k", "dof", "unit")}
        yield {"coefficient": line["coefficient"], "value": value, **known}


def _visit(visit: dict[str, Any]) -> dict[str, Any]:
    statistics = visit["statistics"]
    rows: dict[str, Any] = {name: visit[name] for name in _VISIT}
    rows |= {"arrived": _utc(visit["arrived_ns"]), "left": _utc(visit["left_ns"])}
    for name in ("mean", "std"):
        values = statistics.get(name) or [None] * 3
        rows |= {f"{name}_{axis}": value for axis, value in zip(_AXES, values, strict=True)}
    return rows | {name: statistics.get(name) for name in (*_COUNTS, "temperature_degC")}


def _utc(time_ns: int) -> datetime:
    return datetime.fromtimestamp(time_ns / 1e9, UTC)
