"""Golden and known-bad units of this station: their register, where they stand by the log, and the lock they are."""

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from station.config.settings import Settings
from station.domain.line_quality.golden import (
    EnTrend,
    GoldenStatus,
    LatestResult,
    RegisteredUnit,
    en_trends,
    golden_status,
)
from station.domain.methods import coefficients
from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.errors import ConfigError, LogError, ReferenceOverdue, StationFault, UsageError
from station.files.json_text import NOT_AS_EXPECTED, read_json, unread_reason
from station.files.replace import replace_text
from station.messages import system_reason
from station.ports.log_reader import Attempt, LogReader, Query

SCHEMA = "station.golden/1"
#: Clocks that are set by NTP step by less; simulated time runs ahead by as much as its loads last.
CLOCK_TOLERANCE_S = 3600.0

#: Opens the log; None where nothing was ever run.
FindLog = Callable[[], LogReader | None]


def load(path: Path) -> dict[str, RegisteredUnit]:
    """The register by serial; empty where there is no file. Errors: ConfigError."""
    if not path.exists():
        return {}
    try:
        units = read_json(path)["units"]
        return {u["serial"]: _expected(u) for u in units}
    except (OSError, *NOT_AS_EXPECTED) as exc:
        raise ConfigError("golden-register-unreadable", file=str(path), why=unread_reason(exc)) from exc


def save(path: Path, units: dict[str, RegisteredUnit]) -> None:
    """Writes the register whole or not at all. Errors: ConfigError."""
    text = json.dumps({"schema": SCHEMA, "units": [asdict(u) for u in units.values()]}, indent=1, allow_nan=False)
    try:
        replace_text(path, text, durable=True)
    except OSError as exc:
        raise ConfigError("golden-register-not-written", file=str(path), why=system_reason(exc)) from exc


def expect(log: LogReader, serial: str, *, bad: bool, share: float, due: str) -> RegisteredUnit:
    """What a unit's newest judged attempt came to, as what it must come to again.

    share: half-width of each value, as a share of the recipe's limit. Errors: LogError.
    """
    attempt = _newest(log, serial, None)
    if attempt is None:
        raise LogError("golden-without-verdict", log=log.location, serial=serial)
    wanted = "FAIL" if bad else "PASS"
    kind = "known-bad" if bad else "golden"
    if attempt.outcome != wanted:
        raise LogError("golden-other-outcome", serial=serial, outcome=str(attempt.outcome), kind=kind)
    shown = _golden_result(log, attempt)
    recipe = Recipe.model_validate_json(log.recipe_and_product(attempt)[0])
    halves = _half_widths(recipe, share)
    return RegisteredUnit(
        serial=serial,
        kind="known-bad" if bad else "golden",
        recipe=attempt.recipe_name,
        outcome=wanted,
        values={} if bad else {k: (v, halves[k]) for k, v in shown.values.items() if k in halves},
        checks=shown.checks if bad else (),
        due=due,
    )


def by_certificate(serial: str, values: Sequence[str], due: str) -> RegisteredUnit:
    """A golden unit by another laboratory's values, each `NAME=VALUE:U`; it need not have been run here yet.

    Errors: UsageError.
    """
    found = {}
    for text in values:
        name, _, number = text.partition("=")
        value, _, wide = number.partition(":")
        try:
            pair = float(value), float(wide)
        except ValueError as exc:
            raise UsageError("golden-value-form", text=text[:60]) from exc
        if not all(map(math.isfinite, pair)):
            raise UsageError("golden-value-form", text=text[:60])
        if name not in coefficients.NAMES:
            nearest = get_close_matches(name, coefficients.NAMES, 1, 0)[0]
            raise UsageError("golden-value-name", name=name[:40], nearest=nearest)
        if pair[1] <= 0:
            raise UsageError("golden-value-uncertainty", name=name, wide=pair[1])
        if name in found:
            raise UsageError("golden-value-twice", name=name)
        found[name] = pair
    return RegisteredUnit(serial, "golden", "", "PASS", found, (), due, external=True)


def standings(settings: Settings, find_log: FindLog) -> list[GoldenStatus]:
    """Every registered unit; nothing where config.yaml has no golden block. Errors: ConfigError, LogError."""
    if settings.golden is None:
        return []
    units = load(Path(settings.golden.file))
    if not units:
        return []
    results: dict[str, LatestResult | None] = dict.fromkeys(units)
    log, now_s = find_log(), time.time()
    if log is not None:
        with log:
            refuse_clock_behind(log, now_s)
            for serial, unit in units.items():
                attempt = _newest(log, serial, unit.recipe or None)
                results[serial] = None if attempt is None else _golden_result(log, attempt)
    today = stored_attempt.utc_day(int(now_s * 1e9))
    return [golden_status(u, results[s], now_s, today, settings.golden.every_h) for s, u in units.items()]


def trends(log: LogReader, unit: RegisteredUnit) -> tuple[EnTrend, ...]:
    """Eₙ of each certified value over every judged attempt of the unit. Errors: LogError, UsageError."""
    if not unit.external:
        raise UsageError("golden-without-certificate", serial=unit.serial)
    found = [a for a in log.attempts(Query(serial=unit.serial)) if a.outcome in ("PASS", "FAIL")]
    return en_trends(unit, [_golden_result(log, attempt) for attempt in reversed(found)])


def refuse_unless_checked(settings: Settings, find_log: FindLog, serials: Sequence[str]) -> None:
    """Lets a load of registered units only always through. Errors: ReferenceOverdue while a check is due or failed."""
    if settings.golden is None:
        return
    register = Path(settings.golden.file)
    units = load(register)
    if not units:
        raise ReferenceOverdue("golden-register-empty", file=str(register))
    if set(serials) <= set(units):
        return
    problems = [s.problem for s in standings(settings, find_log) if s.problem]
    if problems:
        raise ReferenceOverdue("; ".join(problems))


def refuse_clock_behind(log: LogReader, now_s: float) -> None:
    """StationFault where the clock stands before what the log has already: due dates by it would say nothing."""
    newest = log.attempts(Query(), 1)
    behind_s = newest[0].started_ns / 1e9 - now_s if newest else 0.0
    if behind_s > CLOCK_TOLERANCE_S:
        raise StationFault("clock-behind", behind_s=behind_s, log=log.location)


def _newest(log: LogReader, serial: str, recipe: str | None) -> Attempt | None:
    """The unit's newest attempt that came to a verdict."""
    found = log.attempts(Query(serial=serial, recipe_name=recipe), 100)
    return next((a for a in found if a.outcome in ("PASS", "FAIL")), None)


def _golden_result(log: LogReader, attempt: Attempt) -> LatestResult:
    stored = log.attempt(attempt)
    fit, verdict = stored_attempt.result(stored, "calibration") or {}, stored_attempt.result(stored, "verdict") or {}
    values, expanded = dict[str, float](), dict[str, float]()
    if fit.get("offset") is not None:
        theta = [*fit["offset"], *(v for row in fit["matrix"] for v in row)]
        values = dict(zip(coefficients.NAMES, theta, strict=True))
        expanded = {b["coefficient"]: b["expanded"] for b in fit["budget"]}
    checks = tuple(sorted({str(r["check"]) for r in verdict.get("reasons", ())}))
    return LatestResult((attempt.ended_ns or attempt.started_ns) / 1e9, str(attempt.outcome), values, checks, expanded)


def _half_widths(recipe: Recipe, share: float) -> dict[str, float]:
    limits = recipe.limits
    half = {"offset": limits.offset, "gain": limits.gain, "cross-axis": limits.cross_axis}
    half_widths = {name: half[name.partition(" ")[0]] for name in coefficients.NAMES}
    return {name: share * limit for name, limit in half_widths.items() if limit is not None}


def _expected(unit: dict[str, Any]) -> RegisteredUnit:
    values = {k: (float(v), float(half)) for k, (v, half) in unit["values"].items()}
    return RegisteredUnit(**{**unit, "values": values, "checks": tuple(unit["checks"])})
