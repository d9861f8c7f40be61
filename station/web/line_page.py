"""The engineer's page: the line in charts."""

from contextlib import suppress
from dataclasses import replace

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from station.errors import StationError, UsageError
from station.web import charts, language, render
from station.web.guard import person, whole
from station.web.line_cache import DAY_NS
from station.web.line_statistics import VALUES, Line, gather
from station.web.panel import Panel
from station.web.questions import query_of
from station.web.sessions import Session

#: The page looks at so many of the newest attempts, and over so many days where it is not told.
MOST, DAYS = 200, 7
ASKED = ("since", "until", "station", "nest", "recipe_name", "lot")


@person("charts")
async def show(request: Request, session: Session) -> Response:
    """Charts of the attempts that the address asks for."""
    asked = {k: request.query_params.get(k, "") for k in ASKED}
    value, size = request.query_params.get("value", VALUES[0]), whole(request.query_params.get("size", "1"))
    if size is None:
        raise UsageError("the size of a subgroup is a number from 1 to 25")
    panel: Panel = request.app.state.panel
    line = await run_in_threadpool(_line, panel, asked)
    drawn = await run_in_threadpool(charts.draw, line, value, size, language.of_request(request))
    return render.page(
        *(request, "charts.html", session),
        asked=asked, value=value, size=size, values=VALUES, charts=drawn, count=len(line.attempts), days=DAYS,
    )  # fmt: skip


def warm(panel: Panel) -> None:
    """Counts the newest days before anybody asks: of a large log the first look costs most."""
    with suppress(StationError):
        _line(panel, {})


def _line(panel: Panel, asked: dict[str, str]) -> Line:
    query = query_of(asked)
    with panel.log() as log:
        newest = log.attempts(query, 1)
        if not newest or query.since_ns is not None or query.until_ns is not None:
            return gather(log, query, MOST)
        first_day = newest[0].started_ns // DAY_NS - DAYS + 1
        return gather(log, replace(query, since_ns=first_day * DAY_NS), MOST, panel.memory)


ROUTES = [Route("/charts", show, methods=["GET"])]
