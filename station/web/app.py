"""The page's application. Nothing is made at import: `create_app(panel)` makes it."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Mount, Route

from station.errors import InputError, StationError
from station.messages import Message
from station.web import audit, charts_page, diagnosis, language, login, metrics, operator, render, signing, unit_page
from station.web.connections import GONE
from station.web.guard import CLOSING_HEADERS, RequestRefusal, SecurityMiddleware, session_of
from station.web.panel import Panel
from station.web.static_files import HashedFiles


def create_app(panel: Panel) -> Starlette:
    """The application over one panel; a plant's has no routes but those that read."""
    reading = [*login.ROUTES, *audit.ROUTES, *unit_page.ROUTES, *charts_page.ROUTES]
    running = [*operator.ROUTES, *signing.ROUTES, *diagnosis.ROUTES, *metrics.ROUTES]
    app = Starlette(
        routes=[
            *reading,
            *([Route("/", _to_audit, methods=["GET"])] if panel.plant else running),
            Mount("/static", HashedFiles()),
        ],
        middleware=[Middleware(SecurityMiddleware, host_names=panel.host_names)],
        exception_handlers={HTTPException: _http_error, StationError: _station_error, **GONE, Exception: _bug},
        lifespan=_lifespan,
    )
    app.state.panel = panel
    return app


@asynccontextmanager
async def _lifespan(app: Starlette) -> AsyncIterator[None]:
    """While the page serves: what the first look needs is there beforehand; the charts are counted beside it."""
    await run_in_threadpool(_prepare, app.state.panel)
    counting = asyncio.create_task(run_in_threadpool(charts_page.warm_cache, app.state.panel))
    yield
    await counting


def _prepare(panel: Panel) -> None:
    """Templates compiled, the log's figures of today looked up."""
    for name in ("login.html", "operator.html"):
        render.environment().get_template(name)
    if not panel.plant:
        panel.screen.plan(panel.screen.shown()["plan"])


async def _to_audit(request: Request) -> Response:
    return render.remember_choice(request, RedirectResponse("/audit", 303))


async def _http_error(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, HTTPException)
    message = exc.message if isinstance(exc, RequestRefusal) else _refusal_of(request, exc)
    return _error_response(request, message, exc.status_code)


def _refusal_of(request: Request, exc: HTTPException) -> Message:
    """What the router itself refuses, in words that have a translation."""
    known = {404: "page-not-there", 405: "page-not-so"}
    path = request.url.path[:80]
    return Message(known[exc.status_code], path=path) if exc.status_code in known else Message.text(exc.detail)


async def _station_error(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, StationError)
    return _error_response(request, exc.message, 400 if isinstance(exc, InputError) else 503)


async def _bug(request: Request, exc: Exception) -> Response:
    """What nobody foresaw is a sentence, too; the server prints where it happened. It stands outside the middleware."""
    answer = _error_response(request, Message("page-bug", type=type(exc).__name__), 500)
    answer.headers.update(CLOSING_HEADERS)
    return answer


def _error_response(request: Request, message: Message, status: int) -> Response:
    """One sentence in the reader's language: a page for a browser, JSON for a script."""
    sentence = language.sentence(message, language.of_request(request))
    if "text/html" in request.headers.get("accept", ""):
        return render.page(request, "sentence.html", session_of(request), status, sentence=sentence)
    return JSONResponse({"error": sentence}, status)
