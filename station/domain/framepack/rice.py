"""Rice codes for whole tables of small whole numbers.

R. F. Rice, "Some practical universal noiseless coding techniques", JPL 79-22 (1979): u is written as u >> k in
unary and the low k bits as they are. Near the entropy for noise, and it needs no table.
"""

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]

#: A quotient this long means an outlier: it is cut here and the value is kept whole beside the bits.
_CUT = 24
_ONE = np.uint64(1)


def best_k(u: Words) -> NDArray[np.uint8]:
    """Number of low bits for each column of u (n, m): about the logarithm of the mean, 0 where that is below 1."""
    mean = np.minimum(u, np.uint64(1 << 40)).mean(axis=0)
    return np.asarray(np.ceil(np.log2(np.maximum(mean * 0.72, 1.0))), np.uint8)


def pack(u: Words, k: NDArray[np.uint8]) -> tuple[bytes, bytes, Words]:
    """u (n, m), k (m) → unary bits column by column, low bits row by row, outliers in the order of the unary bits."""
    quotient = np.ascontiguousarray((u >> k.astype(np.uint64)).T).ravel()
    outlying = quotient >= _CUT
    outliers = np.ascontiguousarray(u.T).ravel()[outlying]
    ends = np.cumsum(np.minimum(quotient, np.uint64(_CUT)).astype(np.int64) + 1)
    unary = np.zeros(ends[-1] if len(ends) else 0, np.uint8)
    unary[ends - 1] = 1
    column, shift = _low_bits(k)
    low = (u[:, column] >> shift & _ONE).astype(np.uint8)
    return np.packbits(unary).tobytes(), np.packbits(low).tobytes(), outliers


def low_size(n: int, k: NDArray[np.uint8]) -> int:
    """Bytes that the low bits of n rows take."""
    return (n * int(k.sum()) + 7) // 8


def unpack(unary: bytes, low: bytes, outliers: Words, n: int, k: NDArray[np.uint8]) -> Words:
    """The inverse of `pack`: u (n, m)."""
    m = len(k)
    ends = np.flatnonzero(np.unpackbits(np.frombuffer(unary, np.uint8)))[: n * m]
    quotient = np.diff(ends, prepend=-1) - 1
    column, shift = _low_bits(k)
    bits = np.unpackbits(np.frombuffer(low, np.uint8))[: n * len(column)].reshape(n, len(column))
    u = quotient.astype(np.uint64).reshape(m, n).T << k.astype(np.uint64)
    for j, s, bit in zip(column, shift, bits.T, strict=True):
        u[:, j] |= bit.astype(np.uint64) << s
    flat = np.ascontiguousarray(u.T).ravel()
    flat[quotient == _CUT] = outliers
    return flat.reshape(m, n).T


def _low_bits(k: NDArray[np.uint8]) -> tuple[NDArray[np.int64], Words]:
    """For each low bit of a row: its column and its place, the highest first."""
    column = np.repeat(np.arange(len(k)), k)
    place = np.concatenate([np.arange(int(width))[::-1] for width in k]) if len(k) else np.zeros(0)
    return column, place.astype(np.uint64)
