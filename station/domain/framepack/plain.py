"""Frames as plain bytes: what their digest is taken of, and how a running attempt keeps them until it is packed."""

import hashlib
from itertools import pairwise
from typing import Any

import numpy as np

from station.domain.types import Frames
from station.errors import LogError

_KINDS = ("<i8", "<u4", "u1", "u1")


def to_bytes(frames: Frames) -> bytes:
    """One line with number and width of the payloads, then time, identifier, length and payload, little-endian."""
    columns = (frames.time_ns, frames.can_id, frames.length, frames.data)
    parts = [np.ascontiguousarray(column, kind).data for column, kind in zip(columns, _KINDS, strict=True)]
    return b"".join([b"frames/1 %d %d\n" % (len(frames), frames.data.shape[1]), *parts])  # every byte copied once


def from_bytes(data: bytes) -> Frames:
    """The inverse. Errors: LogError when the bytes are not those of frames."""
    line, _, body = data.partition(b"\n")
    try:
        name, n, width = line.split()
        rows, columns = int(n), int(width)
    except ValueError as exc:
        raise _damaged() from exc
    if name != b"frames/1" or len(body) != rows * (13 + columns):
        raise _damaged()
    ends = np.cumsum([0, 8 * rows, 4 * rows, rows, columns * rows])
    values: list[Any] = [np.frombuffer(body[a:b], k) for (a, b), k in zip(pairwise(ends), _KINDS, strict=True)]
    return Frames(values[0], values[1], values[2], values[3].reshape(rows, columns))


def digest(data: bytes) -> str:
    """SHA-256 of plain bytes: the seal of the frames, whatever form they are kept in."""
    return hashlib.sha256(data).hexdigest()


def _damaged() -> LogError:
    return LogError("stored frames are damaged; run `station audit --verify`")
