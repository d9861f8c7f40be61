"""SDO transfers of a client as generators: they yield what to send and which answer fits, and are sent the answer.

No bus, no clock: the driver (`sdo_client`) owns both. Source: CiA 301 7.2.4.3, expedited and segmented transfer.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass

from canopen.sdo import constants as sdo

#: A device that sends segments for ever is stopped here.
MOST_BYTES = 1 << 22

SEGMENT_BYTES = 7
COMMAND_MASK = 0xE0


@dataclass(frozen=True, slots=True)
class Exchange:
    """Frames to send (none: only listen), and whether a frame of the server answers them (None: none will)."""

    send: tuple[bytes, ...]
    fits: Callable[[bytes], bool] | None


class NoAnswer(Exception):
    """Thrown into a transfer at a time-out; a transfer that can mend it goes on, the others let it through."""


class Violation(Exception):
    """The server broke the protocol. code: the abort code to send it."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


class Refused(Exception):
    """The server aborted the transfer. code: its abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


Upload = Generator[Exchange, bytes, bytes]
Download = Generator[Exchange, bytes, None]


def initiate_header(command: int, index: int, sub: int) -> bytes:
    """Command, index and sub-index: the first four bytes of an initiating frame."""
    return bytes(sdo.SDO_STRUCT.pack(command, index, sub))


def initiates(kind: int, index: int, sub: int, mask: int = COMMAND_MASK) -> Callable[[bytes], bool]:
    """Fits an answer that initiates a transfer of this kind and is about this object."""
    wanted = initiate_header(0, index, sub)[1:]
    return lambda answer: answer[0] & mask == kind and answer[1:4] == wanted


def upload(index: int, sub: int, size: int | None = None) -> Upload:
    """Reads an object, expedited or in segments. size: its bytes, where an expedited answer does not say them."""
    fits = initiates(sdo.RESPONSE_UPLOAD, index, sub)
    answer = yield Exchange((initiate_header(sdo.REQUEST_UPLOAD, index, sub) + bytes(4),), fits)
    command = answer[0]
    if command & sdo.EXPEDITED:
        if command & sdo.SIZE_SPECIFIED:
            return answer[4 : 8 - ((command >> 2) & 3)]
        return answer[4 : 4 + (size or _communication_size(index, sub))]
    size = int.from_bytes(answer[4:8], "little") if command & sdo.SIZE_SPECIFIED else None
    return (yield from _upload_segments(size))


def _communication_size(index: int, sub: int) -> int:
    """Bytes of an object that CiA 301 defines, where they are fewer than four."""
    kind = index & 0xFE00
    if kind == 0x1800:
        return {0: 1, 2: 1, 3: 2, 5: 2, 6: 1}.get(sub, 4)
    return {(0x1A00, 0): 1}.get((kind, sub), {(0x1001, 0): 1, (0x1017, 0): 2}.get((index, sub), 4))


def _upload_segments(size: int | None) -> Upload:
    data, toggle, last = bytearray(), 0, False
    while not last:
        request = bytes([sdo.REQUEST_SEGMENT_UPLOAD | toggle]) + bytes(SEGMENT_BYTES)
        answer = yield Exchange((request,), _segment(sdo.RESPONSE_SEGMENT_UPLOAD, toggle))
        part = answer[1 : 8 - (answer[0] >> 1 & 7)]
        data += part
        last = bool(answer[0] & sdo.NO_MORE_DATA)
        if not (part or last):  # segments of nothing could go on for ever
            raise Violation(sdo.ABORT_LENGTH_TOO_LOW)
        toggle ^= sdo.TOGGLE_BIT
        if len(data) > (MOST_BYTES if size is None else size):
            raise Violation(sdo.ABORT_LENGTH_TOO_HIGH)
    if size not in (None, len(data)):
        raise Violation(sdo.ABORT_LENGTH_TOO_LOW)
    return bytes(data)


def download(index: int, sub: int, data: bytes) -> Download:
    """Writes an object: up to four bytes expedited, more in segments."""
    fits = initiates(sdo.RESPONSE_DOWNLOAD, index, sub)
    if 0 < len(data) <= 4:
        command = sdo.REQUEST_DOWNLOAD | sdo.EXPEDITED | sdo.SIZE_SPECIFIED | (4 - len(data)) << 2
        yield Exchange((initiate_header(command, index, sub) + data.ljust(4, b"\0"),), fits)
        return
    start = initiate_header(sdo.REQUEST_DOWNLOAD | sdo.SIZE_SPECIFIED, index, sub) + len(data).to_bytes(4, "little")
    yield Exchange((start,), fits)
    toggle = 0
    for at in range(0, max(len(data), 1), SEGMENT_BYTES):
        part = data[at : at + SEGMENT_BYTES]
        last = at + SEGMENT_BYTES >= len(data)
        command = sdo.REQUEST_SEGMENT_DOWNLOAD | toggle | (SEGMENT_BYTES - len(part)) << 1 | last
        request = bytes([command]) + part.ljust(SEGMENT_BYTES, b"\0")
        yield Exchange((request,), _segment(sdo.RESPONSE_SEGMENT_DOWNLOAD, toggle))
        toggle ^= sdo.TOGGLE_BIT


def _segment(kind: int, toggle: int) -> Callable[[bytes], bool]:
    return lambda answer: answer[0] & COMMAND_MASK == kind and answer[0] & sdo.TOGGLE_BIT == toggle
