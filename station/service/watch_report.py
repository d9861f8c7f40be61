"""What the watch says of an alert: sentences for people, and the document station.watch/1."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from station.domain.records.stored_attempt import utc
from station.domain.watch.bank import WatchedPlace
from station.domain.watch.size import drift_of, size_of
from station.messages import Message, render
from station.service import time_text
from station.service.containment import TouchedUnit
from station.service.watch import Finding

#: The library's effect of each signal that has one.
_EFFECTS = {"nest-tilt", "base-tilt", "index-error"}


def alert_sentence(finding: Finding, units: int) -> Message:
    """What changed, where, by how much, since when. units: touched so far."""
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


def alert_remedy(kind: str) -> Message:
    """What to do about a change of that signal."""
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


def alert_remarks(finding: Finding) -> list[Message]:
    """What else is known: places not told apart, a drift and its limit, the end."""
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
            at = time_text.local_short(finding.newest_ns + loads * finding.load_ns)
            found.append(Message("watch-drift-limit", rate=drift.per_load, unit=_unit(finding), loads=loads, at=at))
    if alert.ended is not None and finding.ended_ns is not None:
        found.append(Message("watch-ended", load=alert.ended, at=time_text.local_short(finding.ended_ns)))
    return found


def _limit_met(finding: Finding, loads: float | None) -> dict[str, Any]:
    """In how many loads a drift meets its limit, and when, as fast as the last loads came."""
    at = None if loads is None else utc(finding.newest_ns + math.ceil(loads) * finding.load_ns)
    return {"loads_to_limit": loads, "meets_limit_at": at}


def containment_command(finding: Finding) -> str:
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


def alert_document(finding: Finding, units: Sequence[TouchedUnit], run_length: float) -> dict[str, Any]:
    """station.watch/1. units: that the change touched; run_length: loads to a false alarm, on average."""
    alert, size, drift = finding.alert, size_of(finding.alert), drift_of(finding.alert, finding.recipe.limits)
    ended = None if finding.ended_ns is None else {"load": alert.ended, "at": utc(finding.ended_ns)}
    remedy, message = alert_remedy(alert.place.signal.kind), alert_sentence(finding, len(units))
    return {
        "schema": "station.watch/1",
        "average_run_length": run_length,
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
        "drift": None if drift is None else {"per_load": drift.per_load, **_limit_met(finding, drift.loads_to_limit)},
        "indistinguishable_from": [_place(finding.station, p) for p in alert.others],
        "units": len(units),
        "serials": [u.serial for u in units],
        "containment": containment_command(finding),
        "remedy": render(remedy),
        "message": render(message),
    }
