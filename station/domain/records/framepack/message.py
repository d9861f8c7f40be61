"""The frames of one message (one identifier, one length) as bytes, and back."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Frames
from station.domain.records.framepack import predict
from station.domain.records.framepack.bytestream import ByteReader, ByteWriter
from station.domain.records.framepack.layout import PayloadLayout, find_layout, payload_words
from station.domain.records.framepack.parity import Parity

Table = NDArray[np.int64]
Words = NDArray[np.uint64]

#: Identifier and length of a message.
Key = tuple[int, int]

#: Time stamps that span more than this (19 hours in ns) are not foretold; such frames are kept plainly.
MAX_SPAN_NS = 1 << 46

_NO_PARITY = 0xFF

#: On how many parts of an attempt, and frames of each, a description is tried.
_TRIED_PARTS, _TRIED_ROWS = 8, 256


def describe(parts: Sequence[Frames]) -> PayloadLayout:
    """The layout that suits one message, of which each part holds at least one frame.

    Bytes beyond the message's length are described only where one of them is not zero.
    """
    length, widest = int(parts[0].length[0]), max(p.data.shape[1] for p in parts)
    width = widest if any(p.data[:, length:].any() for p in parts) else length
    tried = [part[:_TRIED_ROWS] for part in parts[:: max(1, len(parts) // _TRIED_PARTS)]]
    samples = [of_width(part.data, width) for part in tried]
    return find_layout(of_width(Frames.join(list(parts)).data, width), samples, [ticks_of(part)[0] for part in tried])


def ticks_of(frames: Frames) -> tuple[Table, int]:
    """Time stamps since the first (n) in ticks, and the longest tick that divides them all, ns."""
    since = frames.time_ns - frames.time_ns[0]
    tick = int(np.gcd.reduce(since)) or 1
    return since // tick, tick


def pack(out: ByteWriter, frames: Frames, layout: PayloadLayout) -> list[Words]:
    """Writes what the frames start from to `out`; gives what is left of each column: time, then the fields."""
    ticks, tick = ticks_of(frames)
    data = of_width(frames.data, layout.width)
    first = data[0].copy()
    if layout.parity is not None:
        data = data.copy()
        data[:, layout.parity.byte] ^= _predicted_parity(layout.parity, data, first)
    out.count(len(frames), tick)
    out.whole(int(frames.time_ns[0]))
    out.out += first.tobytes()
    remainders = []
    for column, model in zip((ticks, *layout.fields(data).T), layout.columns, strict=True):
        residual, parameters = predict.residuals(column, model)
        remainders.append(predict.zigzag(residual))
        out.whole(*parameters)
    return remainders


@dataclass(frozen=True, slots=True)
class MessageHeader:
    """What `pack` wrote of one part's frames: their number, tick, start, first payload and the models' parameters."""

    n: int
    tick: int
    start_ns: int
    first: bytes
    parameters: tuple[tuple[int, ...], ...]


def read(data: ByteReader, layout: PayloadLayout) -> MessageHeader:
    """The inverse of what `pack` writes."""
    n, tick, start = data.count(), data.count(), data.whole()
    first = data.take(layout.width)
    parameters = tuple(tuple(data.whole() for _ in range(predict.PARAMETERS[m])) for m in layout.columns)
    return MessageHeader(n, tick, start, first, parameters)


def unpack_frames(begun: MessageHeader, key: Key, layout: PayloadLayout, residuals: Sequence[Words]) -> Frames:
    """The frames of this identifier and length, from what `pack` wrote and gave."""
    leftovers = zip(residuals, layout.columns, begun.parameters, strict=True)
    time, *fields = [predict.backward(predict.unzigzag(u), model, list(values)) for u, model, values in leftovers]
    table = np.column_stack(fields) if fields else np.zeros((begun.n, 0), np.int64)
    payload = _payload(layout, table, np.frombuffer(begun.first, np.uint8))
    can_id, length = np.full(begun.n, key[0], np.uint32), np.full(begun.n, key[1], np.uint8)
    return Frames(begun.start_ns + time * begun.tick, can_id, length, payload)


def of_width(data: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Payloads cut, or filled with zeros, to a width."""
    if data.shape[1] >= width:
        return np.ascontiguousarray(data[:, :width])
    return np.pad(data, ((0, 0), (0, width - data.shape[1])))


def _payload(layout: PayloadLayout, fields: Table, first: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if layout.parity is None:
        return layout.payload(fields, first)
    start = first.copy()
    start[layout.parity.byte] = 0
    payload = layout.payload(fields, start)
    payload[:, layout.parity.byte] ^= _predicted_parity(layout.parity, payload, first)
    return payload


def _predicted_parity(parity: Parity, data: NDArray[np.uint8], first: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return parity.predict(payload_words(data), int(payload_words(first[None, :])[0]))


def write_layout(out: ByteWriter, key: Key, layout: PayloadLayout) -> None:
    """The description of a message, to stand before all its frames."""
    out.count(*key)
    out.count(layout.width, layout.time, len(layout.kinds))
    out.out += bytes(kind << 4 | model for kind, model in zip(layout.kinds, layout.models, strict=True))
    if layout.parity is None:
        out.out.append(_NO_PARITY)
    else:
        out.out += layout.parity.to_bytes()


def read_layout(data: ByteReader) -> tuple[Key, PayloadLayout]:
    """The inverse of `write_layout`."""
    key = data.count(), data.count()
    width, time, number = data.count(), data.count(), data.count()
    fields = data.take(number)
    parity = None
    if data.data[data.at] == _NO_PARITY:
        data.at += 1
    else:
        parity, data.at = Parity.from_bytes(data.data, data.at)
    return key, PayloadLayout(width, tuple(f >> 4 for f in fields), tuple(f & 0xF for f in fields), time, parity)
