"""SDO block downloads of a client, with CRC and repair of lost segments in every block, the last one included.

Source: CiA 301 7.2.4.3.9 to 7.2.4.3.12. A generator as in `sdo_transfer`.
"""

from binascii import crc_hqx
from collections.abc import Callable

from canopen.sdo import constants as sdo

from station.adapters.canopen.sdo_transfer import (
    SEGMENT_BYTES,
    Download,
    Exchange,
    Violation,
    initiate_header,
    initiates,
)

BLOCK_SIZE = 127
LAST = 0x80
#: Of how many blocks in a row nothing may arrive.
REPAIRS = 3


def download(index: int, sub: int, data: bytes) -> Download:
    """Writes an object in blocks."""
    command = sdo.REQUEST_BLOCK_DOWNLOAD | sdo.CRC_SUPPORTED | sdo.BLOCK_SIZE_SPECIFIED
    request = initiate_header(command, index, sub) + len(data).to_bytes(4, "little")
    answer = yield Exchange((request,), initiates(sdo.RESPONSE_BLOCK_DOWNLOAD, index, sub, 0xE3))
    yield from _send_blocks([data[i : i + SEGMENT_BYTES] for i in range(0, len(data), SEGMENT_BYTES)], answer[4])
    unused = -len(data) % SEGMENT_BYTES
    crc = crc_hqx(data, 0) if answer[0] & sdo.CRC_SUPPORTED else 0
    end = bytes([sdo.REQUEST_BLOCK_DOWNLOAD | sdo.END_BLOCK_TRANSFER | unused << 2, crc & 0xFF, crc >> 8])
    yield Exchange((end.ljust(8, b"\0"),), _step(sdo.RESPONSE_BLOCK_DOWNLOAD, sdo.END_BLOCK_TRANSFER))


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


def _step(kind: int, step: int) -> Callable[[bytes], bool]:
    return lambda answer: answer[0] & 0xE3 == kind | step
