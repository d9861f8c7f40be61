"""How the bytes of one message fall into numbers: found from the frames themselves, for no DBC need be at hand."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.framepack import parity
from station.domain.framepack.predict import cheapest, cost_bits

Table = NDArray[np.int64]

#: Kinds of field: an unsigned byte's change, and a 16-bit word's, low or high byte first.
BYTE, LITTLE, BIG = 0, 1, 2
_WIDTH = {BYTE: 1, LITTLE: 2, BIG: 2}

#: Fewer frames than this do not repay the description of a parity.
_ENOUGH = 100


@dataclass(frozen=True, slots=True)
class Layout:
    """Fields in the order of the bytes: their kinds, and how each is foretold; the parity byte, if one is.

    time: how the time stamps are foretold. width: bytes of payload that are described.
    """

    width: int
    kinds: tuple[int, ...]
    models: tuple[int, ...]
    time: int
    parity: parity.Parity | None

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


def words(data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Payloads of up to 8 bytes as little-endian words (n)."""
    whole = np.zeros((len(data), 8), np.uint8)
    whole[:, : data.shape[1]] = data
    return whole.view("<u8")[:, 0].astype(np.uint64)


def find(data: NDArray[np.uint8], ticks: Table) -> Layout:
    """The layout of payloads (n, width) and time stamps (n) with the fewest bits.

    Parity byte first, then the best way to cut the rest into fields.
    """
    checked = _find_parity(data)
    if checked is not None:
        data = data.copy()
        data[:, checked.byte] = 0
    kinds, models = _cut(data)
    time = int(cheapest(ticks[:, None])[0])
    return Layout(data.shape[1], kinds, models, time, checked)


def _find_parity(data: NDArray[np.uint8]) -> parity.Parity | None:
    """The parity of the byte that saves most: that whose value is hardest to foretell."""
    if len(data) < _ENOUGH or not 1 < data.shape[1] <= 8:
        return None
    costs = [_best(data, at, BYTE)[0] for at in range(data.shape[1])]
    word = words(data)
    for byte in sorted(range(len(costs)), key=lambda b: -costs[b]):
        if costs[byte] < 2 * _ENOUGH * 8:
            return None
        found = parity.find(word, byte)
        if found is not None:
            return found
    return None


def _cut(data: NDArray[np.uint8]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The cheapest row of fields, by dynamic programming over the bytes."""
    width = data.shape[1]
    best: list[tuple[float, tuple[int, ...], tuple[int, ...]]] = [(0.0, (), ())]
    for end in range(1, width + 1):
        options = []
        for kind, size in _WIDTH.items():
            if size <= end:
                bits, model = _best(data, end - size, kind)
                before = best[end - size]
                options.append((before[0] + bits, (*before[1], kind), (*before[2], model)))
        best.append(min(options))
    return best[width][1], best[width][2]


def _best(data: NDArray[np.uint8], at: int, kind: int) -> tuple[float, int]:
    column = _field(data, at, kind)[:, None]
    model = int(cheapest(column)[0])
    return float(cost_bits(column, np.array([model]))[0]), model


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
