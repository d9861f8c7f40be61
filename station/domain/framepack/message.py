"""The frames of one message (one identifier, one length) as bytes, and back."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station.domain.framepack import predict, rice
from station.domain.framepack.bytestream import Reader, Writer
from station.domain.framepack.layout import Layout, find, words
from station.domain.framepack.parity import Parity
from station.domain.types import Frames

Table = NDArray[np.int64]

#: Identifier and length of a message.
Key = tuple[int, int]

#: Time stamps that span more than this (19 hours in ns) are not foretold; such frames are kept plainly.
LONGEST_NS = 1 << 46

_NO_PARITY = 0xFF

#: On how many parts of an attempt, and frames of each, a description is tried.
_TRIED_PARTS, _TRIED_ROWS = 8, 256


def describe(parts: Sequence[Frames]) -> Layout:
    """The layout that suits one message, of which each part holds at least one frame.

    Bytes beyond the message's length are described only where one of them is not zero.
    """
    length, widest = int(parts[0].length[0]), max(p.data.shape[1] for p in parts)
    width = widest if any(p.data[:, length:].any() for p in parts) else length
    tried = [part[:_TRIED_ROWS] for part in parts[:: max(1, len(parts) // _TRIED_PARTS)]]
    samples = [of_width(part.data, width) for part in tried]
    return find(of_width(Frames.join(list(parts)).data, width), samples, [ticks_of(part)[0] for part in tried])


def ticks_of(frames: Frames) -> tuple[Table, int]:
    """Time stamps since the first (n) in ticks, and the longest tick that divides them all, ns."""
    since = frames.time_ns - frames.time_ns[0]
    tick = int(np.gcd.reduce(since)) or 1
    return since // tick, tick


def pack(out: Writer, low: list[bytes], frames: Frames, layout: Layout) -> None:
    """Writes the frames: description and unary bits to `out`, incompressible low bits to `low`."""
    ticks, tick = ticks_of(frames)
    data = of_width(frames.data, layout.width)
    first = data[0].copy()
    if layout.parity is not None:
        data = data.copy()
        data[:, layout.parity.byte] ^= _foretold(layout.parity, data, first)
    out.count(len(frames), tick)
    out.whole(int(frames.time_ns[0]))
    out.out += first.tobytes()
    columns = np.column_stack([ticks, layout.fields(data)])
    u = _residuals(out, columns, (layout.time, *layout.models))
    used = u.any(axis=0)
    kept = u[:, used]
    k = rice.best_k(kept)
    out.string(np.packbits(used).tobytes())
    out.out += k.tobytes()
    unary, low_bits, outliers = rice.pack(kept, k)
    out.string(unary)
    out.count(len(outliers), *outliers.tolist())
    low.append(low_bits)


def unpack(data: Reader, low: Reader, key: Key, layout: Layout) -> Frames:
    """The inverse of `pack`: frames of this identifier and length."""
    n, tick = data.count(), data.count()
    start = data.whole()
    first = np.frombuffer(data.take(layout.width), np.uint8)
    models = (layout.time, *layout.models)
    parameters = [[data.whole() for _ in range(predict.PARAMETERS[m])] for m in models]
    used = np.unpackbits(np.frombuffer(data.string(), np.uint8))[: len(models)].astype(bool)
    k = np.frombuffer(data.take(int(used.sum())), np.uint8)
    unary = data.string()
    outliers = np.array([data.count() for _ in range(data.count())], np.uint64)
    u = np.zeros((n, len(models)), np.uint64)
    u[:, used] = rice.unpack(unary, low.take(rice.low_size(n, k)), outliers, n, k)
    residuals = predict.unzigzag(u).T
    columns = [predict.backward(r, m, p) for r, m, p in zip(residuals, models, parameters, strict=True)]
    payload = _payload(layout, np.column_stack(columns[1:]) if columns[1:] else np.zeros((n, 0), np.int64), first)
    can_id, length = np.full(n, key[0], np.uint32), np.full(n, key[1], np.uint8)
    return Frames(start + columns[0] * tick, can_id, length, payload)


def of_width(data: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Payloads cut, or filled with zeros, to a width."""
    if data.shape[1] >= width:
        return np.ascontiguousarray(data[:, :width])
    return np.pad(data, ((0, 0), (0, width - data.shape[1])))


def _payload(layout: Layout, fields: Table, first: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if layout.parity is None:
        return layout.payload(fields, first)
    start = first.copy()
    start[layout.parity.byte] = 0
    payload = layout.payload(fields, start)
    payload[:, layout.parity.byte] ^= _foretold(layout.parity, payload, first)
    return payload


def _foretold(parity: Parity, data: NDArray[np.uint8], first: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return parity.predict(words(data), int(words(first[None, :])[0]))


def _residuals(out: Writer, columns: Table, models: Sequence[int]) -> NDArray[np.uint64]:
    residuals = []
    for column, model in zip(columns.T, models, strict=True):
        residual, parameters = predict.forward(column, model)
        residuals.append(residual)
        out.whole(*parameters)
    return predict.zigzag(np.stack(residuals, axis=1))


def write_layout(out: Writer, key: Key, layout: Layout) -> None:
    """The description of a message, to stand before all its frames."""
    out.count(*key)
    out.count(layout.width, layout.time, len(layout.kinds))
    out.out += bytes(kind << 4 | model for kind, model in zip(layout.kinds, layout.models, strict=True))
    if layout.parity is None:
        out.out.append(_NO_PARITY)
    else:
        out.out += layout.parity.to_bytes()


def read_layout(data: Reader) -> tuple[Key, Layout]:
    """The inverse of `write_layout`."""
    key = data.count(), data.count()
    width, time, number = data.count(), data.count(), data.count()
    fields = data.take(number)
    parity = None
    if data.data[data.at] == _NO_PARITY:
        data.at += 1
    else:
        parity, data.at = Parity.from_bytes(data.data, data.at)
    return key, Layout(width, tuple(f >> 4 for f in fields), tuple(f & 0xF for f in fields), time, parity)
