"""The engineer's page: the line in charts."""

from contextlib import suppress
from dataclasses import replace

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from station.errors import StationError, UsageError
from station.reporting.line import charts
from station.reporting.line.statistics import VALUE_NAMES, LineStatistics
from station.service.line_statistics import gather_statistics
from station.web import language, render
from station.web.guard import parse_whole_number, require_right
from station.web.line_cache import DAY_NS
from station.web.panel import Panel
from station.web.query_form import query_of
from station.web.sessions import Session

#: The page looks at so many of the newest attempts, and over so many days where it is not told.
MOST_CHARTED, DEFAULT_DAYS = 200, 7
FILTER_FIELDS = ("since", "until", "station", "nest", "recipe_name", "lot")


@require_right("charts")
async def show(request: Request, session: Session) -> Response:
    """Charts of the attempts that the address asks for."""
    filters = {k: request.query_params.get(k, "") for k in FILTER_FIELDS}
    value, size = (
        request.query_params.get("value", VALUE_NAMES[0]),
        parse_whole_number(request.query_params.get("size", "1")),
    )
    if size is None:
        raise UsageError("subgroup-size")
    panel: Panel = request.app.state.panel
    line = await run_in_threadpool(_statistics, panel, filters)
    drawn = await run_in_threadpool(charts.draw, line, value, size, language.words(language.of_request(request)))
    return render.page(
        *(request, "charts.html", session),
        asked=filters, value=value, size=size, values=VALUE_NAMES, charts=drawn,
        count=len(line.attempts), days=DEFAULT_DAYS,
    )  # fmt: skip


def warm_cache(panel: Panel) -> None:
    """Counts the newest days before anybody asks: of a large log the first look costs most."""
    with suppress(StationError):
        _statistics(panel, {})


def _statistics(panel: Panel, filters: dict[str, str]) -> LineStatistics:
    query = query_of(filters)
    with panel.log() as log:
        newest = log.attempts(query, 1)
        if not newest or query.since_ns is not None or query.until_ns is not None:
            return gather_statistics(log, query, MOST_CHARTED)
        first_day = newest[0].started_ns // DAY_NS - DEFAULT_DAYS + 1
        return gather_statistics(log, replace(query, since_ns=first_day * DAY_NS), MOST_CHARTED, panel.memory)


ROUTES = [Route("/charts", show, methods=["GET"])]
