"""What the log keeps, as the rest of the station knows it: samples tables, rows of results."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from station.domain.capture.assemble import run_starts_ns, sample_table
from station.domain.capture.visit import CapturedVisit, decode_visit
from station.domain.core.types import Floats, SampleTable
from station.domain.methods import coefficients
from station.domain.records import stored_attempt
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
