"""Columns of small whole numbers ↔ bytes: byte planes, least significant first, compressed by zstd.

What is left of a foretold column is noise, whose entropy zstd's Huffman code comes near to, or nothing at all.
"""

from collections.abc import Sequence

import numpy as np
import zstandard
from numpy.typing import NDArray

from station.domain.records.framepack.bytestream import ByteReader, ByteWriter
from station.errors import LogError

Words = NDArray[np.uint64]

_LEVEL = 9

#: No attempt comes near to this; what says it does is damaged.
MAX_BYTES = 1 << 29

#: How columns stand: each compressed by itself (noise), or all in a row (a recorded drive repeats itself).
_SEPARATE, _JOINT = 0, 1


def pack(out: ByteWriter, columns: Sequence[Words]) -> None:
    """Writes columns of any lengths, whichever way is shorter."""
    planes = [_planes(column) for column in columns]
    out.count(*(len(p) // max(len(c), 1) for p, c in zip(planes, columns, strict=True)))
    each, together = ByteWriter(), ByteWriter()
    for plane in planes:
        if plane:
            each.string(compress(plane))
    together.string(compress(b"".join(planes)))
    shorter = _JOINT if len(together.out) < len(each.out) else _SEPARATE
    out.count(shorter)
    out.out += together.out if shorter == _JOINT else each.out


def unpack(data: ByteReader, lengths: Sequence[int]) -> list[Words]:
    """The inverse: columns of these lengths. Errors: LogError."""
    widths = [data.count() for _ in lengths]
    sizes = [width * length for width, length in zip(widths, lengths, strict=True)]
    if data.count() == _JOINT:
        whole = ByteReader(decompress(data.string()))
        planes = [whole.take(size) for size in sizes]
    else:
        planes = [decompress(data.string()) if size else b"" for size in sizes]
    return [_column(p, width, n) for p, width, n in zip(planes, widths, lengths, strict=True)]


def compress(data: bytes) -> bytes:
    """Compressed by zstd."""
    return zstandard.ZstdCompressor(level=_LEVEL).compress(data)


def decompress(data: bytes) -> bytes:
    """The inverse. Errors: LogError."""
    try:
        if zstandard.frame_content_size(data) > MAX_BYTES:
            raise _damaged()
        return zstandard.ZstdDecompressor().decompress(data)
    except zstandard.ZstdError as exc:
        raise _damaged() from exc


def _planes(column: Words) -> bytes:
    width = (int(column.max(initial=0)).bit_length() + 7) // 8
    return column.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T.tobytes()


def _column(planes: bytes, width: int, n: int) -> Words:
    if len(planes) != width * n or width > 8:
        raise _damaged()
    whole = np.zeros((n, 8), np.uint8)
    whole[:, :width] = np.frombuffer(planes, np.uint8).reshape(width, n).T
    return whole.view("<u8")[:, 0].astype(np.uint64)


def _damaged() -> LogError:
    return LogError("frames-damaged")
