"""The operator's page: what stands on it, what changes on it, and the one door for commands."""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Mapping

from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from station.domain import serial as serials_of
from station.errors import StationError, UsageError
from station.web import render
from station.web.guard import form_of, person
from station.web.panel import Panel
from station.web.sessions import Session

#: How often the state is looked at, and how often an unchanged one is confirmed, s.
LOOK_S, BEAT_S = 0.04, 0.5
_ABSENT = object()


@person("watch")
async def show(request: Request, session: Session) -> Response:
    """The page; everything that moves on it comes by /events."""
    panel: Panel = request.app.state.panel
    nests = [n.name for n in panel.settings.nests]
    return render.page(request, "operator.html", session, nests=nests, simulated=panel.order.simulate)


@person("watch")
async def events(request: Request, session: Session) -> Response:
    """Server-sent events: first everything, then only what changed; a beat every half second."""
    headers = {"X-Accel-Buffering": "no"}
    return StreamingResponse(_stream(request.app.state.panel, session), media_type="text/event-stream", headers=headers)


async def _stream(panel: Panel, session: Session) -> AsyncIterator[str]:
    sent: dict[str, object] = {}
    said_s = 0.0
    yield "retry: 300\n\n"
    while not panel.over and panel.sessions.open(session.token):
        shown = panel.screen.shown()
        changed = {k: v for k, v in shown.items() if sent.get(k, _ABSENT) != v}
        if changed:
            sent.update(changed)
            yield f"event: change\ndata: {json.dumps({**changed, 'now_s': time.time()})}\n\n"
        if changed or time.monotonic() - said_s > BEAT_S:
            said_s = time.monotonic()
            yield f"event: beat\ndata: {time.time():.3f}\n\n"
        await asyncio.sleep(LOOK_S)
    if not panel.over:
        yield "event: out\ndata: 0\n\n"


@person("run")
async def command(request: Request, session: Session) -> Response:
    """One deed of a person: scan, clear, resume, start, stop. It is in the journal before it is done."""
    form = await form_of(request, session)
    panel: Panel = request.app.state.panel
    action, serial = str(form.get("action", "")), str(form.get("serial", "")).strip()
    try:
        if action not in ACTIONS:
            raise UsageError(f"there is no action {action[:20]!r}; use one of {', '.join(ACTIONS)}")
        told = ACTIONS[action](panel, session.account.name, serial)
    except StationError as exc:
        return JSONResponse({"error": exc.sentence}, 409)
    return JSONResponse({"told": told})


def _scan(panel: Panel, name: str, serial: str) -> str:
    """The serial goes to the first free nest."""
    _idle(panel)
    scans = panel.screen.scans
    serials_of.check_all([*scans.values(), serial], panel.recipe)
    free = next((n.name for n in panel.settings.nests if n.name not in scans), None)
    if free is None:
        raise UsageError(f"all {len(scans)} nests are taken; start, or clear the list")
    panel.journal.add(name, "scan", serial=serial, nest=free)
    scans[free] = serial
    return f"{serial}: {free}"


def _clear(panel: Panel, name: str, _serial: str) -> str:
    _idle(panel)
    panel.journal.add(name, "clear", serials=list(panel.screen.scans.values()))
    panel.screen.scans.clear()
    return ""


def _resume(panel: Panel, name: str, _serial: str) -> str:
    """The units of the last load that came to no verdict are taken up again, each in its nest."""
    _idle(panel)
    left = panel.screen.unfinished()
    if not left:
        raise UsageError("every unit of the last load has its verdict; scan new ones")
    serials_of.check_all(list(left.values()), panel.recipe)
    panel.journal.add(name, "resume", serials=list(left.values()))
    panel.screen.scans = dict(left)
    return ", ".join(left.values())


def _start(panel: Panel, name: str, _serial: str) -> str:
    scans = panel.screen.scans
    nests = [n.name for n in panel.settings.nests]
    if not scans:
        raise UsageError("no unit is scanned; scan one, then start")
    serials = [scans[n] for n in nests if n in scans]
    serials_of.check_all(serials, panel.recipe)
    _idle(panel)
    panel.journal.add(name, "start", serials=serials, recipe=panel.order.recipe)
    panel.runs.start(serials, name)
    scans.clear()
    return ", ".join(serials)


def _stop(panel: Panel, name: str, _serial: str) -> str:
    pid = panel.runs.stop()
    panel.screen.stopping = True
    panel.journal.add(name, "stop", pid=pid)
    return ""


def _idle(panel: Panel) -> None:
    if panel.runs.pid() is not None:
        raise UsageError("a run is under way; wait for its end or stop it")


ACTIONS: Mapping[str, Callable[[Panel, str, str], str]] = {
    "scan": _scan,
    "clear": _clear,
    "resume": _resume,
    "start": _start,
    "stop": _stop,
}

ROUTES = [
    Route("/", show, methods=["GET"]),
    Route("/events", events, methods=["GET"]),
    Route("/command", command, methods=["POST"]),
]
