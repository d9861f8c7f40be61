"""The engineer's page: the line in charts."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from urllib.parse import urlencode

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from station.errors import StationError, UsageError
from station.reporting.drawing.drawing import Drawing
from station.reporting.line import charts
from station.reporting.line.process_view import Chosen, ProcessView, view_process
from station.reporting.line.statistics import VALUE_NAMES, LineStatistics
from station.service import time_text
from station.service.line_statistics import gather_statistics
from station.web import language, render
from station.web.guard import parse_whole_number, require_right
from station.web.line_cache import DAY_NS
from station.web.panel import Panel
from station.web.query_form import query_of, whole_number
from station.web.sessions import Session

#: The page looks at so many of the newest attempts, and over so many days where it is not told.
MOST_CHARTED, DEFAULT_DAYS = 200, 7
CHOICE_FIELDS = ("first", "last", "change")
FILTER_FIELDS = ("since", "until", "station", "nest", "recipe_name", "lot")


@require_right("charts")
async def show(request: Request, session: Session) -> Response:
    """Charts of the attempts that the address asks for."""
    filters = {k: request.query_params.get(k, "") for k in FILTER_FIELDS}
    value = request.query_params.get("value", VALUE_NAMES[0])
    size = parse_whole_number(request.query_params.get("size", "1"))
    if size is None:
        raise UsageError("subgroup-size")
    first, last, change = (whole_number(request.query_params.get(k, "")) or 0 for k in CHOICE_FIELDS)
    panel: Panel = request.app.state.panel
    words = language.words(language.of_request(request))
    line = await run_in_threadpool(_statistics, panel, filters)

    def draw() -> tuple[charts.Charts, ProcessView, Drawing | None]:
        drawn = charts.draw(line, value, size, words, overview=False)
        process = view_process(line, value, Chosen(first, last, change), _short_local, words)
        return drawn, process, charts.draw_pareto(line, words, partial(_audit_address, filters))

    drawn, process, pareto = await run_in_threadpool(draw)
    return render.page(
        *(request, "charts.html", session),
        filters=filters, value=value, size=size, values=VALUE_NAMES, charts=drawn, view=process, pareto=pareto,
        recipe=line.recipe, chosen={"first": first, "last": last, "change": change},
        count=len(line.attempts), days=DEFAULT_DAYS, audit=_audit_address(filters, "", process), zone=time_text.zone(),
    )  # fmt: skip


def _short_local(time_ns: int) -> str:
    """Day and minute, for an axis."""
    return time_text.local_short(time_ns)[5:16]


def _audit_address(filters: Mapping[str, str], check: str, process: ProcessView | None = None) -> str:
    """The audit page of the attempts that failed a check, or of those chosen in the chart."""
    fields = {k: v for k, v in filters.items() if v} | ({"check": check} if check else {})
    if process is not None and process.selected:
        times = [attempt.started_ns for _, attempt in process.selected]
        begin, end = (time_text.local_short(t).replace(" ", "T") for t in (min(times), max(times) + 1_000_000_000))
        fields |= {"since": begin, "until": end}
    return f"/audit?{urlencode(fields)}"


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
