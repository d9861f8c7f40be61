"""A code reader on a serial port (pyserial)."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from station.adapters.scanner._lines import LineBuffer, trigger_bytes
from station.domain.recipe.fields import StrictModel
from station.errors import ConfigError, StationFault
from station.messages import system_reason

if TYPE_CHECKING:
    from serial import Serial


class SerialPortScanner:
    """trigger: what makes it read, '' for a reader that reads by itself; no_read: what it says when it reads nothing.

    line: {scanner: {kind: serial-port, port: /dev/ttyACM0}}
    """

    class Settings(StrictModel):
        """port, baud: of the serial line; trigger, no_read as above."""

        port: Annotated[str, Field(max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")] = "/dev/ttyACM0"
        baud: Annotated[int, Field(ge=1200, le=921600)] = 115200
        trigger: Annotated[str, Field(max_length=64)] = "T\\r"
        no_read: Annotated[str, Field(max_length=64)] = "NOREAD"

    def __init__(self, settings: SerialPortScanner.Settings) -> None:
        self._settings = settings
        self._port: Serial | None = None

    def read(self, nest: str, timeout_s: float) -> str | None:
        """Triggers and waits for one line; what stood in the buffer before is thrown away."""
        try:
            port = self._open()
            port.reset_input_buffer()
            port.write(trigger_bytes(self._settings.trigger, nest))
            return self._answer(port, time.monotonic() + timeout_s)
        except OSError as exc:  # SerialException is one
            self.close()
            why = system_reason(exc)
            raise StationFault("scanner-port", port=self._settings.port, why=why) from exc

    def close(self) -> None:
        """Lets go of the port."""
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def _open(self) -> Serial:
        if self._port is None:
            try:
                from serial import Serial
            except ImportError:
                raise ConfigError("extra-missing", package="pyserial", extra="line") from None
            self._port = Serial(self._settings.port, self._settings.baud, timeout=0.05, write_timeout=1.0)
        return self._port

    def _answer(self, port: Serial, until_s: float) -> str | None:
        lines = LineBuffer()
        while time.monotonic() < until_s:
            if (text := lines.take(port.read(256))) is not None:
                return None if text == self._settings.no_read else text
        return None
