"""What stands before every route: who is it, may they, and is the form theirs. Headers that close the page."""

from collections.abc import Awaitable, Callable
from functools import wraps
from typing import TypeVar

from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from station.web.sessions import Session, same_token

COOKIE = "station_session"
#: A form of this page is never larger; a body that is gets 413 before it is read.
MOST_BODY_BYTES = 64 * 1024

_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; style-src 'self'; script-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'; object-src 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
}

Answer = TypeVar("Answer", bound=Response)
Endpoint = Callable[[Request], Awaitable[Response]]


def session_of(request: Request) -> Session | None:
    """The live session of this request, or None."""
    found = request.app.state.panel.sessions.find(request.cookies.get(COOKIE))
    return found if isinstance(found, Session) else None


def person(right: str) -> Callable[[Callable[[Request, Session], Awaitable[Response]]], Endpoint]:
    """Lets only a logged-in person with this right through; a page sends others to the log-in, an action refuses."""

    def decorate(endpoint: Callable[[Request, Session], Awaitable[Response]]) -> Endpoint:
        @wraps(endpoint)
        async def guarded(request: Request) -> Response:
            session = session_of(request)
            if session is None:
                if request.method == "GET" and "text/html" in request.headers.get("accept", ""):
                    return RedirectResponse("/login", 303)
                raise HTTPException(401, "log in first")
            if not session.account.may(right):
                raise HTTPException(403, f"the role {session.account.role} may not do this")
            return await endpoint(request, session)

        return guarded

    return decorate


async def form_of(request: Request, session: Session | None) -> FormData:
    """The posted form, once its size and its token are right. HTTPException 403 or 413 otherwise."""
    form = await request.form(max_files=0, max_fields=300, max_part_size=MOST_BODY_BYTES)
    if session is not None and not same_token(session, str(form.get("csrf", ""))):
        raise HTTPException(403, "this form is not from your page; reload it and try again")
    return form


class Closed(BaseHTTPMiddleware):
    """Refuses large bodies and foreign origins before anything reads them, and closes the answer's headers."""

    async def dispatch(self, request: Request, call_next: RequestResponseEndpoint) -> Response:
        """Checks, calls, adds headers."""
        refused = _refusal(request)
        response = refused if refused is not None else await call_next(request)
        for name, value in _HEADERS.items():
            response.headers.setdefault(name, value)
        return response


def _refusal(request: Request) -> Response | None:
    if request.method in ("GET", "HEAD"):
        return None
    if request.method != "POST":
        return Response("only GET and POST", 405)
    length = request.headers.get("content-length", "")
    if not length.isdigit():
        return Response("a body needs its length", 411)
    if int(length) > MOST_BODY_BYTES:
        return Response("the body is too large", 413)
    origin = request.headers.get("origin")
    if origin is not None and origin.partition("://")[2] != request.headers.get("host", ""):
        return Response("this form is from another site", 403)
    return None
