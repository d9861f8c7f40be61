"""A unit's page: why its attempt ended as it did, first; everything else that was done to it below, hashes folded."""

import json
from dataclasses import replace
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from station.domain.methods import coefficients
from station.domain.records.stored_attempt import is_simulated, result, signatures
from station.errors import LogError
from station.panel_protocol.signature import Meaning
from station.ports.log_reader import Attempt, LogReader, Query
from station.reporting.drawing.drawing import Drawing
from station.reporting.line import unit_view
from station.reporting.line.statistics import AttemptValues, values_of
from station.reporting.words import Words
from station.service import time_text
from station.web import language, render
from station.web.guard import require_right
from station.web.panel import Panel
from station.web.sessions import Session

#: Of a day so many attempts are compared at most, the nearest ones; units of one load begin within so many seconds.
MOST_NEIGHBOURS, LOAD_S = 150, 5.0
DAY_NS = 86_400 * 10**9


@require_right("audit")
async def show(request: Request, session: Session) -> Response:
    """One attempt of a unit, the newest unless the address names another, and all its attempts."""
    panel: Panel = request.app.state.panel
    serial, wanted = request.query_params.get("serial", ""), request.query_params.get("attempt", "")
    words = language.words(language.of_request(request))
    shown = await run_in_threadpool(_gather, panel, serial, wanted, words)
    return render.page(request, "unit.html", session, serial=serial, **shown)


def _gather(panel: Panel, serial: str, wanted: str, words: Words) -> dict[str, Any]:
    with panel.log() as log:
        lives = log.life(Query(serial=serial))
        if not lives:
            raise LogError("page-no-unit", serial=serial[:40])
        chosen = next((a for a in lives if a["attempt"] == wanted), lives[-1])
        row = next(a for a in log.attempts(Query(serial=serial)) if a.attempt == chosen["attempt"])
        day = _day_of(panel, log, row)
        load = _load_of(log, row)
        unit = str(json.loads(log.recipe_and_product(row)[0])["unit"])
    return {**_why(chosen, unit, day, words), "a": chosen, "lives": lives[::-1], "load": load, **_history(lives)}


def _why(chosen: dict[str, Any], unit: str, day: list[AttemptValues], words: Words) -> dict[str, Any]:
    """The reasons, the value that decided, and what its surroundings say. unit: of its readings."""
    fit, verdict = result(chosen, "calibration"), result(chosen, "verdict") or {}
    identity = result(chosen, "identity") or {}
    reasons = verdict.get("reasons") or []
    first = unit_view.deciding(fit, reasons, words)
    own = values_of(chosen) if chosen["outcome"] else None
    near: Drawing | None = None
    sentence = ""
    if first and own:
        limits = unit_view.limits_of_value(fit, first.what)
        near = unit_view.neighbours(day, own, first.what, limits, words, _clock)
        missed = limits if reasons and chosen["outcome"] == "FAIL" else None
        sentence = unit_view.nest_sentence(day, own, first.what, missed, words)
    return {
        "reasons": reasons,
        "simulated": is_simulated(chosen["software"]),
        "deciding": first,
        "rest": unit_view.rest(fit, first.what if first else "", words),
        "residuals": unit_view.residual_figure(fit, words) or unit_view.reading_figure(chosen["visits"], unit, words),
        "neighbours": near,
        "nest_sentence": sentence,
        "device": " ".join(str(identity[k]) for k in ("name", "software") if identity.get(k)),
        "written": bool(verdict.get("written")),
        "verified": bool(verdict.get("verified")),
        "local": time_text.local(chosen["started_ns"]),
        "signatures": signatures(chosen),
        "meanings": tuple(Meaning),
    }


def _clock(time_ns: int) -> str:
    """Hour and minute, for an axis."""
    return time_text.local_short(time_ns)[11:16]


def _day_of(panel: Panel, log: LogReader, row: Attempt) -> list[AttemptValues]:
    """Values of the attempts of the same recipe on the same day as this one, as many as lie nearest."""
    same = Query(station=row.station, recipe_hash=row.recipe_hash)
    half = MOST_NEIGHBOURS // 2
    before = log.attempts(replace(same, since_ns=row.started_ns - DAY_NS // 2, until_ns=row.started_ns + 1), half)
    after = log.attempts(replace(same, since_ns=row.started_ns + 1, until_ns=row.started_ns + DAY_NS // 2), half)
    ended = [a for a in [*before, *after] if a.outcome is not None]
    return [panel.memory.measured(log, a)[0] for a in ended]


def _load_of(log: LogReader, row: Attempt) -> list[str]:
    """Serials that went on the fixture together with this one."""
    reach = int(LOAD_S * 1e9)
    near = Query(station=row.station, recipe_hash=row.recipe_hash, since_ns=row.started_ns - reach,
                 until_ns=row.started_ns + reach)  # fmt: skip
    return sorted({a.serial for a in log.attempts(near, 200)})


def _history(lives: list[dict[str, Any]]) -> dict[str, Any]:
    """Coefficients of every attempt that came to some, for the table."""
    fits = [(a, result(a, "calibration")) for a in lives]
    known = [(a, fit) for a, fit in fits if fit and fit.get("offset") is not None]
    rows = [
        (
            name,
            [[*fit["offset"], *(v for row in fit["matrix"] for v in row)][i] for _, fit in known],
            [fit["budget"][i]["expanded"] for _, fit in known],
        )
        for i, name in enumerate(coefficients.NAMES)
    ]
    return {"history": [a for a, _ in known], "rows": rows}


ROUTES = [Route("/audit/unit", show, methods=["GET"])]
