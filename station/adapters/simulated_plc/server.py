"""A simulated PLC on a real socket: Modbus TCP with its own few lines, so that a client is not tested against itself.

MODBUS Messaging on TCP/IP V1.0b: MBAP header, then FC 3, 4, 6 and 16.
"""

import asyncio
import struct
import time
from collections.abc import Callable
from contextlib import suppress

from station.adapters.simulated_plc.memory import RegisterDevice

_HEADER = struct.Struct(">HHHB")
_READ, _WRITE_ONE, _WRITE_MANY = (3, 4), 6, 16
_ILLEGAL_FUNCTION, _ILLEGAL_VALUE, _DEVICE_FAILURE = 1, 3, 4
#: Its program runs so often, s.
SCAN_S = 0.01


class PlcServer:
    """Serves one PLC or remote I/O until it is stopped. on_scan: called after each scan with the present instant."""

    def __init__(self, plc: RegisterDevice, on_scan: Callable[[float], None] = lambda _: None) -> None:
        self._plc, self._on_scan = plc, on_scan
        self._dropped = False
        self._open: set[asyncio.StreamWriter] = set()
        self.port = 0

    async def serve(self, host: str, port: int, ready: Callable[[int], None] = lambda _: None) -> None:
        """Listens for ever; port 0: any. ready: called with the port."""
        server = await asyncio.start_server(self._connection, host, port)
        self.port = server.sockets[0].getsockname()[1]
        ready(self.port)
        async with server:
            while True:
                now_s = time.monotonic()
                self._plc.scan(now_s)
                self._on_scan(now_s)
                if self._plc.wire_fault(now_s) == "killed":
                    server.close()
                    for writer in tuple(self._open):
                        writer.transport.abort()
                await asyncio.sleep(SCAN_S)

    async def _connection(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open.add(writer)
        try:
            with suppress(asyncio.IncompleteReadError, ConnectionError):
                while True:
                    number, _, length, device = _HEADER.unpack(await reader.readexactly(_HEADER.size))
                    request = await reader.readexactly(length - 1)
                    if not await self._reply(writer, number, device, request):
                        return
        finally:
            self._open.discard(writer)
            writer.close()

    async def _reply(self, writer: asyncio.StreamWriter, number: int, device: int, request: bytes) -> bool:
        """Answers one request as the wire's fault lets it; False: the connection ends here."""
        kind = self._plc.wire_fault(time.monotonic())
        if kind in ("killed", "dropped") and not (kind == "dropped" and self._dropped):
            self._dropped = True
            return False
        if kind == "silent":
            return True
        refusal = bytes([request[0] | 0x80, _DEVICE_FAILURE])
        answer = refusal if kind == "exception" else self._answer(request)
        await asyncio.sleep({"late": 1.0, "slow": 0.05}.get(self._plc.wire_fault(time.monotonic()), 0.0))
        if kind == "garbage":
            answer, number = b"\x2a" * 3, number ^ 0x5555
        writer.write(_HEADER.pack(number, 0, len(answer) + 1, device) + answer)
        await writer.drain()
        return True

    def _answer(self, request: bytes) -> bytes:
        code, now_s = request[0], time.monotonic()
        try:
            if code in _READ:
                address, count = struct.unpack(">HH", request[1:])
                words = self._plc.read(address, count, now_s)
                return struct.pack(f">BB{count}H", code, 2 * count, *words)
            if code == _WRITE_MANY:
                address, count, _ = struct.unpack(">HHB", request[1:6])
                self._plc.write(address, struct.unpack(f">{count}H", request[6:]), now_s)
                return struct.pack(">BHH", code, address, count)
            if code == _WRITE_ONE:
                address, word = struct.unpack(">HH", request[1:])
                self._plc.write(address, (word,), now_s)
                return request
        except struct.error:
            return bytes([code | 0x80, _ILLEGAL_VALUE])
        return bytes([code | 0x80, _ILLEGAL_FUNCTION])
