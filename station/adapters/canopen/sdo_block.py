"""SDO block transfers of a client, with CRC and repair of lost segments in every block, the last one included.

Source: CiA 301 7.2.4.3.9 to 7.2.4.3.16. Generators as in `sdo_transfer`.
"""

from binascii import crc_hqx
from collections.abc import Callable, Generator

from canopen.sdo import constants as sdo

from station.adapters.canopen.sdo_transfer import (
    MOST_BYTES,
    SEGMENT_BYTES,
    Download,
    Exchange,
    NoAnswer,
    Upload,
    Violation,
    initiate_header,
    initiates,
)

BLOCK_SIZE = 127
LAST = 0x80
#: How many blocks of an upload may be incomplete, and of how many in a row of a download nothing may arrive.
REPAIRS = 3
#: So many frames are heard of one block: a server that repeats a segment for ever is not listened to for ever.
_MOST_HEARD = 2 * BLOCK_SIZE


def upload(index: int, sub: int) -> Upload:
    """Reads an object in blocks."""
    request = initiate_header(sdo.REQUEST_BLOCK_UPLOAD | sdo.CRC_SUPPORTED, index, sub) + bytes([BLOCK_SIZE, 0, 0, 0])
    answer = yield Exchange((request,), initiates(sdo.RESPONSE_BLOCK_UPLOAD, index, sub, 0xE1))
    with_crc = bool(answer[0] & sdo.CRC_SUPPORTED)
    size = int.from_bytes(answer[4:8], "little") if answer[0] & sdo.BLOCK_SIZE_SPECIFIED else None
    padded, end = yield from _blocks(MOST_BYTES if size is None else size)
    data = padded[: len(padded) - (end[0] >> 2 & 7)]
    if with_crc and int.from_bytes(end[1:3], "little") != crc_hqx(data, 0):
        raise Violation(sdo.ABORT_CRC_ERROR)
    if size not in (None, len(data)):
        raise Violation(sdo.ABORT_LENGTH_TOO_LOW)
    yield Exchange((_request(sdo.END_BLOCK_TRANSFER),), None)
    return data


def _blocks(most: int) -> Generator[Exchange, bytes, tuple[bytes, bytes]]:
    """All segments, and the frame that ends the transfer."""
    data, last, repairs = bytearray(), False, 0
    send = _request(sdo.START_BLOCK_UPLOAD)
    while not last:
        received, last = yield from _block(send, data, may_repair=repairs < REPAIRS)
        repairs += not last and received < BLOCK_SIZE
        if repairs > REPAIRS:
            raise Violation(sdo.ABORT_INVALID_SEQUENCE_NUMBER)
        if len(data) >= max(most, 1) + SEGMENT_BYTES:
            raise Violation(sdo.ABORT_LENGTH_TOO_HIGH)
        send = _request(sdo.BLOCK_TRANSFER_RESPONSE, received, BLOCK_SIZE)
    end = yield Exchange((send,), _step(sdo.RESPONSE_BLOCK_UPLOAD, sdo.END_BLOCK_TRANSFER))
    return bytes(data), end


def _block(send: bytes, data: bytearray, *, may_repair: bool) -> Generator[Exchange, bytes, tuple[int, bool]]:
    """One block: how many segments came in sequence, and whether the last one of all is among them."""
    received = 0
    frames: tuple[bytes, ...] = (send,)
    for _ in range(_MOST_HEARD):
        try:
            answer = yield Exchange(frames, lambda _: True)
        except NoAnswer:
            if may_repair:
                return received, False
            raise
        frames = ()
        number, last = answer[0] & ~LAST, bool(answer[0] & LAST)
        if number == received + 1:
            data += answer[1:8]
            received = number
            if last:
                return received, True
        if number >= BLOCK_SIZE or last:
            break
    return received, False


def download(index: int, sub: int, data: bytes) -> Download:
    """Writes an object in blocks."""
    command = sdo.REQUEST_BLOCK_DOWNLOAD | sdo.CRC_SUPPORTED | sdo.BLOCK_SIZE_SPECIFIED
    request = initiate_header(command, index, sub) + len(data).to_bytes(4, "little")
    answer = yield Exchange((request,), initiates(sdo.RESPONSE_BLOCK_DOWNLOAD, index, sub, 0xE3))
    yield from _send_blocks([data[i : i + SEGMENT_BYTES] for i in range(0, len(data), SEGMENT_BYTES)], answer[4])
    unused = -len(data) % SEGMENT_BYTES
    crc = crc_hqx(data, 0) if answer[0] & sdo.CRC_SUPPORTED else 0
    end = _request(sdo.END_BLOCK_TRANSFER | unused << 2, crc & 0xFF, crc >> 8, kind=sdo.REQUEST_BLOCK_DOWNLOAD)
    yield Exchange((end,), _step(sdo.RESPONSE_BLOCK_DOWNLOAD, sdo.END_BLOCK_TRANSFER))


def _send_blocks(segments: list[bytes], size: int) -> Download:
    """Sends block after block; what the server did not get is sent again."""
    at, repairs = 0, 0
    while at < len(segments):
        if not 1 <= size <= BLOCK_SIZE:
            raise Violation(sdo.ABORT_INVALID_BLOCK_SIZE)
        block = segments[at : at + size]
        frames = tuple(
            bytes([number | LAST * (at + number == len(segments))]) + segment.ljust(SEGMENT_BYTES, b"\0")
            for number, segment in enumerate(block, 1)
        )
        answer = yield Exchange(frames, _step(sdo.RESPONSE_BLOCK_DOWNLOAD, sdo.BLOCK_TRANSFER_RESPONSE))
        acknowledged, size = answer[1], answer[2]
        repairs = repairs + 1 if acknowledged == 0 else 0
        if acknowledged > len(block) or repairs > REPAIRS:
            raise Violation(sdo.ABORT_INVALID_SEQUENCE_NUMBER)
        at += acknowledged


def _request(step: int, *rest: int, kind: int = sdo.REQUEST_BLOCK_UPLOAD) -> bytes:
    return bytes([kind | step, *rest]).ljust(8, b"\0")


def _step(kind: int, step: int) -> Callable[[bytes], bool]:
    return lambda answer: answer[0] & 0xE3 == kind | step
