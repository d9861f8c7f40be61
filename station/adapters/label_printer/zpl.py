"""A label printer that speaks ZPL II over TCP."""

import socket
from typing import Annotated

from pydantic import Field

from station.domain.cell.label import zpl
from station.domain.recipe.fields import Positive, StrictModel
from station.errors import StationFault
from station.messages import system_reason
from station.ports.cell import UnitLabel

#: Fields of the first two strings of `~HS` that are 1 when a person is wanted (ZPL II Programming Guide, ~HS).
_PAPER_OUT, _PAUSED, _HEAD_UP, _RIBBON_OUT = (0, 1), (0, 2), (1, 2), (1, 3)
_WANTS = {
    _PAPER_OUT: "printer-paper",
    _PAUSED: "printer-paused",
    _HEAD_UP: "printer-head",
    _RIBBON_OUT: "printer-ribbon",
}


class ZplPrinter:
    """Asks the printer how it is before every label: one that is out of paper takes labels and prints none.

    line: {printer: {kind: zpl, host: 192.168.0.30}}
    """

    class Settings(StrictModel):
        """host, port: of the printer; status: whether it answers `~HS`; timeout_s: longest for an answer."""

        host: Annotated[str, Field(max_length=253, pattern=r"^[\w.:\-]*$")] = "127.0.0.1"
        port: Annotated[int, Field(ge=1, le=65535)] = 9100
        status: bool = True
        timeout_s: Positive = 2.0

    def __init__(self, settings: "ZplPrinter.Settings") -> None:
        self._settings = settings

    def print(self, label: UnitLabel) -> None:
        """Prints one. Errors: StationFault with what the printer wants."""
        given = self._settings
        try:
            with socket.create_connection((given.host, given.port), given.timeout_s) as connection:
                if given.status:
                    self._check(connection)
                connection.sendall(zpl(label.serial, label.outcome, label.record, label.nest))
        except (OSError, UnicodeError) as exc:
            at = f"{given.host}:{given.port}"
            raise StationFault("printer-lost", printer=at, reason=system_reason(exc)) from exc

    def _check(self, connection: socket.socket) -> None:
        connection.sendall(b"~HS")
        data = b""
        while data.count(b"\x03") < 2 and len(data) < 4096:
            part = connection.recv(1024)
            if not part:
                break
            data += part
        strings = [part.partition(b"\x02")[2].split(b",") for part in data.split(b"\x03")[:2]]
        for (string, field), id_ in _WANTS.items():
            if len(strings) > string and len(strings[string]) > field and strings[string][field].strip() == b"1":
                raise StationFault(id_)
