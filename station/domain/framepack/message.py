"""The frames of one message (one identifier, one length) as bytes, and back."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station.domain.framepack import predict, rice
from station.domain.framepack.bytestream import Reader, Writer
from station.domain.framepack.layout import Layout, words
from station.domain.framepack.parity import Parity
from station.domain.types import Frames

Table = NDArray[np.int64]

#: Time stamps that span more than this (19 hours in ns) are not foretold; such frames are kept plainly.
LONGEST_NS = 1 << 46

_NO_PARITY = 0xFF


def width_of(frames: Frames) -> int:
    """Bytes of payload to describe: the message's length, or all where one beyond it is not zero."""
    length = int(frames.length[0])
    return frames.data.shape[1] if frames.data[:, length:].any() else length


def ticks_of(frames: Frames) -> tuple[Table, int]:
    """Time stamps since the first (n) in ticks, and the longest tick that divides them all, ns."""
    since = frames.time_ns - frames.time_ns[0]
    tick = int(np.gcd.reduce(since)) or 1
    return since // tick, tick


def pack(out: Writer, low: list[bytes], frames: Frames, layout: Layout) -> None:
    """Writes the frames: description and unary bits to `out`, incompressible low bits to `low`."""
    ticks, tick = ticks_of(frames)
    data = np.ascontiguousarray(frames.data[:, : layout.width])
    if layout.parity is not None:
        data = data.copy()
        data[:, layout.parity.byte] ^= layout.parity.predict(words(data))
    out.count(int(frames.can_id[0]), int(frames.length[0]), len(frames), tick)
    out.whole(int(frames.time_ns[0]))
    _write_layout(out, layout)
    out.out += data[0].tobytes()
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


def unpack(data: Reader, low: Reader, data_width: int) -> Frames:
    """The inverse of `pack`: the frames, payloads zero-filled to `data_width`."""
    can_id, length, n, tick = (data.count() for _ in range(4))
    start = data.whole()
    layout = _read_layout(data)
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
    whole = np.pad(payload, ((0, 0), (0, data_width - layout.width)))
    return Frames(start + columns[0] * tick, np.full(n, can_id, np.uint32), np.full(n, length, np.uint8), whole)


def _payload(layout: Layout, fields: Table, first: NDArray[np.uint8]) -> NDArray[np.uint8]:
    payload = layout.payload(fields, first)
    if layout.parity is not None:
        payload[:, layout.parity.byte] ^= layout.parity.predict(words(payload))
    return payload


def _residuals(out: Writer, columns: Table, models: Sequence[int]) -> NDArray[np.uint64]:
    residuals = []
    for column, model in zip(columns.T, models, strict=True):
        residual, parameters = predict.forward(column, model)
        residuals.append(residual)
        out.whole(*parameters)
    return predict.zigzag(np.stack(residuals, axis=1))


def _write_layout(out: Writer, layout: Layout) -> None:
    out.count(layout.width, layout.time, len(layout.kinds))
    out.out += bytes(kind << 4 | model for kind, model in zip(layout.kinds, layout.models, strict=True))
    if layout.parity is None:
        out.out.append(_NO_PARITY)
    else:
        out.out += layout.parity.to_bytes()


def _read_layout(data: Reader) -> Layout:
    width, time, number = data.count(), data.count(), data.count()
    fields = data.take(number)
    parity = None
    if data.data[data.at] == _NO_PARITY:
        data.at += 1
    else:
        parity, data.at = Parity.from_bytes(data.data, data.at)
    return Layout(width, tuple(f >> 4 for f in fields), tuple(f & 0xF for f in fields), time, parity)
