"""What stands before every route: who is it, may they, and is the form theirs. Headers that close the page."""

import re
from collections.abc import Awaitable, Callable
from functools import wraps
from ipaddress import ip_address

from starlette.datastructures import FormData, Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as AsgiMessage

from station.messages import Message, render
from station.web.render import remember_choice
from station.web.sessions import Session, same_token

SESSION_COOKIE = "station_session"
#: A form of this page is never larger; a body that is gets 413 before it is read.
MOST_BODY_BYTES = 64 * 1024

#: What closes every page: no foreign script, frame or form.
CLOSING_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; connect-src 'self'; img-src 'self' data:; style-src 'self'; "
    "script-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}

_HOST = re.compile(r"(?:(?P<bare>[^\[\]:]+)|\[(?P<bracketed>[0-9A-Fa-f:.]+)\])(?::[0-9]{1,5})?")
_WHOLE_NUMBER = re.compile("[0-9]{1,18}")
Endpoint = Callable[[Request], Awaitable[Response]]


class RequestRefusal(HTTPException):
    """A request refused with a status of HTTP and a message."""

    def __init__(self, status: int, message: Message) -> None:
        super().__init__(status, render(message))
        self.message = message


def parse_whole_number(text: str) -> int | None:
    """A whole number as it came over the wire; None for anything else, also for digits of other scripts."""
    return int(text) if _WHOLE_NUMBER.fullmatch(text) else None


def session_of(request: Request) -> Session | None:
    """The live session of this request, or None; who was removed or given another role has none any more."""
    panel = request.app.state.panel
    found = panel.sessions.find(request.cookies.get(SESSION_COOKIE))
    if not isinstance(found, Session):
        return None
    if panel.people.get(found.account.name) != found.account:
        panel.sessions.end(found.token)
        return None
    return found


def require_right(right: str) -> Callable[[Callable[[Request, Session], Awaitable[Response]]], Endpoint]:
    """Lets only a logged-in person with this right through; a page sends others to the log-in, an action refuses."""

    def decorate(endpoint: Callable[[Request, Session], Awaitable[Response]]) -> Endpoint:
        @wraps(endpoint)
        async def guarded(request: Request) -> Response:
            session = session_of(request)
            if session is None:
                if request.method == "GET" and "text/html" in request.headers.get("accept", ""):
                    return remember_choice(request, RedirectResponse("/login", 303))
                raise RequestRefusal(401, Message("log-in-first"))
            if not (session.account.may(right) and request.app.state.panel.offers(right)):
                raise RequestRefusal(403, Message("role-may-not", role=session.account.role.value))
            return await endpoint(request, session)

        return guarded

    return decorate


async def form_of(request: Request, session: Session | None) -> FormData:
    """The posted form, once its size and its token are right. HTTPException 400 or 403 otherwise."""
    form = await request.form(max_files=0, max_fields=300, max_part_size=MOST_BODY_BYTES)
    if session is not None and not same_token(session, str(form.get("csrf", ""))):
        raise RequestRefusal(403, Message("form-not-yours"))
    return form


class SecurityMiddleware:
    """Refuses foreign names, foreign origins and large bodies before they are read; closes the answer's headers."""

    def __init__(self, app: ASGIApp, host_names: frozenset[str] | None) -> None:
        self._app, self._host_names = app, host_names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Checks, calls, adds headers."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def closed(message: AsgiMessage) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in CLOSING_HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        headers = Headers(scope=scope)
        refused = _foreign_host(headers, self._host_names) or _refusal_response(str(scope["method"]), headers)
        await (refused or self._app)(scope, receive, closed)


def _foreign_host(headers: Headers, known: frozenset[str] | None) -> Response | None:
    """Refuses a name that is not the page's own: a foreign site may have made its name point here (DNS rebinding).
    An address as such cannot be anybody else's name."""
    name = _HOST.fullmatch(headers.get("host", ""))
    host = (name["bare"] or name["bracketed"]).lower() if name else ""
    if known is None or host in known or _is_address(host):
        return None
    return Response("the page is not reached by this name; start it with --host-name NAME", 421)


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _refusal_response(method: str, headers: Headers) -> Response | None:
    if method in ("GET", "HEAD"):
        return None
    if method != "POST":
        return Response("only GET and POST", 405)
    length = parse_whole_number(headers.get("content-length", ""))
    if length is None:
        return Response("a body needs its length", 411)
    if length > MOST_BODY_BYTES:
        return Response("the body is too large", 413)
    origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
    foreign = origin is not None and origin.partition("://")[2] != headers.get("host", "")
    if foreign or site not in ("same-origin", "none"):
        return Response("this form is from another site", 403)
    return None
