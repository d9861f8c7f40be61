"""SDO transfers of a server as generators: they yield answers, are sent the next request, and return the last answers.

Source: CiA 301 7.2.4.3.3 to 7.2.4.3.16.
"""

from binascii import crc_hqx
from collections.abc import Generator
from dataclasses import dataclass
from typing import Protocol

from canopen.sdo import constants as sdo

from station.adapters.canopen.sdo_transfer import COMMAND_MASK, MOST_BYTES, SEGMENT_BYTES, initiate_header

_BLOCK_SIZE = 127
_LAST = 0x80


@dataclass(frozen=True, slots=True)
class SdoReply:
    """Frames to send; segments_follow: what comes next are a block's segments, which look like any command."""

    frames: tuple[bytes, ...]
    segments_follow: bool = False


Serving = Generator[SdoReply, bytes, tuple[bytes, ...]]


class SdoAbort(Exception):
    """Ends a transfer with this abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


class Objects(Protocol):
    """What is served. Every method may raise SdoAbort."""

    def read(self, index: int, sub: int) -> bytes:
        """The bytes of an object."""

    def check(self, index: int, sub: int, size: int | None) -> None:
        """Raises when an object cannot be written, or not with that many bytes (None: not known yet)."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Takes the bytes of an object."""


def upload(objects: Objects, index: int, sub: int, _request: bytes) -> Serving:
    """Answers a read: expedited up to four bytes, else in segments."""
    data = objects.read(index, sub)
    if 0 < len(data) <= 4:
        command = sdo.RESPONSE_UPLOAD | sdo.EXPEDITED | sdo.SIZE_SPECIFIED | (4 - len(data)) << 2
        return (initiate_header(command, index, sub) + data.ljust(4, b"\0"),)
    size = len(data).to_bytes(4, "little")
    request = yield SdoReply((initiate_header(sdo.RESPONSE_UPLOAD | sdo.SIZE_SPECIFIED, index, sub) + size,))
    toggle, at = 0, 0
    while True:
        _check_segment(request, sdo.REQUEST_SEGMENT_UPLOAD, toggle)
        part = data[at : at + SEGMENT_BYTES]
        at += SEGMENT_BYTES
        command = sdo.RESPONSE_SEGMENT_UPLOAD | toggle | (SEGMENT_BYTES - len(part)) << 1 | (at >= len(data))
        frame = bytes([command]) + part.ljust(SEGMENT_BYTES, b"\0")
        if at >= len(data):
            return (frame,)
        request = yield SdoReply((frame,))
        toggle ^= sdo.TOGGLE_BIT


def download(objects: Objects, index: int, sub: int, request: bytes) -> Serving:
    """Takes a write: expedited, or in segments."""
    done = initiate_header(sdo.RESPONSE_DOWNLOAD, index, sub) + bytes(4)
    command = request[0]
    if command & sdo.EXPEDITED:
        data = request[4 : 8 - (command >> 2 & 3 if command & sdo.SIZE_SPECIFIED else 0)]
        objects.check(index, sub, len(data) if command & sdo.SIZE_SPECIFIED else None)
        objects.write(index, sub, data)
        return (done,)
    size = int.from_bytes(request[4:8], "little") if command & sdo.SIZE_SPECIFIED else None
    objects.check(index, sub, size)
    data, toggle = b"", 0
    request = yield SdoReply((done,))
    while True:
        _check_segment(request, sdo.REQUEST_SEGMENT_DOWNLOAD, toggle)
        data += request[1 : 8 - (request[0] >> 1 & 7)]
        answer = bytes([sdo.RESPONSE_SEGMENT_DOWNLOAD | toggle]) + bytes(SEGMENT_BYTES)
        if request[0] & sdo.NO_MORE_DATA:
            break
        if len(data) > (MOST_BYTES if size is None else size):
            raise SdoAbort(sdo.ABORT_LENGTH_TOO_HIGH)
        request = yield SdoReply((answer,))
        toggle ^= sdo.TOGGLE_BIT
    _take(objects, index, sub, data, size)
    return (answer,)


def block_upload(objects: Objects, index: int, sub: int, request: bytes) -> Serving:
    """Answers a read in blocks, with CRC; what the client did not get is sent again."""
    data, size = objects.read(index, sub), request[4]
    start = initiate_header(sdo.RESPONSE_BLOCK_UPLOAD | sdo.CRC_SUPPORTED | sdo.BLOCK_SIZE_SPECIFIED, index, sub)
    _check_block_size(size)
    request = yield SdoReply((start + len(data).to_bytes(4, "little"),))
    _check_command(request, sdo.REQUEST_BLOCK_UPLOAD | sdo.START_BLOCK_UPLOAD, 0xE3)
    segments = [data[i : i + SEGMENT_BYTES] for i in range(0, len(data), SEGMENT_BYTES)] or [b""]
    at = 0
    while at < len(segments):
        block = segments[at : at + size]
        request = yield SdoReply(
            tuple(
                bytes([number | _LAST * (at + number == len(segments))]) + segment.ljust(SEGMENT_BYTES, b"\0")
                for number, segment in enumerate(block, 1)
            )
        )
        _check_command(request, sdo.REQUEST_BLOCK_UPLOAD | sdo.BLOCK_TRANSFER_RESPONSE, 0xE3)
        if request[1] > len(block):
            raise SdoAbort(sdo.ABORT_INVALID_SEQUENCE_NUMBER)
        at, size = at + request[1], request[2]
        _check_block_size(size)
    unused = len(segments) * SEGMENT_BYTES - len(data)
    end = sdo.RESPONSE_BLOCK_UPLOAD | sdo.END_BLOCK_TRANSFER | unused << 2
    request = yield SdoReply((bytes([end]) + crc_hqx(data, 0).to_bytes(2, "little") + bytes(5),))
    _check_command(request, sdo.REQUEST_BLOCK_UPLOAD | sdo.END_BLOCK_TRANSFER, 0xE3)
    return ()


def block_download(objects: Objects, index: int, sub: int, request: bytes) -> Serving:
    """Takes a write in blocks; asks again for what did not come."""
    size = int.from_bytes(request[4:8], "little") if request[0] & sdo.BLOCK_SIZE_SPECIFIED else None
    with_crc = bool(request[0] & sdo.CRC_SUPPORTED)
    objects.check(index, sub, size)
    start = initiate_header(sdo.RESPONSE_BLOCK_DOWNLOAD | sdo.CRC_SUPPORTED, index, sub) + bytes([_BLOCK_SIZE, 0, 0, 0])
    reply, data = SdoReply((start,), segments_follow=True), b""
    complete = False
    while not complete:
        acknowledged, data, complete = yield from _receive_block(reply, data)
        if len(data) >= (MOST_BYTES if size is None else max(size, 1)) + SEGMENT_BYTES:
            raise SdoAbort(sdo.ABORT_LENGTH_TOO_HIGH)
        command = sdo.RESPONSE_BLOCK_DOWNLOAD | sdo.BLOCK_TRANSFER_RESPONSE
        reply = SdoReply((bytes([command, acknowledged, _BLOCK_SIZE]) + bytes(5),), segments_follow=not complete)
    request = yield reply
    _check_command(request, sdo.REQUEST_BLOCK_DOWNLOAD | sdo.END_BLOCK_TRANSFER, 0xE1)
    data = data[: len(data) - (request[0] >> 2 & 7)]
    if with_crc and int.from_bytes(request[1:3], "little") != crc_hqx(data, 0):
        raise SdoAbort(sdo.ABORT_CRC_ERROR)
    _take(objects, index, sub, data, size)
    return (bytes([sdo.RESPONSE_BLOCK_DOWNLOAD | sdo.END_BLOCK_TRANSFER]) + bytes(7),)


def _receive_block(reply: SdoReply, data: bytes) -> Generator[SdoReply, bytes, tuple[int, bytes, bool]]:
    """One block: how many segments came in sequence, all data so far, and whether the last segment is among them."""
    received = 0
    while True:
        segment = yield reply
        reply = SdoReply((), segments_follow=True)
        number, last = segment[0] & ~_LAST, bool(segment[0] & _LAST)
        if number == received + 1:
            data, received = data + segment[1:8], number
            if last:
                return received, data, True
        if number >= _BLOCK_SIZE or last:
            return received, data, False


def _take(objects: Objects, index: int, sub: int, data: bytes, size: int | None) -> None:
    if size is not None and len(data) != size:
        raise SdoAbort(sdo.ABORT_LENGTH_TOO_HIGH if len(data) > size else sdo.ABORT_LENGTH_TOO_LOW)
    objects.check(index, sub, len(data))
    objects.write(index, sub, data)


def _check_segment(request: bytes, kind: int, toggle: int) -> None:
    _check_command(request, kind, COMMAND_MASK)
    if request[0] & sdo.TOGGLE_BIT != toggle:
        raise SdoAbort(sdo.ABORT_TOGGLE_NOT_ALTERNATED)


def _check_command(request: bytes, command: int, mask: int) -> None:
    if request[0] & mask != command:
        raise SdoAbort(sdo.ABORT_INVALID_COMMAND_SPECIFIER)


def _check_block_size(size: int) -> None:
    if not 1 <= size <= _BLOCK_SIZE:
        raise SdoAbort(sdo.ABORT_INVALID_BLOCK_SIZE)
