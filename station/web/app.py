"""The page's application. Nothing is made at import: `create_app(panel)` makes it."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from station.errors import InputError, StationError
from station.web import audit, diagnosis, language, line_page, login, metrics, operator, render
from station.web.guard import Closed, session_of
from station.web.panel import Panel
from station.web.sentences import translate


def create_app(panel: Panel) -> Starlette:
    """The application over one panel."""
    app = Starlette(
        routes=[
            *login.ROUTES,
            *operator.ROUTES,
            *audit.ROUTES,
            *diagnosis.ROUTES,
            *line_page.ROUTES,
            *metrics.ROUTES,
            Mount("/static", StaticFiles(directory=Path(__file__).parent / "static")),
        ],
        middleware=[Middleware(Closed)],
        exception_handlers={HTTPException: _refused, StationError: _sentence},
        lifespan=_lifespan,
    )
    app.state.panel = panel
    return app


@asynccontextmanager
async def _lifespan(app: Starlette) -> AsyncIterator[None]:
    """While the page serves: the charts are counted once beside it, so that nobody waits for the first look."""
    counting = asyncio.create_task(run_in_threadpool(line_page.warm, app.state.panel))
    yield
    await counting


async def _refused(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, HTTPException)
    return _told(request, exc.detail, exc.status_code)


async def _sentence(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, StationError)
    return _told(request, exc.sentence, 400 if isinstance(exc, InputError) else 503)


def _told(request: Request, sentence: str, status: int) -> Response:
    """One sentence in the reader's language: a page for a browser, JSON for a script."""
    sentence = translate(sentence, language.of_request(request))
    if "text/html" in request.headers.get("accept", ""):
        return render.page(request, "sentence.html", session_of(request), status, sentence=sentence)
    return JSONResponse({"error": sentence}, status)
