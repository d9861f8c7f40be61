"""Frames as plain bytes: what their digest is taken of, and how a running attempt keeps them until it is packed.

By rows (form 2), so that the bytes can be laid out and hashed piece by piece while frames come in. Earlier logs hold
them by columns (form 1); digests of either form are checked alike.
"""

import hashlib
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from station.domain.core.types import Array, Frames
from station.errors import LogError

COLUMNS, ROWS = 1, 2
_KINDS = ("<i8", "<u4", "u1", "u1")


@dataclass(frozen=True, slots=True)
class PlainFrames:
    """Frames laid out: plain bytes, their digest in hexadecimal, and how many frames they are."""

    data: bytes
    sha256: str
    count: int


class PlainFramesBuilder:
    """Frames of one unit as they come in, each piece laid out and hashed at once. FD frames among classic ones widen
    all payloads, so their bytes are made anew at the end."""

    def __init__(self) -> None:
        self._parts: list[Frames] = []
        self._data: list[bytes] = []
        self._hash = hashlib.sha256()

    def add(self, frames: Frames) -> None:
        """The next frames; none are harmless."""
        if not len(frames):
            return
        piece = _rows(frames) if self._parts else _head(frames) + _rows(frames)
        self._parts.append(frames)
        self._data.append(piece)
        self._hash.update(piece)

    def frames(self) -> Frames:
        """All of them, in the order of arrival."""
        return Frames.join(self._parts)

    def done(self) -> PlainFrames:
        """What to keep; equal to `laid(frames())`."""
        if len({part.data.shape[1] for part in self._parts}) != 1:
            return to_plain(self.frames())
        return PlainFrames(b"".join(self._data), self._hash.hexdigest(), sum(map(len, self._parts)))


def to_plain(frames: Frames) -> PlainFrames:
    """All frames at once."""
    data = to_bytes(frames)
    return PlainFrames(data, digest(data), len(frames))


def to_bytes(frames: Frames, form: int = ROWS) -> bytes:
    """A line that names form and width of the payloads, then time, identifier, length and payload, little-endian."""
    if form == ROWS:
        return _head(frames) + _rows(frames)
    columns = (frames.time_ns, frames.can_id, frames.length, frames.data)
    parts = [np.ascontiguousarray(column, kind).data for column, kind in zip(columns, _KINDS, strict=True)]
    return b"".join([b"frames/1 %d %d\n" % (len(frames), frames.data.shape[1]), *parts])  # every byte copied once


def from_bytes(data: bytes | bytearray) -> Frames:
    """The inverse of either form. Errors: LogError when the bytes are not those of frames."""
    line, _, body = data.partition(b"\n")
    try:
        name, *sizes = line.split()
        numbers = [int(size) for size in sizes]
    except ValueError as exc:
        raise _damaged() from exc
    if name == b"frames/2" and len(numbers) == 1 and numbers[0] > 0 and len(body) % (13 + numbers[0]) == 0:
        rows: Array = np.frombuffer(body, _row(numbers[0]))
        time_ns, can_id, length, payload = (np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ())
        return Frames(time_ns, can_id, length, payload.view(np.uint8).reshape(len(rows), numbers[0]))
    if name == b"frames/1" and len(numbers) == 2 and min(numbers) >= 0 and len(body) == numbers[0] * (13 + numbers[1]):
        return _from_columns(body, *numbers)
    raise _damaged()


def form_of(data: bytes) -> int:
    """The form of plain bytes that `from_bytes` reads."""
    return COLUMNS if data.startswith(b"frames/1 ") else ROWS


def digest(data: bytes) -> str:
    """SHA-256 of plain bytes: the seal of the frames, whatever form they are kept in."""
    return hashlib.sha256(data).hexdigest()


def digest_matches(frames: Frames, sha256: str) -> bool:
    """Whether these are the frames of that digest, in one of the forms."""
    return any(digest(to_bytes(frames, form)) == sha256 for form in (ROWS, COLUMNS))


def _head(frames: Frames) -> bytes:
    return b"frames/2 %d\n" % frames.data.shape[1]


def _rows(frames: Frames) -> bytes:
    kind = _row(frames.data.shape[1])
    rows = np.empty(len(frames), kind)
    rows["time"], rows["id"], rows["length"] = frames.time_ns, frames.can_id, frames.length
    rows["payload"] = np.ascontiguousarray(frames.data).view(kind["payload"])[:, 0]
    return rows.tobytes()


@cache
def _row(width: int) -> Any:
    """One frame as bytes; the payload as one piece, which copies faster than byte by byte."""
    return np.dtype([("time", "<i8"), ("id", "<u4"), ("length", "u1"), ("payload", f"V{width}")])


def _from_columns(body: bytes | bytearray, rows: int, columns: int) -> Frames:
    ends = np.cumsum([0, 8 * rows, 4 * rows, rows, columns * rows])
    values: list[Any] = [np.frombuffer(body[a:b], k) for (a, b), k in zip(pairwise(ends), _KINDS, strict=True)]
    return Frames(values[0], values[1], values[2], values[3].reshape(rows, columns))


def _damaged() -> LogError:
    return LogError("frames-damaged")
