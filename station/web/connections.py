"""Connections of page, plant and witness: who only holds one open, feeds or drains it drop by drop keeps nobody out.

A connection must bring a whole request, head and body, within REQUEST_S at most, and must take what it is sent within
DRAIN_S. Those that came at the same instant are closed one after the other, from SOONEST of that time on: else all
come back at once, and whoever presses Stop waits behind them. There may be many: one that idles costs some kilobytes,
and who opens them anew as fast as they are closed would always push the newest out. Beyond MOST_CONNECTIONS, or
MOST_PER_ADDRESS from one address, those that have idled longest are closed for a newcomer, ROOM_MADE at once, if they
had GRACE_S; one whose request is being answered never is, unless it is a log-in.
"""

import asyncio
import gc
import resource
from collections.abc import Awaitable, Callable, Iterable, Mapping
from heapq import nsmallest
from itertools import count
from typing import Any

import h11
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from uvicorn.protocols.http.h11_impl import H11Protocol

ErrorHandlers = Mapping[type[Exception], Callable[[Request, Exception], Awaitable[Response]]]

MOST_CONNECTIONS, MOST_PER_ADDRESS = 4000, 2500
REQUEST_S, DRAIN_S, GRACE_S, SOONEST = 10.0, 20.0, 2.0, 0.5
#: So many are let in before those within get their turn again; so many may wait at the door meanwhile.
LET_IN_AT_ONCE, MOST_WAITING = 32, 4096
ROOM_MADE = 64
#: Handles for the log, the threads and the children, beside those of connections.
_OTHER_HANDLES = 256


def allow_connections() -> None:
    """Lets this process hold that many open, and has the garbage collector pass over what is there for good: it runs
    often where connections come and go by the thousand, and nothing is answered meanwhile."""
    gc.freeze()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_CONNECTIONS + _OTHER_HANDLES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


async def _gone(_: Request, exc: Exception) -> Response:  # noqa: ARG001 - of starlette's form
    """Nobody hears it."""
    return Response(status_code=400)


#: What an application answers to a connection that ended within a body.
GONE: ErrorHandlers = {ClientDisconnect: _gone}


def patience_s(number: int) -> float:
    """How long a connection has for a request: any hundred that follow each other are spread evenly, whatever their
    numbers begin with (multiples of the golden section)."""
    return REQUEST_S * (SOONEST + (1 - SOONEST) * (number * (5**0.5 - 1) / 2 % 1))


class GuardedConnection(H11Protocol):
    """One connection with its deadlines."""

    _numbers = count()

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._patience_s = patience_s(next(self._numbers))
        self._deadline: asyncio.TimerHandle | None = None
        self._drain: asyncio.TimerHandle | None = None
        self.waiting_since_s = self.loop.time()

    @property
    def answering(self) -> bool:
        """Whether a whole request has come and its answer is under way."""
        cycle = vars(self)["cycle"]  # None before the first request, whatever uvicorn's annotation says
        return cycle is not None and not cycle.more_body and not cycle.response_complete

    @property
    def dispensable(self) -> bool:
        """Whether it may be closed for another: it idles, or somebody unknown tries to log in."""
        return not self.transport.is_closing() and not (self.answering and self.scope["path"] != "/login")

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Makes room for the newcomer, or turns it away where everybody else is being served."""
        super().connection_made(transport)
        if len(self.connections) > MOST_PER_ADDRESS:
            self._make_room()
        self._expect_request()

    def data_received(self, data: bytes) -> None:
        """Takes bytes in; the deadline stands until the request is whole."""
        super().data_received(data)
        if self.answering:
            self._forget_deadline()
        elif self._deadline is None and not self.transport.is_closing():
            self._expect_request()

    def send_400_response(self, msg: str) -> None:
        """What came is no HTTP: said so unless an answer has begun; the application takes its client for gone."""
        if (cycle := vars(self)["cycle"]) is not None:
            cycle.disconnected = True
            cycle.message_event.set()
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            super().send_400_response(msg)
        else:
            self.transport.close()

    def on_response_complete(self) -> None:
        """The next request has its own deadline; uvicorn's keep-alive is shorter while nothing comes."""
        self.waiting_since_s = self.loop.time()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """The client takes nothing more: it has DRAIN_S."""
        super().pause_writing()
        self._forget_drain()
        self._drain = self.loop.call_later(DRAIN_S, self.transport.abort)

    def resume_writing(self) -> None:
        """It takes again."""
        self._forget_drain()
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """No deadline outlives its connection."""
        self._forget_deadline()
        self._forget_drain()
        super().connection_lost(exc)

    def _make_room(self) -> None:
        others = [c for c in self.connections if isinstance(c, GuardedConnection) and c is not self]
        crowded = len(others) >= MOST_CONNECTIONS
        host = self.client[0] if self.client else None
        rivals = others if crowded else [c for c in others if c.client and c.client[0] == host]
        if crowded or len(rivals) >= MOST_PER_ADDRESS:
            idle = _longest_idle(rivals, self.loop.time() - GRACE_S)
            for connection in idle or [self]:
                connection.transport.abort()

    def _expect_request(self) -> None:
        self._deadline = self.loop.call_later(self._patience_s, self.transport.abort)

    def _forget_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _forget_drain(self) -> None:
        if self._drain is not None:
            self._drain.cancel()
            self._drain = None


def _longest_idle(connections: Iterable[GuardedConnection], before_s: float) -> list[GuardedConnection]:
    """The dispensable ones that have waited longest, since before that instant, log-ins last; as many as make room for
    some time, for looking through thousands costs milliseconds."""
    idle = (c for c in connections if c.dispensable and c.waiting_since_s < before_s)
    return nsmallest(ROOM_MADE, idle, key=lambda c: (c.answering, c.waiting_since_s))
