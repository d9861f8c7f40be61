"""The face of `station rig axes`: the axes' own errors, from the log, and the map without them."""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from station.cli._audit_text import print_rows
from station.cli._log_options import open_named_log, parse_time_ns
from station.cli._output import activity, print_json, print_message
from station.cli._rig_drives import map_document, write_map
from station.config.rigs import load_rig
from station.config.settings import load_config
from station.domain.records.stored_attempt import utc
from station.domain.rig.axis_errors import AxisError, worth_telling
from station.domain.rig.rig_map import RigMap
from station.errors import UsageError
from station.messages import Message, render
from station.ports.log_reader import Query
from station.service.rig_axes import AxisReport, axes_of_log
from station.wiring.positioners import AXIS_KINDS, positioner_options

SCHEMA = "station.rig-axes/1"


@dataclass(frozen=True, slots=True)
class AxesRequest:
    """The options of `station rig axes`. map: left out, that of config.yaml; since: left out, all of the log."""

    config: Path | None
    db: Path | None
    map: str | None
    since: str | None
    most: int
    correct: Path | None
    json: bool


def axes(request: AxesRequest) -> int:
    """Estimates; exit code 0 where no error is worth a correction, else 1."""
    rig = load_rig(request.map) if request.map else _map_of(request.config)
    query = Query(since_ns=parse_time_ns(request.since, "--since"))
    with open_named_log(request.db, request.config) as log, activity(Message("activity-log", log=log.location)):
        found = axes_of_log(log, query, rig, request.most)
    if request.correct is not None:
        write_map(request.correct, found.corrected)
    messages = findings(found)
    if request.json:
        print_json(_document(found, messages))
    else:
        _print(found, messages, request.correct)
    return 1 if messages else 0


def findings(found: AxisReport) -> list[Message]:
    """What is worth a correction, in sentences."""
    lines: list[Message] = []
    for error in filter(worth_telling, found.errors.errors):
        value, interval = error.value or 0.0, error.interval or 0.0
        match error.kind:
            case "zero":
                lines.append(Message("rig-axes-zero", axis=error.axis, value_deg=value, interval_deg=interval))
            case "square":
                lines.append(Message("rig-axes-square", axis=error.axis, value_deg=value, interval_deg=interval))
            case "scale":
                lines.append(Message("rig-axes-scale", axis=error.axis, value=value, interval=interval))
            case _:
                parts = [found.errors.of(error.axis, kind).value or 0.0 for kind in ("sine", "cosine")]
                lines.append(Message("rig-axes-index", axis=error.axis, value_deg=math.hypot(*parts)))
    return list(dict.fromkeys(lines))


def _map_of(config: Path | None) -> RigMap:
    settings, document = load_config(config)
    if settings.positioner.kind not in AXIS_KINDS:
        raise UsageError("rig-axes-kind", kind=settings.positioner.kind)
    return load_rig(positioner_options(settings, document).map)


def _print(found: AxisReport, messages: list[Message], corrected: Path | None) -> None:
    shown = [e for e in found.errors.errors if e.value is not None]
    rows = [[e.axis, render(_name(e)), *_figures(e)] for e in shown]
    title = f"{len(found.serials)} units, residual {found.errors.residual_g * 1e3:.3f} mg"
    print_rows(title, ("axis", "error", "value", "U (95 %)", ""), rows)
    for error in found.errors.errors:
        if error.value is None:
            print_message(Message("rig-axes-hidden", axis=error.axis, error=_name(error)))
    for message in messages or [Message("rig-axes-good")]:
        print_message(message)
    if corrected is not None:
        print_message(Message("rig-axes-corrected", file=str(corrected)))


def _name(error: AxisError) -> Message:
    match error.kind:
        case "zero":
            return Message("rig-error-zero")
        case "scale":
            return Message("rig-error-scale")
        case "square":
            return Message("rig-error-square")
        case "sine":
            return Message("rig-error-sine")
        case _:
            return Message("rig-error-cosine")


def _figures(error: AxisError) -> tuple[str, str, str]:
    value, interval = error.value or 0.0, error.interval or 0.0
    if error.kind == "scale":
        return f"{value:+.2e}", f"{interval:.1e}", ""
    return f"{value:+.4f}", f"{interval:.4f}", "°"


def _document(found: AxisReport, messages: list[Message]) -> dict[str, Any]:
    errors = [{**asdict(e), "unit": "1" if e.kind == "scale" else "deg"} for e in found.errors.errors]
    return {
        "schema": SCHEMA,
        "rig": found.rig.name,
        "units": list(found.serials),
        "since": utc(found.since_ns),
        "residual_g": found.errors.residual_g,
        "dof": found.errors.dof,
        "errors": errors,
        "findings": [render(m) for m in messages],
        "messages": [m.document() for m in messages],
        "corrected": map_document(found.corrected),
    }
