"""How the bytes of one message fall into numbers: found from the frames themselves, for no DBC need be at hand."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.records.framepack import parity
from station.domain.records.framepack.predict import cheapest

Table = NDArray[np.int64]

#: Kinds of field: an unsigned byte's change, and a 16-bit word's, low or high byte first.
BYTE, LITTLE, BIG = 0, 1, 2
_WIDTH = {BYTE: 1, LITTLE: 2, BIG: 2}

#: About what the description of a parity takes, in bits.
_PARITY_BITS = 400


@dataclass(frozen=True, slots=True)
class PayloadLayout:
    """Fields in the order of the bytes: their kinds, and how each is foretold; the parity byte, if one is.

    time: how the time stamps are foretold. width: bytes of payload that are described.
    """

    width: int
    kinds: tuple[int, ...]
    models: tuple[int, ...]
    time: int
    parity: parity.Parity | None

    @property
    def columns(self) -> tuple[int, ...]:
        """How each column is foretold: the time stamps, then the fields."""
        return self.time, *self.models

    def fields(self, data: NDArray[np.uint8]) -> Table:
        """Payloads (n, width) → fields (n, f) as differences from the first row, that of 16 bits in [-2¹⁵, 2¹⁵)."""
        rows, at = [], 0
        for kind in self.kinds:
            rows.append(_field(data, at, kind))
            at += _WIDTH[kind]
        return np.stack(rows, axis=1) if rows else np.zeros((len(data), 0), np.int64)

    def payload(self, fields: Table, first: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The inverse of `fields`, from the first row of payload."""
        data, at = np.zeros((len(fields), self.width), np.uint8), 0
        for kind, column in zip(self.kinds, fields.T, strict=True):
            start = _word(first[None, :], at, kind)[0]
            word = (column + int(start)).astype(np.uint16)
            low, high = (at, at + 1) if kind == LITTLE else (at + 1, at)
            if kind == BYTE:
                data[:, at] = word
            else:
                data[:, low], data[:, high] = word & 0xFF, word >> 8
            at += _WIDTH[kind]
        return data


def payload_words(data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Payloads of up to 8 bytes as little-endian words (n)."""
    whole = np.zeros((len(data), 8), np.uint8)
    whole[:, : data.shape[1]] = data
    return whole.view("<u8")[:, 0].astype(np.uint64)


def find_layout(
    everything: NDArray[np.uint8], samples: Sequence[NDArray[np.uint8]], ticks: Sequence[Table]
) -> PayloadLayout:
    """The layout with the fewest bits of one message's payloads.

    The parity must hold for `everything` (N, width) or, should a frame be corrupt there, for the first sample. How
    the rest is cut and foretold is tried on samples (n, width) of consecutive frames, ticks (n) their time stamps.
    """
    checked = _find_parity(everything, samples[0]) or _find_parity(samples[0], samples[0])
    if checked is not None:
        samples = [data.copy() for data in samples]
        for data in samples:
            data[:, checked.byte] = 0
    kinds, models = _split_fields(samples)
    return PayloadLayout(everything.shape[1], kinds, models, cheapest(ticks)[1], checked)


def _find_parity(everything: NDArray[np.uint8], sample: NDArray[np.uint8]) -> parity.Parity | None:
    """The parity of the byte that saves most: that with the greatest entropy, for a CRC has no pattern of its own."""
    if len(sample) < 2 or not 1 < sample.shape[1] <= 8:
        return None
    entropies = [_entropy_bits(column) for column in sample.T]
    for byte in sorted(range(len(entropies)), key=lambda b: -entropies[b]):
        if entropies[byte] * len(everything) < _PARITY_BITS:
            return None
        found = parity.find_parity(payload_words(everything), byte)
        if found is not None:
            return found
    return None


def _entropy_bits(column: NDArray[np.uint8]) -> float:
    """Shannon entropy of one byte of a column (n)."""
    share = np.bincount(column) / len(column)
    share = share[share > 0]
    return float(-(share * np.log2(share)).sum())


def _split_fields(samples: Sequence[NDArray[np.uint8]]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The cheapest row of fields and their models, by dynamic programming over the bytes."""
    best: list[tuple[float, tuple[int, ...], tuple[int, ...]]] = [(0.0, (), ())]
    for end in range(1, samples[0].shape[1] + 1):
        options = []
        for kind, size in _WIDTH.items():
            if size <= end:
                bits, model = cheapest([_field(data, end - size, kind) for data in samples])
                before = best[end - size]
                options.append((before[0] + bits, (*before[1], kind), (*before[2], model)))
        best.append(min(options))
    return best[-1][1], best[-1][2]


def _field(data: NDArray[np.uint8], at: int, kind: int) -> Table:
    word = _word(data, at, kind)
    if kind == BYTE:
        return word.astype(np.int64) - int(word[0])
    return np.asarray((word - word[0]).view(np.int16), np.int64)


def _word(data: NDArray[np.uint8], at: int, kind: int) -> NDArray[np.uint16]:
    if kind == BYTE:
        return data[:, at].astype(np.uint16)
    low, high = (at, at + 1) if kind == LITTLE else (at + 1, at)
    return data[:, low] | data[:, high].astype(np.uint16) << np.uint16(8)
