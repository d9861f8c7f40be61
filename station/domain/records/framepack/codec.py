"""All frames of an attempt ↔ bytes, lossless: each message is described once and foretold, the rest compressed.

Bytes: the head (descriptions, starts, stragglers, order; compressed by zstd where that helps), then what is left of
each message's columns, over all parts in one. Unpacking needs nothing but the bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Frames
from station.domain.records.framepack import columns, message
from station.domain.records.framepack.bytestream import ByteReader, ByteWriter
from station.domain.records.framepack.layout import PayloadLayout
from station.domain.records.framepack.message import Key, MessageHeader
from station.errors import LogError

#: First number of the bytes: how the head is kept; a later format takes the next number.
_AS_IS, _PACKED = 1, 2

#: Fewer frames of a message in a part than this are kept plainly, and so are all messages beyond this number.
_MIN_FRAMES, _MAX_MESSAGES = 12, 32

Rows = NDArray[np.int64]
#: What is left of a message's columns, part after part.
Residuals = list[list[NDArray[np.uint64]]]


def pack(parts: Sequence[Frames]) -> bytes:
    """Frames of any number of visits as bytes."""
    split = [_messages(part) for part in parts]
    keys = sorted({key for messages, _ in split for key in messages})[:_MAX_MESSAGES]
    layouts = {key: _layout(key, parts, split) for key in keys}
    head = ByteWriter()
    residuals: dict[Key, Residuals] = {key: [[] for _ in layout.columns] for key, layout in layouts.items()}
    head.count(len(parts), len(keys))
    for key, layout in layouts.items():
        message.write_layout(head, key, layout)
    for part, (messages, _) in zip(parts, split, strict=True):
        _pack_part(head, residuals, part, {key: rows for key, rows in messages.items() if key in layouts}, layouts)
    out = _wrap_head(bytes(head))
    columns.pack(out, [np.concatenate(column) for of_message in residuals.values() for column in of_message])
    return bytes(out)


def unpack(data: bytes) -> list[Frames]:
    """The frames from their bytes. Errors: LogError when the bytes are not those of frames."""
    try:
        return _unpack(ByteReader(data))
    except (IndexError, ValueError, OverflowError) as error:
        raise LogError("frames-damaged") from error


def _unpack(box: ByteReader) -> list[Frames]:
    head = _unwrap_head(box)
    number, described = head.count(), head.count()
    layouts = [message.read_layout(head) for _ in range(described)]
    parts = [_read_part(head, layouts) for _ in range(number)]
    totals = [sum(b.n for part in parts for i, b in part.begun if i == each) for each in range(described)]
    lengths = [n for n, (_, layout) in zip(totals, layouts, strict=True) for _ in layout.columns]
    flat = iter(columns.unpack(box, lengths))
    residuals = [[next(flat) for _ in layout.columns] for _, layout in layouts]
    return [_restore(part, layouts, residuals) for part in parts]


def _layout(key: Key, parts: Sequence[Frames], split: Sequence[tuple[dict[Key, Rows], Rows]]) -> PayloadLayout:
    """Found on the frames of one message in all parts."""
    own = [part[messages[key]] for part, (messages, _) in zip(parts, split, strict=True) if key in messages]
    return message.describe(own)


def _messages(frames: Frames) -> tuple[dict[Key, Rows], Rows]:
    """Rows of each message that repays a description, by identifier and length; and all other rows."""
    n, width = len(frames), frames.data.shape[1]
    everything = np.arange(n)
    if n < _MIN_FRAMES or int(frames.time_ns.max()) - int(frames.time_ns.min()) >= message.MAX_SPAN_NS:
        return {}, everything
    code = frames.can_id.astype(np.uint64) << np.uint64(8) | frames.length
    names, place, count = np.unique(code, return_inverse=True, return_counts=True)
    large = [i for i in range(len(names)) if count[i] >= _MIN_FRAMES and int(names[i]) & 0xFF <= width]
    found = {(int(names[i]) >> 8, int(names[i]) & 0xFF): np.flatnonzero(place == i) for i in large}
    return found, np.flatnonzero(~np.isin(place, large))


def _pack_part(
    head: ByteWriter,
    residuals: dict[Key, Residuals],
    frames: Frames,
    messages: dict[Key, Rows],
    layouts: dict[Key, PayloadLayout],
) -> None:
    known = list(layouts)
    head.count(frames.data.shape[1], len(messages))
    for key, rows in messages.items():
        head.count(known.index(key))
        for column, own in zip(residuals[key], message.pack(head, frames[rows], layouts[key]), strict=True):
            column.append(own)
    packed = np.concatenate([np.zeros(0, np.int64), *messages.values()])
    rest = np.setdiff1d(np.arange(len(frames)), packed)
    _write_stragglers(head, frames[rest])
    _write_order(head, frames, [*messages.values(), rest])


@dataclass(frozen=True, slots=True, eq=False)
class _PackedPart:
    """One part as the head tells it; begun: message number and start of each; order: message of each frame, or None."""

    width: int
    begun: tuple[tuple[int, MessageHeader], ...]
    stragglers: Frames
    order: NDArray[np.uint8] | None


def _read_part(head: ByteReader, layouts: Sequence[tuple[Key, PayloadLayout]]) -> _PackedPart:
    width, number = head.count(), head.count()
    begun = []
    for _ in range(number):
        which = head.count()
        begun.append((which, message.read(head, layouts[which][1])))
    stragglers = _read_stragglers(head, width)
    total = sum(b.n for _, b in begun) + len(stragglers)
    order = np.frombuffer(head.take(total), np.uint8) if head.count() else None
    return _PackedPart(width, tuple(begun), stragglers, order)


def _restore(
    part: _PackedPart, layouts: Sequence[tuple[Key, PayloadLayout]], residuals: list[list[NDArray[np.uint64]]]
) -> Frames:
    """The frames of one part; takes what belongs to it off the front of what is left."""
    found = []
    for which, begun in part.begun:
        own = [column[: begun.n] for column in residuals[which]]
        residuals[which] = [column[begun.n :] for column in residuals[which]]
        found.append(message.unpack_frames(begun, *layouts[which], own))
    joined = Frames.join([*found, part.stragglers])
    whole = replace(joined, data=message.of_width(joined.data, part.width))
    if part.order is None:
        return whole[np.argsort(whole.time_ns, kind="stable")]
    return whole[np.argsort(np.argsort(part.order, kind="stable"), kind="stable")]


def _write_stragglers(out: ByteWriter, frames: Frames) -> None:
    """Column by column, the time as differences, byte planes together: zstd does the rest."""
    out.count(len(frames))
    change = np.diff(frames.time_ns, prepend=np.int64(0)).astype("<i8")
    out.out += change.view(np.uint8).reshape(-1, 8).T.tobytes()
    out.out += frames.can_id.astype("<u4").tobytes() + frames.length.tobytes() + frames.data.T.tobytes()


def _read_stragglers(head: ByteReader, width: int) -> Frames:
    n = head.count()
    planes = np.frombuffer(head.take(8 * n), np.uint8).reshape(8, n)
    change = np.ascontiguousarray(planes.T).view("<i8").reshape(n).astype(np.int64)
    can_id = np.frombuffer(head.take(4 * n), "<u4").astype(np.uint32)
    length = np.frombuffer(head.take(n), np.uint8).copy()
    data = np.frombuffer(head.take(width * n), np.uint8).reshape(width, n).T.copy()
    return Frames(np.cumsum(change), can_id, length, data)


def _write_order(out: ByteWriter, frames: Frames, groups: Sequence[Rows]) -> None:
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


def _wrap_head(head: bytes) -> ByteWriter:
    packed = columns.compress(head)
    shorter = len(packed) < len(head)
    box = ByteWriter()
    box.count(_PACKED if shorter else _AS_IS)
    box.string(packed if shorter else head)
    return box


def _unwrap_head(box: ByteReader) -> ByteReader:
    form, head = box.count(), box.string()
    if form not in (_AS_IS, _PACKED):
        raise LogError("frames-of-unknown-format")
    return ByteReader(columns.decompress(head) if form == _PACKED else head)
