"""The work of `station watch`: alerts as sentences, or as one JSON document a line."""

import math
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from station.cli import _output
from station.domain.records.stored_attempt import utc
from station.domain.watch.bank import WatchedPlace
from station.domain.watch.e_detector import LEARN
from station.domain.watch.size import drift_of, size_of
from station.messages import Message, render
from station.ports.log_reader import LogReader
from station.service import time_text
from station.service.containment import TouchedUnit
from station.service.watch import Finding, Watch

#: The library's effect of each signal that has one.
_EFFECTS = {"nest-tilt", "base-tilt", "index-error"}
_FOUND, _QUIET = 1, 0


@dataclass(frozen=True, slots=True)
class WatchRequest:
    """every_s: between two readings of the log; None: once over it. since_ns: what ended before is left out."""

    run_length: int
    since_ns: int | None
    every_s: float | None


def run_watch(log: LogReader, request: WatchRequest, *, as_json: bool) -> int:
    """Prints the alerts; 1 when there was any. Errors: LogError."""
    watch = Watch(log, request.run_length)
    watch.read()
    found = [f for f in watch.findings() if f.ended_ns is None or f.ended_ns >= (request.since_ns or 0)]
    for finding in found:
        _show(watch, finding, request, as_json=as_json)
    if not found:
        learning = Message("watch-learning", loads=watch.loads, learn=LEARN)
        _output.print_remark(render(learning if watch.learning else Message("watch-quiet", loads=watch.loads)))
    while request.every_s is not None:
        time.sleep(request.every_s)
        for finding in watch.read():
            _show(watch, finding, request, as_json=as_json)
    return _FOUND if found else _QUIET


def _show(watch: Watch, finding: Finding, request: WatchRequest, *, as_json: bool) -> None:
    units = watch.touched(finding)
    message = _sentence(finding, len(units))
    remedy = _remedy(finding.alert.place.signal.kind)
    if as_json:
        head = {"schema": "station.watch/1", "average_run_length": request.run_length}
        _output.print_json({**head, **_document(finding, units, message, remedy)})
        return
    _output.print_message(message)
    for line in _remarks(finding):
        _output.print_line("  " + render(line))
    _output.print_line("  " + render(remedy))
    _output.print_line("  " + _containment(finding))


def _sentence(finding: Finding, units: int) -> Message:
    alert = finding.alert
    where, at = _where(finding.station, alert.place), time_text.local_short(finding.begin_ns)
    return Message("watch-alert", where=where, change=_change(finding), load=alert.begin, at=at, units=units)


def _change(finding: Finding) -> Message:
    size, kind = size_of(finding.alert), finding.alert.place.signal.kind
    figures = {"value": size.value, "low": size.low, "high": size.high}
    match kind:
        case "offset":
            return Message("watch-offset", **figures, unit=finding.recipe.unit)
        case "gain":
            return Message("watch-gain", **figures)
        case "residual":
            return Message("watch-residual", **figures)
        case "noise":
            return Message("watch-noise", **figures)
        case _:
            milli = {name: figure * 1e3 for name, figure in figures.items()}
            return Message("watch-turn", **milli)


def _remedy(kind: str) -> Message:
    match kind:
        case "nest-tilt":
            return Message("watch-remedy-nest")
        case "base-tilt":
            return Message("watch-remedy-base")
        case "index-error":
            return Message("watch-remedy-index")
        case "residual":
            return Message("watch-remedy-residual")
        case "noise":
            return Message("watch-remedy-noise")
        case _:
            return Message("watch-remedy-device")


def _where(station: str, place: WatchedPlace) -> Message:
    if place.signal.position:
        return Message("watch-position", station=station, position=place.signal.position)
    if place.nest:
        return Message("watch-nest", station=station, nest=place.nest)
    if place.signal.kind == "base-tilt":
        return Message("watch-base", station=station)
    return Message("watch-all-nests", station=station)


def _unit(finding: Finding) -> str:
    return size_of(finding.alert).unit or finding.recipe.unit


def _remarks(finding: Finding) -> list[Message]:
    alert = finding.alert
    found: list[Message] = []
    if alert.others:
        names = tuple(f"{p.signal.kind} {p.signal.position or p.nest}".strip() for p in alert.others)
        found.append(Message("watch-others", others=names))
    if (drift := drift_of(alert, finding.recipe.limits)) is not None:
        if drift.loads_to_limit is None:
            found.append(Message("watch-drift", rate=drift.per_load, unit=_unit(finding)))
        else:
            loads = math.ceil(drift.loads_to_limit)
            found.append(Message("watch-drift-limit", rate=drift.per_load, unit=_unit(finding), loads=loads))
    if alert.ended is not None and finding.ended_ns is not None:
        found.append(Message("watch-ended", load=alert.ended, at=time_text.local_short(finding.ended_ns)))
    return found


def _containment(finding: Finding) -> str:
    """The command that lists the units; times in UTC, so that it means the same anywhere."""
    query = finding.query
    words = ["station contain", f"--station {query.station}"]
    words += [f"--nest {query.nest}"] if query.nest else []
    words += [f"--since {_moment(finding.begin_ns)}"]
    words += [f"--until {_moment(finding.ended_ns)}"] if finding.ended_ns is not None else []
    return " ".join(words)


def _moment(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns // 10**9, UTC):%Y-%m-%dT%H:%M:%S}Z"


def _place(station: str, place: WatchedPlace) -> dict[str, Any]:
    kind, position = place.signal.kind, place.signal.position
    where = {"station": station, "nest": place.nest or None, "position": position or None}
    return {"signal": kind, "effect": kind if kind in _EFFECTS else None, **where}


def _document(finding: Finding, units: list[TouchedUnit], message: Message, remedy: Message) -> dict[str, Any]:
    alert, size, drift = finding.alert, size_of(finding.alert), drift_of(finding.alert, finding.recipe.limits)
    ended = None if finding.ended_ns is None else {"load": alert.ended, "at": utc(finding.ended_ns)}
    return {
        **_place(finding.station, alert.place),
        "recipe": {"name": finding.recipe.name, "version": finding.recipe.version},
        "begin": {"load": alert.begin, "at": utc(finding.begin_ns), "low": alert.low, "high": alert.high},
        "raised": {"load": alert.raised, "at": utc(finding.raised_ns)},
        "ended": ended,
        "size": {
            "value": size.value,
            "std": size.std,
            "low": size.low,
            "high": size.high,
            "unit": _unit(finding),
            "vector": None if size.vector is None else list(size.vector),
        },
        "drift": None if drift is None else {"per_load": drift.per_load, "loads_to_limit": drift.loads_to_limit},
        "indistinguishable_from": [_place(finding.station, p) for p in alert.others],
        "units": len(units),
        "serials": [u.serial for u in units],
        "containment": _containment(finding),
        "remedy": render(remedy),
        "message": render(message),
    }
