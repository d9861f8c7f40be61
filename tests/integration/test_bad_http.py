"""What is no HTTP, and who leaves within a request: one line at most of page, plant and witness, never a traceback."""

import logging
import socket
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from station.config.settings import Nest, Settings
from station.errors import StoreFault
from station.service.witness import Witness
from station.web.app import create_app
from station.web.connections import GuardedConnection
from station.web.panel import Panel
from station.web.plant import Entrances, PlantFace, connection_options, create_plant_app
from station.web.run_launcher import LaunchOptions
from station.web.witness import create_witness_app
from station.wiring.jobs import load_job
from tests.fakes.serving import app_served

HEAD = b" HTTP/1.1\r\nHost: 127.0.0.1\r\n"
CHUNKED = HEAD + b"Transfer-Encoding: chunked\r\n\r\n"
TOKEN = b"Authorization: Bearer token\r\nTransfer-Encoding: chunked\r\n\r\n"
#: Parts of requests, each sent once its answer so far has come or the server has rested.
BAD = {
    "a bad chunk behind the answer": (b"GET /" + CHUNKED, b"zz\r\n"),
    "a bad chunk at once": (b"GET /" + CHUNKED + b"zz\r\n",),
    "a bad chunk within a body": (b"POST /heads" + CHUNKED + b"5\r\nhello\r\n", b"zz\r\n"),
    "a bad chunk within a portion": (b"POST /logs/a/records" + HEAD + TOKEN + b"5\r\nhello\r\n", b"zz\r\n"),
    "a stranger's bad chunk": (b"POST /logs/a/records" + CHUNKED, b"5\r\nhello\r\nzz\r\n"),
    "another request that is none": (b"POST /nowhere" + HEAD + b"Content-Length: 3\r\n\r\na=1\0\0\r\n\r\n",),
    "a body cut off": (b"POST /login" + HEAD + b"Content-Length: 50\r\n\r\nname=a", None),
    "a body of the witness cut off": (b"POST /heads" + HEAD + b"Content-Length: 50\r\n\r\n{", None),
    "a portion cut off": (b"POST /logs/a/records" + HEAD + TOKEN + b"5\r\nhel", None),
}


def witness_app(_: Path) -> Starlette:
    heads: Any = SimpleNamespace(of_station=lambda _: None)
    clock: Any = None
    return create_witness_app(Witness(heads, clock, bytes, lambda *_: True, {}))


def plant_app(_: Path) -> Starlette:
    nothing: Any = None
    station: Any = SimpleNamespace(name="bench-1")
    known = Entrances({"3c469e9d6c5875d37a43f353d4f88e61fcf812c66eee3457465a40b0da4153e0": station}, {})
    return create_plant_app(PlantFace(nothing, nothing, known, nothing, nothing, 1000))


def page_app(folder: Path) -> Starlette:
    settings = Settings.model_validate(
        {"schema": "station.config/1", "station": "b", "nests": [Nest(name="A", node=1)]}
    )
    options = LaunchOptions(folder / "s.db", "six-point", None, simulate=True)
    return create_app(Panel(settings, load_job("six-point")[0].recipe, options, folder / "accounts.json"))


def bring(port: int, parts: tuple[bytes | None, ...]) -> None:
    """None: the client leaves. Otherwise it stays until the server ends the connection."""
    with socket.create_connection(("127.0.0.1", port), timeout=20) as link:
        for part in parts:
            if part is None:
                return
            link.sendall(part)
            link.settimeout(0.05)
            try:
                while link.recv(65536):
                    pass
            except TimeoutError:
                link.settimeout(20)
        while link.recv(65536):
            pass


@pytest.mark.parametrize("make", [page_app, plant_app, witness_app])
def test_it_is_one_line(make: Callable[[Path], Starlette], tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    options = connection_options() if make is plant_app else {"http": GuardedConnection}
    with caplog.at_level(logging.WARNING), app_served(make(tmp_path), **options) as port:
        for what, parts in BAD.items():
            caplog.clear()
            bring(port, parts)
            bring(port, (b"GET /" + HEAD + b"Connection: close\r\n\r\n",))  # what came before is dealt with
            assert [r.message for r in caplog.records] in ([], ["Invalid HTTP request received."]), what
            assert not any(r.exc_info for r in caplog.records), what


def test_a_witness_that_cannot_keep_a_head_says_why() -> None:
    def full(*_: object) -> None:
        raise StoreFault("witness-file", path="heads.jsonl", reason="no space left")

    heads: Any = SimpleNamespace(of_station=full)
    clock: Any = None
    app = create_witness_app(Witness(heads, clock, bytes, lambda *_: True, {}))
    answer = TestClient(app).get("/heads/bench-1")
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "5")
