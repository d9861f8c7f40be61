"""Registers of a device over Modbus TCP (pymodbus)."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from station.errors import ConfigError, PlcFault
from station.messages import Message
from station.ports.registers import Table

if TYPE_CHECKING:
    from pymodbus.client import ModbusTcpClient


class ModbusRegisters:
    """Implements `ports.registers.Registers`. Opens its connection at the first request.

    pymodbus repeats a request three times where it is not told otherwise: a PLC that answers late then does three
    times what was wanted once. Here every request goes out once; what a lost answer means is for the caller to read.
    """

    def __init__(self, host: str, port: int, device: int, timeout_s: float) -> None:
        self._host, self._port, self._device, self._timeout_s = host, port, device, timeout_s
        self._client: ModbusTcpClient | None = None

    def read(self, table: Table, address: int, count: int) -> list[int]:
        """`count` registers from `address` on."""
        client = self._open()
        call = client.read_holding_registers if table == "holding" else client.read_input_registers
        found = list(self._request(call, address, count=count).registers)
        if len(found) != count:
            raise self._lost(Message("plc-answer-short", count=len(found), wanted=count))
        return found

    def write(self, address: int, words: list[int]) -> None:
        """Writes holding registers (FC 16)."""
        self._request(self._open().write_registers, address, values=words)

    def close(self) -> None:
        """Ends the connection."""
        client, self._client = self._client, None
        if client is not None:
            client.close()  # type: ignore[no-untyped-call]

    def _open(self) -> ModbusTcpClient:
        if self._client is None:
            client = _client(self._host, self._port, self._timeout_s)
            if not _reached(client):
                client.close()  # type: ignore[no-untyped-call]
                raise PlcFault("plc-not-reached", host=self._host, port=self._port)
            self._client = client
        return self._client

    def _request(self, call: Any, address: int, **values: Any) -> Any:
        from pymodbus.exceptions import ModbusException

        try:
            answer = call(address, device_id=self._device, **values)
        except (ModbusException, OSError) as exc:
            why = " ".join(str(exc).split())
            raise self._lost(Message("plc-no-answer", timeout_s=self._timeout_s, why=why[:120])) from exc
        if answer.isError():
            code = getattr(answer, "exception_code", 0)
            raise PlcFault("plc-exception", host=self._host, port=self._port, code=code, address=address)
        return answer

    def _lost(self, why: Message) -> PlcFault:
        """An answer that comes late must not be taken for the next one's: the connection ends here."""
        self.close()
        return PlcFault("plc-lost", host=self._host, port=self._port, reason=why)


def _reached(client: ModbusTcpClient) -> bool:
    """Whether it connects; nowhere by a host's name that can be none, such as one with an empty part."""
    try:
        return bool(client.connect())  # type: ignore[no-untyped-call]
    except UnicodeError:
        return False


def _client(host: str, port: int, timeout_s: float) -> ModbusTcpClient:
    try:
        from pymodbus.client import ModbusTcpClient
    except ImportError:
        raise ConfigError("extra-missing", package="pymodbus", extra="line") from None
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # its errors come back as exceptions
    return ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0)
