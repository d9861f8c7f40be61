"""The operator's page: what stands on it, what changes on it, and the one door for commands."""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Mapping
from dataclasses import fields
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from station.errors import StationError, UsageError
from station.messages import Message
from station.web import language, render
from station.web.accounts import Account
from station.web.guard import form_of, require_right
from station.web.operator_actions import ACTIONS, ActionForm, PassedAlready
from station.web.panel import Panel
from station.web.sessions import Session

#: How often the state is looked at, and how often an unchanged one is confirmed, s.
POLL_S, HEARTBEAT_S = 0.04, 0.5
_ABSENT = object()


@require_right("watch")
async def show(request: Request, session: Session) -> Response:
    """The page; everything that moves on it comes by /events."""
    panel: Panel = request.app.state.panel
    nests = [n.name for n in panel.settings.nests]
    return render.page(request, "operator.html", session, nests=nests, simulated=panel.order.simulate)


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
            yield f"event: change\ndata: {json.dumps({**translated, 'now_s': time.time()})}\n\n"
        if changed or time.monotonic() - last_sent_s > HEARTBEAT_S:
            last_sent_s = time.monotonic()
            if panel.people.get(session.account.name) != session.account:
                break
            yield f"event: beat\ndata: {time.time():.3f}\n\n"
        await asyncio.sleep(POLL_S)
    if not panel.over:
        yield "event: out\ndata: 0\n\n"


def _translated(key: str, value: Any, code: str) -> Any:
    """What a screen shows, its sentences in the reader's language."""
    if key in ("fault", "golden", "instruction"):
        return language.sentence(value, code)
    if key == "messages":
        return [language.sentence(message, code) for message in value]
    if key == "confirm" and value:
        return {**value, "confirm": language.sentence(_request_of(value["confirm"]), code)}
    if key.startswith("nest ") and "reasons" in value:
        return {**value, "reasons": [language.sentence(message, code) for message in value["reasons"]]}
    return value


def _request_of(action: Mapping[str, Any] | str) -> Message | str:
    """What a person must do, with the button that says that it is done."""
    return Message("then-press-done", action=Message.of(action)) if isinstance(action, Mapping) else action


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
    Route("/events", events, methods=["GET"]),
    Route("/command", command, methods=["POST"]),
]
