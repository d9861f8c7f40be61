"""What the log keeps, as the rest of the station knows it: samples tables, CAN logs with marks, rows of results."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from station.domain.capture.annotations import Annotation, Annotations, annotate_visits
from station.domain.capture.assemble import run_starts_ns, sample_table
from station.domain.capture.visit import CapturedVisit, decode_visit
from station.domain.core.types import Floats, Frames, NestAssignment, SampleTable
from station.domain.methods import coefficients
from station.domain.records import stored_attempt
from station.errors import UsageError
from station.ports.log_reader import Attempt, LogReader
from station.service.recompute import parse_recipe_and_product, stored_visits

#: Columns that a log of this software can always fill.
ALWAYS_COLUMNS = ("started_s", "since_clamp_s", "since_power_s")


def samples(log: LogReader, attempts: Sequence[Attempt]) -> Iterator[SampleTable]:
    """Uncalibrated samples of each attempt's tumble, repeats included; all tables have the same columns.

    A serial that was tried again goes on counting its runs; `started_s` is on one clock, zero at the first attempt.
    """
    zero_ns = min((a.started_ns for a in attempts), default=0)
    wanted, marked = _columns(log, attempts), any(stored_attempt.is_simulated(a.software) for a in attempts)
    runs: dict[str, int] = {}
    for attempt in attempts:
        recipe, _, layout = parse_recipe_and_product(*log.recipe_and_product(attempt))
        stored = log.attempt(attempt)
        visits = stored_visits(stored["visits"], log.frames(attempt))
        if not visits:
            continue
        labels = {"station": attempt.station, "nest": attempt.nest, "lot": attempt.lot, "operator": attempt.operator}
        labels |= {"simulated": stored_attempt.mark_of(attempt.software)} if marked else {}
        bits = recipe.device.counter_bits
        decoded = [decode_visit(visit, layout, attempt.node) for visit in visits]
        table = sample_table(attempt.serial, decoded, layout.counter_values, counter_bits=bits, everything=True)
        table = replace(table, values={**table.values, **_clocks(table, visits, stored["events"])})
        before = runs.get(attempt.serial, 0)
        runs[attempt.serial] = before + len(recipe.runs)
        yield _complete(table, labels, wanted, before, (visits[0].arrived_ns - zero_ns) / 1e9)


def frames(log: LogReader, attempts: Sequence[Attempt]) -> tuple[Frames, Annotations]:
    """All raw frames of the attempts in the order of time, and marks of their dwells.

    Errors: UsageError when two attempts overlap in time on one node, so that marks could not part them.
    """
    per_attempt = [(attempt, log.frames(attempt)) for attempt in attempts]
    joined = Frames.join([part for _, parts in per_attempt for part in parts])
    joined = joined[np.argsort(joined.time_ns, kind="stable")]
    zero_ns = int(joined.time_ns[0]) if len(joined) else 0
    dwells = [(a, stored_visits(log.attempt(a)["visits"], parts)) for a, parts in per_attempt]
    _check_apart([(a, visit) for a, visits in dwells for visit in visits])
    names = {a.recipe_name for a in attempts}
    count = Counter(a.serial for a in attempts)
    made = tuple(
        mark.model_copy(
            update={
                "attempt": a.attempt if count[a.serial] > 1 else "",
                "simulated": stored_attempt.mark_of(a.software),
            }
        )
        for a, visits in dwells
        for mark in _marks(log, a, visits, zero_ns)
    )
    return joined, Annotations(recipe=names.pop() if len(names) == 1 else None, marks=made)


def results(log: LogReader, attempts: Sequence[Attempt]) -> Iterator[dict[str, Any]]:
    """One flat row an attempt: who, where, when, how it ended, coefficients and their standard uncertainties."""
    for attempt in attempts:
        yield _result(attempt, log.attempt(attempt))


def _columns(log: LogReader, attempts: Sequence[Attempt]) -> tuple[str, ...]:
    """Columns of numbers that any of the attempts can fill."""
    layouts = [parse_recipe_and_product(*texts)[2] for texts in {log.recipe_and_product(a) for a in attempts}]
    counter = any(layout.counter is not None for layout in layouts)
    temperature = any(layout.temperature is not None for layout in layouts)
    return (*ALWAYS_COLUMNS, *["counter"] * counter, *["temperature_degC"] * temperature)


def _clocks(table: SampleTable, visits: Sequence[CapturedVisit], events: Sequence[dict[str, Any]]) -> dict[str, Floats]:
    """Seconds since each row's unit was clamped, and since it was powered; NaN where the log does not say so."""
    starts = run_starts_ns(visits)
    zero = min(starts.values())
    at = table.time_s + np.array([(starts.get(run, zero) - zero) / 1e9 for run in range(max(starts) + 1)])[table.run]
    seated = [e for e in events if e["kind"] == "seated"]
    clamped = [(e["at_ns"] - zero) / 1e9 for e in seated]
    powered = [(e["at_ns"] - zero) / 1e9 for e in seated if e["detail"]["powered"]]
    return {"since_clamp_s": _since(at, clamped), "since_power_s": _since(at, powered)}


def _since(at_s: Floats, begun_s: Sequence[float]) -> Floats:
    """Seconds (n) from the last beginning before each instant (n)."""
    edges = np.array([np.nan, *begun_s])
    return np.asarray(at_s - edges[np.searchsorted(edges[1:], at_s, side="right")])


def _complete(
    table: SampleTable, labels: dict[str, str], wanted: Sequence[str], runs: int, late_s: float
) -> SampleTable:
    n = len(table)
    values: dict[str, Floats] = {name: table.values.get(name, np.full(n, np.nan)) for name in wanted}
    values["started_s"] = values["started_s"] + late_s
    return replace(table, run=table.run + np.int32(runs), values=values).labelled(labels)


def _marks(log: LogReader, attempt: Attempt, visits: Sequence[CapturedVisit], zero_ns: int) -> list[Annotation]:
    _, _, layout = parse_recipe_and_product(*log.recipe_and_product(attempt))
    try:
        return annotate_visits(NestAssignment(attempt.serial, attempt.nest, attempt.node), visits, layout, zero_ns)
    except ValidationError as exc:
        raise UsageError("marks-serial-characters", serial=attempt.serial) from exc


def _check_apart(marks: Sequence[tuple[Attempt, CapturedVisit]]) -> None:
    last: dict[int, tuple[int, Attempt]] = {}
    for attempt, visit in sorted(marks, key=lambda m: m[1].from_ns):
        until, other = last.get(attempt.node, (visit.from_ns, attempt))
        if visit.from_ns < until and other.attempt != attempt.attempt:
            raise UsageError("attempts-overlap", first=other.attempt, second=attempt.attempt, node=attempt.node)
        last[attempt.node] = max(until, visit.to_ns), attempt


def _result(attempt: Attempt, stored: dict[str, Any]) -> dict[str, Any]:
    fit = stored_attempt.result(stored, "calibration") or {}
    verdict = stored_attempt.result(stored, "verdict") or {}
    identity = stored_attempt.result(stored, "identity") or {}
    theta, std = _theta(fit)
    return {
        "serial": attempt.serial,
        "attempt": attempt.attempt,
        "outcome": attempt.outcome,
        "simulated": stored_attempt.mark_of(attempt.software),
        "started": stored["started"],
        "ended": stored["ended"],
        **{k: getattr(attempt, k) for k in ("station", "nest", "node", "lot", "operator", "software")},
        **{k: getattr(attempt, k) for k in ("recipe_name", "recipe_version", "recipe_hash", "config_hash")},
        "firmware": identity.get("software"),
        **dict(zip(coefficients.NAMES, theta, strict=True)),
        **{f"std {name}": value for name, value in zip(coefficients.NAMES, std, strict=True)},
        **{k: fit.get(k) for k in ("residual_rms", "false_accept", "false_reject")},
        **{k: verdict.get(k) for k in ("written", "verified", "noise")},
        "reasons": "; ".join(r["sentence"] for r in verdict.get("reasons", ())),
        "seal": "" if stored["seal"] is None else f"{stored['seal']['number']}:{stored['seal']['hash']}",
    }


def _theta(fit: dict[str, Any]) -> tuple[list[float | None], list[float | None]]:
    if fit.get("offset") is None:
        return [None] * 12, [None] * 12
    variance = np.diagonal(np.array(fit["covariance"], float))
    return [*fit["offset"], *(v for row in fit["matrix"] for v in row)], np.sqrt(np.maximum(variance, 0)).tolist()
