"""Servers of asyncio and of uvicorn for a test, and ports for them."""

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import uvicorn
from starlette.applications import Starlette


@contextmanager
def served(serve: Callable[[Callable[[int], None]], Any]) -> Iterator[int]:
    """A server of asyncio in a thread of its own; its port."""
    listening, ports, loops = threading.Event(), list[int](), list[asyncio.AbstractEventLoop]()
    tasks: list[asyncio.Task[None]] = []

    def ready(port: int) -> None:
        ports.append(port)
        listening.set()

    async def run() -> None:
        loops.append(asyncio.get_running_loop())
        tasks.append(asyncio.create_task(serve(ready)))
        with suppress(asyncio.CancelledError):
            await tasks[0]

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    try:
        assert listening.wait(60), "the server does not listen"
        yield ports[0]
    finally:
        loops[0].call_soon_threadsafe(tasks[0].cancel)
        thread.join()


@contextmanager
def app_served(app: Starlette, **options: Any) -> Iterator[int]:
    """An application as its command serves it, in a thread of its own; its port."""
    server = uvicorn.Server(uvicorn.Config(app, log_config=None, access_log=False, ws="none", **options))
    with socket.create_server(("127.0.0.1", 0)) as door:
        thread = threading.Thread(target=server.run, args=([door],))
        thread.start()
        try:
            yield door.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join()


def free_port() -> int:
    """One that nobody listens on now."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])
