"""For machines: figures for Prometheus, and whether the page and its log are well."""

import time
from collections.abc import Mapping
from functools import partial
from typing import Any

from prometheus_client import CollectorRegistry, Gauge
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from station.errors import StationError
from station.messages import Message
from station.ports.log_reader import LogReader
from station.service.golden_register import standings
from station.service.shipping import ShippingState
from station.web.guard import RequestRefusal, session_of
from station.web.panel import Panel
from station.wiring.logs import find_log
from station.wiring.shipping import read_statuses

#: States of a controller, as station.ports.bus names them.
STATES = ("active", "warning", "passive", "bus-off", "down", "unknown")
#: Stops and units that the figures of the present look back over.
RECENT_VISITS, RECENT_UNITS = 200, 50


async def metrics(request: Request) -> Response:
    """Text for Prometheus: for this machine, and for people who have logged in."""
    local = request.client is not None and request.client.host in ("127.0.0.1", "::1")
    if not local and session_of(request) is None:
        raise RequestRefusal(401, Message("metrics-not-for-you"))
    text = await run_in_threadpool(lambda: generate_latest(gather(request.app.state.panel)))
    return Response(text, media_type=CONTENT_TYPE_LATEST)


async def health(request: Request) -> Response:
    """200 while the log can be read or does not exist yet; 503 otherwise. Tells nothing else."""
    panel: Panel = request.app.state.panel
    try:
        if panel.order.database.exists():
            await run_in_threadpool(_readable, panel)
    except StationError:
        return JSONResponse({"status": "the log cannot be read"}, 503)
    return JSONResponse({"status": "ok"})


def gather(panel: Panel) -> CollectorRegistry:
    """All figures, from the log as it stands."""
    registry = CollectorRegistry()
    shown = panel.screen.shown()
    _gauge(registry, "station_run_active", "1 while a run is under way").set(bool(shown["running"]))
    _gauge(registry, "station_queue_units", "units scanned and waiting for the start").set(len(panel.queue.serials()))
    _gauge(registry, "station_units_in_work", "units of the present load without a verdict").set(
        sum(1 for k, v in shown.items() if shown["running"] and k.startswith("nest ") and not v.get("outcome", "-"))
    )
    _bus(registry, shown["bus"])
    _golden(registry, panel)
    _shipping(registry, panel)
    if panel.order.database.exists():
        with panel.log() as log:
            _of_log(registry, log)
        size = panel.order.database.stat().st_size
        _gauge(registry, "station_log_bytes", "size of the log").set(size)
    return registry


def _of_log(registry: CollectorRegistry, log: LogReader) -> None:
    figures = log.recent(RECENT_UNITS, RECENT_VISITS)
    units = Gauge("station_attempts", "finished attempts in the log", ["outcome"], registry=registry)
    for outcome, count in figures.outcomes.items():
        units.labels(outcome).set(count)
    if figures.cycle_s is not None and figures.last_pass_s is not None:
        _gauge(
            registry, "station_cycle_seconds", f"mean cycle time of the newest {RECENT_UNITS} units that passed"
        ).set(figures.cycle_s)
        _gauge(registry, "station_last_pass_timestamp_seconds", "when a unit passed last").set(figures.last_pass_s)
    recent = f"in the newest {RECENT_VISITS} stops"
    for name, meaning, count in (
        ("station_recent_stops", "stops that the recent figures look at", figures.visits),
        ("station_recent_kernel_drops", f"frames that the kernel dropped {recent}", figures.kernel_drops),
        ("station_recent_frames_lost", f"frames missing by their counters {recent}", figures.lost),
        ("station_recent_crc_errors", f"frames with a wrong CRC {recent}", figures.crc_errors),
        ("station_recent_bus_error_stops", f"stops with error frames of the bus {recent}", figures.bus_error_visits),
        ("station_recent_rejected_stops", f"stops measured again or given up {recent}", figures.rejected),
    ):
        _gauge(registry, name, meaning).set(count)


def _bus(registry: CollectorRegistry, bus: Mapping[str, Any]) -> None:
    """State and error counters of the controller, as far as the adapter tells them."""
    if not bus:
        return
    state = Gauge("station_bus_state", "1 for the state the controller is in", ["bus", "state"], registry=registry)
    for known in STATES:
        state.labels(bus["name"], known).set(bus["state"] == known)
    if bus["counters"]:
        counters = Gauge("station_bus_errors", "error counters of the controller", ["bus", "way"], registry=registry)
        for way, count in bus["counters"].items():
            counters.labels(bus["name"], way).set(count)


def _golden(registry: CollectorRegistry, panel: Panel) -> None:
    found = standings(panel.settings, partial(find_log, panel.order.database))
    age = Gauge("station_golden_age_seconds", "since the unit's last run", ["serial", "kind"], registry=registry)
    bad = Gauge("station_golden_problem", "1 while the check is due or failed", ["serial", "kind"], registry=registry)
    for s in found:
        bad.labels(s.serial, s.kind).set(bool(s.problem))
        if s.age_s is not None:
            age.labels(s.serial, s.kind).set(s.age_s)


def _shipping(registry: CollectorRegistry, panel: Panel) -> None:
    """How far each plant has the log; an age of 0 where nothing is held up."""
    found = read_statuses(panel.order.database) if panel.settings.receivers else []
    gauges = {
        name: Gauge(f"station_shipping_{name}", meaning, ["plant"], registry=registry)
        for name, meaning in (
            ("behind_records", "records of the log that the plant has not yet"),
            ("parked", "1 while the plant refuses a record"),
            ("away", "1 while the plant cannot be reached"),
            ("held_seconds", "for how long it has refused a record or been away"),
            ("last_sent_timestamp_seconds", "when it took records last"),
        )
    }
    for s in found:
        gauges["behind_records"].labels(s.receiver).set(max(s.newest - s.number, 0))
        gauges["parked"].labels(s.receiver).set(s.state == ShippingState.PARKED)
        gauges["away"].labels(s.receiver).set(s.state == ShippingState.AWAY)
        gauges["held_seconds"].labels(s.receiver).set(time.time() - s.since_ns / 1e9 if s.since_ns else 0)
        gauges["last_sent_timestamp_seconds"].labels(s.receiver).set(s.sent_ns / 1e9)


def _gauge(registry: CollectorRegistry, name: str, description: str) -> Gauge:
    return Gauge(name, description, registry=registry)


def _readable(panel: Panel) -> tuple[Any, float]:
    with panel.log() as log:
        return log.head(), time.time()


ROUTES = [Route("/metrics", metrics, methods=["GET"]), Route("/health", health, methods=["GET"])]
