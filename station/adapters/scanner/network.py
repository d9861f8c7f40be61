"""A code reader that speaks lines over TCP: it is triggered, and answers with what it read."""

import socket
import time
from typing import Annotated

from pydantic import Field

from station.adapters.scanner._lines import LineBuffer, trigger_bytes
from station.domain.recipe.fields import Positive, StrictModel
from station.errors import StationFault
from station.messages import system_reason


class NetworkScanner:
    """trigger: what makes it read, with `{nest}` for the nest's name; no_read: what it says when it reads nothing.

    line: {scanner: {kind: network, host: 192.168.0.20, port: 9004}}
    """

    class Settings(StrictModel):
        """host, port: of the reader; trigger, no_read as above; connect_s: longest for a connection."""

        host: Annotated[str, Field(max_length=253, pattern=r"^[\w.:\-]*$")] = "127.0.0.1"
        port: Annotated[int, Field(ge=1, le=65535)] = 9004
        trigger: Annotated[str, Field(max_length=64)] = "LON {nest}\\r"
        no_read: Annotated[str, Field(max_length=64)] = "ERROR"
        connect_s: Positive = 2.0

    def __init__(self, settings: "NetworkScanner.Settings") -> None:
        self._settings = settings
        self._socket: socket.socket | None = None

    def read(self, nest: str, timeout_s: float) -> str | None:
        """Triggers and waits for one line. What came before the trigger belongs to another unit and is thrown away."""
        try:
            connection = self._open()
            _drain(connection)
            connection.sendall(trigger_bytes(self._settings.trigger, nest))
            return self._answer(connection, time.monotonic() + timeout_s)
        except (OSError, UnicodeError) as exc:
            self.close()
            at = f"{self._settings.host}:{self._settings.port}"
            raise StationFault("scanner-lost", scanner=at, reason=system_reason(exc)) from exc

    def close(self) -> None:
        """Ends the connection."""
        connection, self._socket = self._socket, None
        if connection is not None:
            connection.close()

    def _open(self) -> socket.socket:
        if self._socket is None:
            self._socket = socket.create_connection(
                (self._settings.host, self._settings.port), self._settings.connect_s
            )
        return self._socket

    def _answer(self, connection: socket.socket, until_s: float) -> str | None:
        lines = LineBuffer()
        while (rest_s := until_s - time.monotonic()) > 0:
            connection.settimeout(rest_s)
            try:
                data = connection.recv(4096)
            except TimeoutError:
                break
            if not data:
                raise ConnectionResetError("the reader closed the connection")
            if (text := lines.take(data)) is not None:
                return None if text == self._settings.no_read else text
        self.close()  # an answer that comes late must not be taken for the next unit's
        return None


def _drain(connection: socket.socket) -> None:
    connection.settimeout(0)
    try:
        while connection.recv(4096):
            pass
    except BlockingIOError:
        return
    raise ConnectionResetError("the reader closed the connection")
