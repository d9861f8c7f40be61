"""A scanner and a label printer on real sockets, simulated."""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from types import MappingProxyType
from typing import Any

#: What a printer may want: the string of `~HS` and the field of it that is then 1 (ZPL II Programming Guide).
PRINTER_FAULTS: Mapping[str, tuple[int, int]] = MappingProxyType(
    {"paper-out": (0, 1), "paused": (0, 2), "head-up": (1, 2), "ribbon-out": (1, 3)}
)
#: `~HS` of a printer that wants nothing: three strings between STX and ETX.
_READY = ("030,0,0,0200,000,0,0,0,000,0,0,0", "000,0,0,0,1,2,6,0,00000000,1,000", "1234,0")


async def serve_scanner(host: str, port: int, read: Callable[[str], str | None], ready: Callable[[int], None]) -> None:
    """A reader that is triggered by `LON NEST` and answers with the label there, or ERROR."""

    async def connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with closing(writer), suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                request = (await reader.readuntil(b"\r")).decode("utf-8", "replace").strip()
                text = read(request.partition(" ")[2]) if request.startswith("LON") else None
                writer.write(f"{text or 'ERROR'}\r".encode())
                await writer.drain()

    await _listen(host, port, connection, ready)


async def serve_printer(
    host: str, port: int, tell: Callable[[Mapping[str, Any]], None], ready: Callable[[int], None], wants: str = ""
) -> None:
    """A ZPL printer that tells each label, and answers `~HS`. wants: one of PRINTER_FAULTS, '' for nothing."""

    async def connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        data = b""
        with closing(writer), suppress(ConnectionError):
            while part := await reader.read(4096):
                data += part
                if b"~HS" in data:
                    data = data.replace(b"~HS", b"")
                    writer.write(_status(wants))
                    await writer.drain()
                while b"^XZ" in data:
                    label, _, data = data.partition(b"^XZ")
                    tell({"label": (label + b"^XZ").decode("utf-8", "replace")})

    await _listen(host, port, connection, ready)


def _status(wants: str) -> bytes:
    strings = [text.split(",") for text in _READY]
    if wants:
        string, at = PRINTER_FAULTS[wants]
        strings[string][at] = "1"
    return b"".join(b"\x02" + ",".join(fields).encode() + b"\x03\r\n" for fields in strings)


async def _listen(host: str, port: int, connection: Any, ready: Callable[[int], None]) -> None:
    server = await asyncio.start_server(connection, host, port)
    ready(server.sockets[0].getsockname()[1])
    async with server:
        await server.serve_forever()
