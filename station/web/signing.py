"""A signature under an attempt, at the unit's page: the password is given for this one act."""

from typing import Any
from urllib.parse import urlencode

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from station.errors import LogError, UsageError
from station.panel_protocol.accounts import Account
from station.panel_protocol.signature import SignatureWish, check_wish
from station.ports.log_reader import Query
from station.web.guard import form_of, require_right
from station.web.login import person_of
from station.web.panel import Panel
from station.web.sessions import Session
from station.wiring.signing import seal_signature


@require_right("sign")
async def post_signature(request: Request, session: Session) -> Response:
    """Checks the password once more, then seals the signature into the log and shows the unit's page."""
    panel: Panel = request.app.state.panel
    form = await form_of(request, session)
    serial, attempt = str(form.get("serial", "")), str(form.get("attempt", ""))
    wish = SignatureWish(str(form.get("meaning", "")), str(form.get("comment", "")))
    who = await person_of(request, session.account.name, str(form.get("password", "")), "sign-refused")
    if who is None:
        raise UsageError("sign-wrong-password", name=session.account.name)
    await run_in_threadpool(_sign, panel, who, serial, attempt, wish)
    shown = urlencode({"serial": serial, "attempt": attempt})
    return RedirectResponse(f"/audit/unit?{shown}", 303)


def _sign(panel: Panel, who: Account, serial: str, attempt: str, wish: SignatureWish) -> None:
    with panel.turn:
        stored = _stored(panel, serial, attempt)
        check_wish(who, stored, wish)
        panel.journal.add(who.name, "sign", serial=serial, attempt=attempt, meaning=wish.meaning)
        seal_signature(panel.order.database, panel.settings, who, stored, wish)


def _stored(panel: Panel, serial: str, attempt: str) -> dict[str, Any]:
    with panel.log() as log:
        for found in log.attempts(Query(serial=serial)):
            if found.attempt == attempt:
                return log.attempt(found)
    raise LogError("page-no-attempt", attempt=attempt[:40], serial=serial[:40])


ROUTES = [Route("/audit/sign", post_signature, methods=["POST"])]
