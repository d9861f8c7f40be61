"""Frames ↔ bytes, lossless: frames of one message are foretold and the rest Rice coded; stragglers are kept plainly.

Layout: format, number and width of the payloads, messages, stragglers and order, compressed by zstd; then the low
bits, which are noise and are kept as they are. Decoding needs nothing but the bytes.
"""

import hashlib
from dataclasses import dataclass, field

import numpy as np
import zstandard
from numpy.typing import NDArray

from station.domain.framepack import layout as layouts
from station.domain.framepack import message
from station.domain.framepack.bytestream import Reader, Writer
from station.domain.types import Frames
from station.errors import LogError

_FORMAT = 1

#: Fewer frames of a message than this are kept plainly, and so are all messages beyond this number.
_FEW, _MANY = 12, 32

#: A layout that served before is looked for anew when its frames grow by this factor.
_WORSE = 1.1


def digest(frames: Frames) -> str:
    """SHA-256 of the frames' own bytes, little-endian, column by column: what the compressed form must give back."""
    seal = hashlib.sha256(f"frames/1 {len(frames)} {frames.data.shape[1]}\n".encode())
    for column, kind in ((frames.time_ns, "<i8"), (frames.can_id, "<u4"), (frames.length, "u1"), (frames.data, "u1")):
        seal.update(np.ascontiguousarray(column, kind).data)
    return seal.hexdigest()


@dataclass(slots=True)
class Encoder:
    """Remembers what layout served each message last, so that a stop costs no search; any memory gives right bytes."""

    served: dict[tuple[int, int, int], tuple[layouts.Layout, float]] = field(default_factory=dict)

    def encode(self, frames: Frames) -> bytes:
        """The frames as bytes."""
        out, low = Writer(), list[bytes]()
        out.count(len(frames), frames.data.shape[1])
        groups, rest = _groups(frames)
        out.count(len(groups))
        for rows in groups:
            self._message(out, low, frames if len(rows) == len(frames) else frames[rows])
        _plain(out, frames[rest])
        _order(out, frames, groups, rest)
        packed = zstandard.ZstdCompressor(level=3).compress(bytes(out))
        return bytes([_FORMAT]) + len(packed).to_bytes(4, "little") + packed + b"".join(low)

    def _message(self, out: Writer, low: list[bytes], frames: Frames) -> None:
        width = message.width_of(frames)
        key = (int(frames.can_id[0]), int(frames.length[0]), width)
        if key in self.served:
            layout, size = self.served[key]
            made, made_low = Writer(), list[bytes]()
            message.pack(made, made_low, frames, layout)
            if len(bytes(made)) + len(made_low[0]) <= len(frames) * size * _WORSE + 64:
                out.out += made.out
                low += made_low
                return
        layout = layouts.find(frames.data[:, :width], message.ticks_of(frames)[0])
        before = len(out.out)
        message.pack(out, low, frames, layout)
        self.served[key] = layout, (len(out.out) - before + len(low[-1])) / len(frames)


def encode(frames: Frames) -> bytes:
    """The frames as bytes, without memory of others."""
    return Encoder().encode(frames)


def decode(data: bytes) -> Frames:
    """The frames from their bytes. Errors: LogError when the bytes are not those of frames."""
    if len(data) < 5 or data[0] != _FORMAT:
        raise LogError("stored frames are of an unknown format; update this station")
    size = int.from_bytes(data[1:5], "little")
    try:
        head = Reader(zstandard.ZstdDecompressor().decompress(data[5 : 5 + size]))
    except zstandard.ZstdError as exc:
        raise LogError("stored frames are damaged; run `station audit --verify`") from exc
    low = Reader(data[5 + size :])
    n, width = head.count(), head.count()
    parts = [message.unpack(head, low, width) for _ in range(head.count())]
    parts.append(_read_plain(head, width))
    return _read_order(head, Frames.join(parts) if n else _none(width), [len(p) for p in parts])


def _groups(frames: Frames) -> tuple[list[NDArray[np.int64]], NDArray[np.int64]]:
    """Rows of each message that repays a description, and all other rows."""
    if len(frames) == 0 or int(frames.time_ns.max()) - int(frames.time_ns.min()) >= message.LONGEST_NS:
        return [], np.arange(len(frames))
    key = frames.can_id.astype(np.uint64) << np.uint64(8) | frames.length
    if (key == key[0]).all():
        rows = np.arange(len(frames))
        fits = len(frames) >= _FEW and frames.length[0] <= frames.data.shape[1]
        return ([rows], rows[:0]) if fits else ([], rows)
    names, code, count = np.unique(key, return_inverse=True, return_counts=True)
    large = [i for i in np.argsort(-count, kind="stable")[:_MANY] if count[i] >= _FEW]
    large = [i for i in large if int(names[i]) & 0xFF <= frames.data.shape[1]]
    return [np.flatnonzero(code == i) for i in large], np.flatnonzero(~np.isin(code, large))


def _plain(out: Writer, frames: Frames) -> None:
    out.count(len(frames))
    out.out += np.diff(frames.time_ns, prepend=np.int64(0)).astype("<i8").view(np.uint8).reshape(-1, 8).T.tobytes()
    out.out += frames.can_id.astype("<u4").tobytes() + frames.length.tobytes() + frames.data.T.tobytes()


def _read_plain(head: Reader, width: int) -> Frames:
    n = head.count()
    change = np.frombuffer(head.take(8 * n), np.uint8).reshape(8, n).T.copy().view("<i8")[:, 0] if n else np.zeros(0)
    can_id = np.frombuffer(head.take(4 * n), "<u4").astype(np.uint32)
    length = np.frombuffer(head.take(n), np.uint8).copy()
    data = np.frombuffer(head.take(width * n), np.uint8).reshape(width, n).T.copy()
    return Frames(np.cumsum(change.astype(np.int64)), can_id, length, data)


def _order(out: Writer, frames: Frames, groups: list[NDArray[np.int64]], rest: NDArray[np.int64]) -> None:
    """Nothing where sorting by time gives the order of arrival back; else the message of each frame in turn."""
    rows = np.concatenate([*groups, rest])
    by_time = rows[np.argsort(frames.time_ns[rows], kind="stable")]
    if (by_time == np.arange(len(frames))).all():
        out.count(0)
        return
    code = np.zeros(len(frames), np.uint8)
    for i, group in enumerate([*groups, rest]):
        code[group] = i
    out.count(1)
    out.out += code.tobytes()


def _read_order(head: Reader, joined: Frames, sizes: list[int]) -> Frames:
    if head.count() == 0:
        return joined[np.argsort(joined.time_ns, kind="stable")]
    code = np.frombuffer(head.take(sum(sizes)), np.uint8)
    place = np.argsort(code, kind="stable")
    return joined[np.argsort(place, kind="stable")]


def _none(width: int) -> Frames:
    return Frames(np.zeros(0, np.int64), np.zeros(0, np.uint32), np.zeros(0, np.uint8), np.zeros((0, width), np.uint8))
