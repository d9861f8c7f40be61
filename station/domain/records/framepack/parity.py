"""Finds a byte that the other bytes of a frame determine, such as a CRC, without knowing its polynomial.

Every CRC is an affine function of the bits over GF(2). So the differences of frames span a subspace; if its reduced
basis (Gauss–Jordan) has no pivot in a byte, that byte follows from the pivots, for all frames at hand.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]

#: Frames from which a basis is started; those that do not fit join it.
_SAMPLE = 160


@dataclass(frozen=True, slots=True)
class Parity:
    """byte: which one; rows: for each of its bits, low bit first, the mask of bits whose parity it changes with."""

    byte: int
    rows: tuple[int, ...]

    def predict(self, words: Words, first: int) -> NDArray[np.uint8]:
        """What the byte ought to be (n), from the other bytes of words (n) and one whole frame, `first`."""
        changed = words ^ np.uint64(first)
        value = np.zeros(len(words), np.uint8)
        for place, mask in enumerate(self.rows):
            odd = np.bitwise_count(changed & np.uint64(mask)) & np.uint8(1)
            value |= odd << np.uint8(place)
        return value ^ np.uint8(first >> 8 * self.byte & 0xFF)

    def to_bytes(self) -> bytes:
        """byte, the union of the masks, and each mask as bits of that union."""
        bits = _bits(self._union())
        packed = [sum((row >> b & 1) << i for i, b in enumerate(bits)) for row in self.rows]
        width = (len(bits) + 7) // 8
        head = bytes([self.byte]) + self._union().to_bytes(8, "little")
        return head + b"".join(p.to_bytes(width, "little") for p in packed)

    @classmethod
    def from_bytes(cls, data: bytes, at: int) -> tuple[Self, int]:
        """The inverse, from `at` on, and where the next thing begins."""
        bits = _bits(int.from_bytes(data[at + 1 : at + 9], "little"))
        width, rows_at = (len(bits) + 7) // 8, at + 9
        packed = [int.from_bytes(data[rows_at + i * width : rows_at + (i + 1) * width], "little") for i in range(8)]
        rows = tuple(sum((p >> i & 1) << b for i, b in enumerate(bits)) for p in packed)
        return cls(data[at], rows), rows_at + 8 * width

    def _union(self) -> int:
        union = 0
        for row in self.rows:
            union |= row
        return union


def find_parity(words: Words, byte: int) -> Parity | None:
    """How `byte` follows from the others in every frame of words (n), or None where it does not."""
    first = int(words[0])
    keep = ~(0xFF << 8 * byte) & (1 << 64) - 1
    basis: dict[int, int] = {}
    remaining = words[:: max(1, len(words) // _SAMPLE)]
    while len(remaining):
        for word in remaining[:_SAMPLE].tolist():
            if not _add(basis, word ^ first, keep):
                return None
        parity = Parity(byte, tuple(_mask(basis, 8 * byte + i) for i in range(8)))
        wrong = parity.predict(words, first) != (words >> np.uint64(8 * byte)).astype(np.uint8)
        remaining = words[wrong]
    return parity


def _add(basis: dict[int, int], word: int, keep: int) -> bool:
    """Brings a word into the reduced basis (pivot bit → vector); False when only the byte itself is left of it."""
    for pivot, vector in basis.items():
        if word >> pivot & 1:
            word ^= vector
    if word & keep == 0:
        return word == 0
    pivot = (word & keep).bit_length() - 1
    for other, vector in basis.items():
        if vector >> pivot & 1:
            basis[other] = vector ^ word
    basis[pivot] = word
    return True


def _mask(basis: dict[int, int], bit: int) -> int:
    return sum(1 << pivot for pivot, vector in basis.items() if vector >> bit & 1)


def _bits(mask: int) -> list[int]:
    return [i for i in range(64) if mask >> i & 1]
