"""All frames of an attempt ↔ bytes, lossless: each message is described once and foretold, the rest Rice coded.

Bytes: head (descriptions, parameters, unary bits, stragglers, order; compressed by zstd where that helps), then the
low bits, which are noise and are kept as they are. Unpacking needs nothing but the bytes.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import zstandard
from numpy.typing import NDArray

from station.domain.framepack import message
from station.domain.framepack.bytestream import Reader, Writer
from station.domain.framepack.layout import Layout
from station.domain.framepack.message import Key
from station.domain.types import Frames
from station.errors import LogError

#: First number of the bytes: how the head is kept; a later format takes the next number.
_AS_IS, _PACKED = 1, 2

#: Fewer frames of a message in a part than this are kept plainly, and so are all messages beyond this number.
_FEW, _MANY = 12, 32

Rows = NDArray[np.int64]


def pack(parts: Sequence[Frames]) -> bytes:
    """Frames of any number of stops as bytes."""
    split = [_messages(part) for part in parts]
    keys = sorted({key for messages, _ in split for key in messages})[:_MANY]
    layouts = {key: _layout(key, parts, split) for key in keys}
    out, low = Writer(), list[bytes]()
    out.count(len(parts), len(keys))
    for key, layout in layouts.items():
        message.write_layout(out, key, layout)
    for part, (messages, _) in zip(parts, split, strict=True):
        _pack_part(out, low, part, {key: rows for key, rows in messages.items() if key in layouts}, layouts)
    return _box(bytes(out), b"".join(low))


def unpack(data: bytes) -> list[Frames]:
    """The frames from their bytes. Errors: LogError when the bytes are not those of frames."""
    head, low = _unbox(Reader(data))
    number, described = head.count(), head.count()
    layouts = [message.read_layout(head) for _ in range(described)]
    return [_unpack_part(head, low, layouts) for _ in range(number)]


def _layout(key: Key, parts: Sequence[Frames], split: Sequence[tuple[dict[Key, Rows], Rows]]) -> Layout:
    """Found on the frames of one message in all parts."""
    own = [part[messages[key]] for part, (messages, _) in zip(parts, split, strict=True) if key in messages]
    return message.describe(own)


def _messages(frames: Frames) -> tuple[dict[Key, Rows], Rows]:
    """Rows of each message that repays a description, by identifier and length; and all other rows."""
    n, width = len(frames), frames.data.shape[1]
    everything = np.arange(n)
    if n < _FEW or int(frames.time_ns.max()) - int(frames.time_ns.min()) >= message.LONGEST_NS:
        return {}, everything
    code = frames.can_id.astype(np.uint64) << np.uint64(8) | frames.length
    names, place, count = np.unique(code, return_inverse=True, return_counts=True)
    large = [i for i in range(len(names)) if count[i] >= _FEW and int(names[i]) & 0xFF <= width]
    found = {(int(names[i]) >> 8, int(names[i]) & 0xFF): np.flatnonzero(place == i) for i in large}
    return found, np.flatnonzero(~np.isin(place, large))


def _pack_part(
    out: Writer, low: list[bytes], frames: Frames, messages: dict[Key, Rows], layouts: dict[Key, Layout]
) -> None:
    known = list(layouts)
    out.count(frames.data.shape[1], len(messages))
    for key, rows in messages.items():
        out.count(known.index(key))
        message.pack(out, low, frames[rows], layouts[key])
    taken = np.concatenate([np.zeros(0, np.int64), *messages.values()])
    rest = np.setdiff1d(np.arange(len(frames)), taken)
    _stragglers(out, frames[rest])
    _order(out, frames, [*messages.values(), rest])


def _unpack_part(head: Reader, low: Reader, layouts: Sequence[tuple[Key, Layout]]) -> Frames:
    width = head.count()
    found = [message.unpack(head, low, *layouts[head.count()]) for _ in range(head.count())]
    found.append(_read_stragglers(head, width))
    joined = Frames.join(found)
    whole = replace(joined, data=message.of_width(joined.data, width))
    return _read_order(head, whole, [len(f) for f in found])


def _stragglers(out: Writer, frames: Frames) -> None:
    """Column by column, the time as differences, byte planes together: zstd does the rest."""
    out.count(len(frames))
    change = np.diff(frames.time_ns, prepend=np.int64(0)).astype("<i8")
    out.out += change.view(np.uint8).reshape(-1, 8).T.tobytes()
    out.out += frames.can_id.astype("<u4").tobytes() + frames.length.tobytes() + frames.data.T.tobytes()


def _read_stragglers(head: Reader, width: int) -> Frames:
    n = head.count()
    planes = np.frombuffer(head.take(8 * n), np.uint8).reshape(8, n)
    change = np.ascontiguousarray(planes.T).view("<i8").reshape(n).astype(np.int64)
    can_id = np.frombuffer(head.take(4 * n), "<u4").astype(np.uint32)
    length = np.frombuffer(head.take(n), np.uint8).copy()
    data = np.frombuffer(head.take(width * n), np.uint8).reshape(width, n).T.copy()
    return Frames(np.cumsum(change), can_id, length, data)


def _order(out: Writer, frames: Frames, groups: Sequence[Rows]) -> None:
    """Nothing where sorting by time gives the order of arrival back; else the message of each frame in turn."""
    rows = np.concatenate(groups)
    by_time = rows[np.argsort(frames.time_ns[rows], kind="stable")]
    if (by_time == np.arange(len(frames))).all():
        out.count(0)
        return
    code = np.zeros(len(frames), np.uint8)
    for i, group in enumerate(groups):
        code[group] = i
    out.count(1)
    out.out += code.tobytes()


def _read_order(head: Reader, joined: Frames, sizes: Sequence[int]) -> Frames:
    if head.count() == 0:
        return joined[np.argsort(joined.time_ns, kind="stable")]
    code = np.frombuffer(head.take(sum(sizes)), np.uint8)
    return joined[np.argsort(np.argsort(code, kind="stable"), kind="stable")]


def _box(head: bytes, low: bytes) -> bytes:
    packed = zstandard.ZstdCompressor(level=12).compress(head)
    smaller = len(packed) < len(head)
    box = Writer()
    box.count(_PACKED if smaller else _AS_IS)
    box.string(packed if smaller else head)
    return bytes(box) + low


def _unbox(box: Reader) -> tuple[Reader, Reader]:
    form, head = box.count(), box.string()
    if form not in (_AS_IS, _PACKED):
        raise LogError("stored frames are of an unknown format; update this station")
    if form == _PACKED:
        try:
            head = zstandard.ZstdDecompressor().decompress(head)
        except zstandard.ZstdError as exc:
            raise LogError("stored frames are damaged; run `station audit --verify`") from exc
    return Reader(head), Reader(box.data[box.at :])
