"""The plant over HTTP: stations bring their records, a monitor asks how it goes, and heads are witnessed."""

import asyncio
import hashlib
import hmac
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from prometheus_client import CollectorRegistry, Gauge
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route

from station.domain.records.wire import decode
from station.messages import Message, render
from station.ports.clock import Clock
from station.ports.plant import Claim, PlantStore
from station.service.receiver import PlantReceiver, RegisteredStation, Standing
from station.service.witness import Witness
from station.web.connections import GuardedConnection, allow_connections
from station.web.witness import ERRORS, create_witness_app

#: Seals that one question may ask for.
_MOST_SEALS = 1000


@dataclass(frozen=True, slots=True)
class Entrances:
    """By what a station is known: the SHA-256 of its token in hex, or the common name of its certificate."""

    tokens: Mapping[str, RegisteredStation]
    certificates: Mapping[str, RegisteredStation]

    def station_of(self, request: Request) -> RegisteredStation | None:
        """The station that asks; None for a stranger."""
        scheme, _, token = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and token:
            digest = hashlib.sha256(token.strip().encode()).hexdigest()
            found = [s for known, s in self.tokens.items() if hmac.compare_digest(known, digest)]
            return found[0] if found else None
        return self.certificates.get(str(getattr(request.state, "certificate", "")))


@dataclass(frozen=True, slots=True)
class PlantFace:
    """What the application stands on. witness: None where the plant has no key; most_bytes: of one portion; turns: a
    station has one request served at a time, so that one whose log is held up keeps no thread from the others."""

    receiver: PlantReceiver
    store: PlantStore
    entrances: Entrances
    clock: Clock
    witness: Witness | None
    most_bytes: int
    turns: Mapping[str, asyncio.Lock] = field(default_factory=lambda: defaultdict(asyncio.Lock))


def create_plant_app(face: PlantFace, further: Sequence[BaseRoute] = ()) -> Starlette:
    """The application of a plant."""
    routes: list[BaseRoute] = [
        Route("/logs/{log_id}", _for_stations(face, _standing)),
        Route("/logs/{log_id}/seals", _for_stations(face, _seals)),
        Route("/logs/{log_id}/records", _for_stations(face, _records), methods=["POST"]),
        Route("/health", _health),
        Route("/metrics", _metrics),
        *further,
    ]
    if face.witness is not None:
        routes.append(Mount("/", create_witness_app(face.witness)))
    app = Starlette(routes=routes, exception_handlers=ERRORS)
    app.state.face = face
    return app


class CertifiedConnection(GuardedConnection):
    """A connection that tells the application whose certificate it was opened with. Its deadline begins anew with each
    part of a portion: a slow line brings a whole one late. A stranger is refused before any part."""

    def data_received(self, data: bytes) -> None:
        """Takes bytes in."""
        if (cycle := vars(self)["cycle"]) is not None and cycle.more_body:
            self._forget_deadline()
        super().data_received(data)

    def connection_made(self, transport: Any) -> None:
        """Notes the common name of the client's certificate, which the handshake has checked."""
        super().connection_made(transport)
        tls = transport.get_extra_info("ssl_object")
        certificate = tls.getpeercert() if tls is not None else None
        subject = [pair for part in (certificate or {}).get("subject", ()) for pair in part]
        name = dict(subject).get("commonName", "")
        self.app_state = {**self.app_state, "certificate": name}


def connection_options() -> dict[str, Any]:
    """What uvicorn is told of connections; this process may hold many from now on."""
    allow_connections()
    return {"http": CertifiedConnection, "timeout_keep_alive": 75}


_Handler = Callable[[PlantFace, RegisteredStation, Request], Any]


def _for_stations(face: PlantFace, handler: _Handler) -> Callable[[Request], Any]:
    async def handle(request: Request) -> Response:
        station = face.entrances.station_of(request)
        if station is None:
            return _refused(401, Message("plant-unknown-station"))
        if not (_log_id(request).isascii() and _log_id(request).isprintable()):
            return _refused(400, Message("plant-no-portion"))
        async with face.turns[station.name]:
            answer: Response = await handler(face, station, request)
        return answer

    return handle


async def _standing(face: PlantFace, station: RegisteredStation, request: Request) -> Response:
    return _answer(await run_in_threadpool(face.receiver.standing, station, _log_id(request)))


async def _seals(face: PlantFace, station: RegisteredStation, request: Request) -> Response:
    first, last = (_number(request.query_params.get(name, "")) for name in ("first", "last"))
    if not 0 < first <= last < first + _MOST_SEALS:
        return _refused(400, Message("plant-no-portion"))
    seals = await run_in_threadpool(face.receiver.seals, station, _log_id(request), first, last)
    return JSONResponse({"seals": [seal.hex() for seal in seals]})


async def _records(face: PlantFace, station: RegisteredStation, request: Request) -> Response:
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > face.most_bytes:
            return _refused(413, Message("plant-portion-too-large", most=face.most_bytes))
    claim = Claim(_number(request.headers.get("x-log-newest", "")), request.headers.get("x-log-seal", "")[:64])
    return await run_in_threadpool(_receive, face, station, _log_id(request), bytes(data), claim)


def _receive(face: PlantFace, station: RegisteredStation, log_id: str, data: bytes, claim: Claim) -> Response:
    try:
        records = decode(data)
    except ValueError:
        return _refused(400, Message("plant-no-portion"))
    return _answer(face.receiver.receive(station, log_id, records, claim))


def _answer(standing: Standing) -> Response:
    refusal = standing.refusal
    refused = refusal and {
        "reason": refusal.reason,
        "number": refusal.number,
        "message": refusal.message.document(),
        "sentence": render(refusal.message),
    }
    return JSONResponse({"number": standing.number, "seal": standing.seal.hex(), "refused": refused})


def _refused(status: int, message: Message) -> Response:
    """To whom nothing is known of: the same form, so that the station shows it as what is parked."""
    refused = {"reason": message.id, "number": 0, "message": message.document(), "sentence": render(message)}
    return JSONResponse({"number": 0, "seal": "", "refused": refused}, status)


async def _health(request: Request) -> Response:
    await run_in_threadpool(request.app.state.face.store.standings)
    return JSONResponse({"status": "ok"})


async def _metrics(request: Request) -> Response:
    text = await run_in_threadpool(lambda: generate_latest(gather(request.app.state.face)))
    return Response(text, media_type=CONTENT_TYPE_LATEST)


def gather(face: PlantFace) -> CollectorRegistry:
    """Figures of every station's log at the plant."""
    registry = CollectorRegistry()
    gauges = {
        name: Gauge(f"plant_{name}", meaning, ["station"], registry=registry)
        for name, meaning in (
            ("records", "records of the station's log that the plant has"),
            ("records_behind", "records that the station has told of and not yet sent"),
            ("silent_seconds", "since records came last"),
            ("quarantined", "records set apart that nobody has decided about"),
        )
    }
    now_ns = face.clock.epoch_ns()
    for s in face.store.standings():
        gauges["records"].labels(s.station).set(s.number)
        gauges["records_behind"].labels(s.station).set(max(s.newest - s.number, 0))
        gauges["silent_seconds"].labels(s.station).set((now_ns - s.last_ns) / 1e9)
        gauges["quarantined"].labels(s.station).set(s.open_quarantine)
    return registry


def _log_id(request: Request) -> str:
    return str(request.path_params["log_id"])[:64]


def _number(text: str) -> int:
    return int(text) if text.isascii() and text.isdigit() and len(text) < 19 else 0
