"""The operator's page: what stands on it, what changes on it, and the one door for commands."""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Mapping
from dataclasses import fields
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from station.domain.methods import coefficients
from station.errors import StationError, UsageError
from station.messages import Message, term
from station.messages.labels import all_texts
from station.panel_protocol.accounts import Account
from station.reporting.drawing.code128 import code128
from station.web import language, render
from station.web.guard import RequestRefusal, form_of, require_right, session_of
from station.web.operator_actions import ACTIONS, ActionForm, PassedAlready
from station.web.panel import Panel
from station.web.sessions import Session
from station.web.tile import tile_of

#: How often the state is looked at, and how often an unchanged one is confirmed, s.
POLL_S, HEARTBEAT_S = 0.04, 0.5
_ABSENT = object()
#: What stands on the cards that a scanner reads in place of a button.
CARDS = ("START", "DONE", "STOP", "CLEAR")


@require_right("watch")
async def show(request: Request, session: Session) -> Response:
    """The page; everything that moves on it comes by /events."""
    panel: Panel = request.app.state.panel
    code, shown = language.of_request(request), panel.screen.shown()
    start = {
        "shown": {k: _translated(k, v, code) for k, v in shown.items()} | {"now_s": time.time()},
        "plan": panel.screen.plan(shown["plan"]),
        "nests": [n.name for n in panel.settings.nests],
        "texts": dict(all_texts()[code]) | {name: term(name, code) for name in coefficients.NAMES},
        "language": code,
    }
    return render.page(request, "operator.html", session, start=start, simulated=panel.order.simulate)


@require_right("watch")
async def plan(request: Request, _session: Session) -> Response:
    """The time line's cells and pictures, which a page fetches when the recipe of the run is another one."""
    panel: Panel = request.app.state.panel
    return JSONResponse(panel.screen.plan(request.query_params.get("id", "")[:40]))


@require_right("run")
async def cards(request: Request, session: Session) -> Response:
    """Cards to print: a scanner does what the buttons do."""
    drawn = {name: code128(name) for name in CARDS}
    return render.page(request, "cards.html", session, cards=drawn)


async def light(request: Request) -> Response:
    """The lamp of the stack light as one word, for what switches a real one: this machine may ask without a log-in."""
    local = request.client is not None and request.client.host in ("127.0.0.1", "::1")
    if not local and session_of(request) is None:
        raise RequestRefusal(401, Message("light-not-for-you"))
    panel: Panel = request.app.state.panel
    return PlainTextResponse(f"{panel.screen.shown()['view']['lamp']}\n")


@require_right("watch")
async def events(request: Request, session: Session) -> Response:
    """Server-sent events: first everything, then only what changed; a beat every half second."""
    headers = {"X-Accel-Buffering": "no"}
    stream = _stream(request.app.state.panel, session, language.of_request(request))
    return StreamingResponse(stream, media_type="text/event-stream", headers=headers)


async def _stream(panel: Panel, session: Session, code: str) -> AsyncIterator[str]:
    sent: dict[str, object] = {}
    last_sent_s = 0.0
    yield "retry: 300\n\n"
    while not panel.over and panel.sessions.open(session.token):
        shown = panel.screen.shown()
        changed = {k: v for k, v in shown.items() if sent.get(k, _ABSENT) != v}
        if changed:
            sent.update(changed)
            translated = {k: _translated(k, v, code) for k, v in changed.items()}
            yield f"event: change\ndata: {_short_json({**translated, 'now_s': round(time.time(), 3)})}\n\n"
        if changed or time.monotonic() - last_sent_s > HEARTBEAT_S:
            last_sent_s = time.monotonic()
            if panel.people.get(session.account.name) != session.account:
                break
            yield f"event: beat\ndata: {time.time():.3f}\n\n"
        await asyncio.sleep(POLL_S)
    if not panel.over:
        yield "event: out\ndata: 0\n\n"


def _short_json(document: Mapping[str, Any]) -> str:
    """Without blanks, and every sign as itself: an update is some hundred bytes, many times a second."""
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False)


def _translated(key: str, value: Any, code: str) -> Any:
    """What a screen shows, its sentences in the reader's language."""
    if key in ("fault", "golden", "held", "instruction", "note", "shipping", "watch"):
        return language.sentence(value, code)
    if key == "confirm" and value:
        return {**value, **_question(value["confirm"], code)}
    if key.startswith("nest "):
        return _translated_nest(value, code)
    return value


#: What a person must do as a headline, and what kind of picture goes with it.
_HEADLINES = {
    "turn-units": ("act-turn", "turn"),
    "turn-units-home": ("act-turn-home", "turn"),
    "turn-base": ("act-base", "base"),
    "set-temperature": ("act-temperature", "temperature"),
    "swing-temperature": ("act-swing", "temperature"),
    "switch-filter-on": ("act-filter-on", "filter"),
    "switch-filter-off": ("act-filter-off", "filter"),
    "switch-motors-off": ("act-motors", "motors"),
}


def _question(action: Mapping[str, Any] | str, code: str) -> dict[str, Any]:
    """The whole sentence, its headline, the kind of picture and the angle of a turn."""
    sentence = language.sentence(action, code)
    if not isinstance(action, Mapping) or action.get("id") not in _HEADLINES:
        return {"confirm": sentence, "title": sentence, "kind": "", "angle": ""}
    title, kind = _HEADLINES[action["id"]]
    parameters = {k: v for k, v in action.items() if k in ("angle_deg", "axis", "offset_degC", "swing_degC")}
    angle = f"{action['angle_deg']:g}°" if "angle_deg" in action else ""
    title_text = language.sentence({"id": title, **parameters}, code)
    return {"confirm": sentence, "title": title_text, "kind": kind, "angle": angle}


def _translated_nest(nest: Mapping[str, Any], code: str) -> dict[str, Any]:
    shown = {k: v for k, v in nest.items() if k not in ("node", "figure", "last")}
    if nest.get("reasons"):
        shown["reasons"] = [language.sentence(message, code) for message in nest["reasons"]]
    if nest.get("outcome"):
        shown["tile"] = tile_of(nest.get("figure"), code)
    if nest.get("last"):
        reason = Message.recorded(nest["last"]["reason"])
        shown["last"] = {"at_s": nest["last"]["at_s"], "reason": language.sentence(reason, code)}
    return shown


@require_right("run")
async def command(request: Request, session: Session) -> Response:
    """One deed of a person; it is in the journal before it is done. A stop waits for no other deed."""
    form = await form_of(request, session)
    panel: Panel = request.app.state.panel
    submitted = ActionForm(*(str(form.get(f.name, "")).strip() for f in fields(ActionForm)))
    action = str(form.get("action", ""))
    try:
        if action not in ACTIONS:
            raise UsageError("page-unknown-action", action=action[:20], actions=tuple(ACTIONS))
        done = await run_in_threadpool(_perform, panel, action, session.account, submitted)
    except StationError as exc:
        answer = {"error": language.sentence(exc.message, language.of_request(request))}
        if isinstance(exc, PassedAlready):
            answer["again"] = submitted.serial if session.account.may("again") else ""
        return JSONResponse(answer, 409)
    return JSONResponse({"told": done})


def _perform(panel: Panel, action: str, who: Account, submitted: ActionForm) -> str:
    if action == "stop":
        return ACTIONS[action](panel, who, submitted)
    with panel.turn:
        return ACTIONS[action](panel, who, submitted)


ROUTES = [
    Route("/", show, methods=["GET"]),
    Route("/plan", plan, methods=["GET"]),
    Route("/cards", cards, methods=["GET"]),
    Route("/light", light, methods=["GET"]),
    Route("/events", events, methods=["GET"]),
    Route("/command", command, methods=["POST"]),
]
