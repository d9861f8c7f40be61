"""Signals in CAN payloads: bulk numpy decoding of what a DBC can describe. No Python runs per frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Frames
from station.errors import ProductError


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Where a signal lies and what it means: physical = raw · scale + offset, in `unit`.

    start: the DBC's own start bit (least significant bit of a little-endian signal, most significant one, counted
    in the saw-tooth way, of a big-endian one); length in bits; minimum, maximum: physical, None where the DBC
    sets none; selector, selected_by: the multiplexer's name and its values for which this signal is present.
    """

    name: str
    start: int
    length: int
    big_endian: bool = False
    signed: bool = False
    is_float: bool = False
    scale: int | float = 1
    offset: int | float = 0
    minimum: int | float | None = None
    maximum: int | float | None = None
    unit: str = ""
    selector: str | None = None
    selected_by: tuple[int, ...] = ()

    @property
    def first_bit(self) -> int:
        """Bit offset from the payload's first bit, in the signal's own bit order."""
        return 8 * (self.start // 8) + 7 - self.start % 8 if self.big_endian else self.start

    def raw_limits(self) -> tuple[int, int]:
        """Least and greatest raw integer."""
        if self.signed:
            return -(1 << (self.length - 1)), (1 << (self.length - 1)) - 1
        return 0, (1 << self.length) - 1


@dataclass(frozen=True, slots=True)
class FrameLayout:
    """One message: can_id with the kernel's EXTENDED flag, length in bytes, signals in the DBC's order."""

    name: str
    can_id: int
    length: int
    signals: tuple[SignalLayout, ...]

    def signal(self, name: str) -> SignalLayout:
        """The signal of that name; ProductError lists the known ones."""
        for signal in self.signals:
            if signal.name == name:
                return signal
        known = tuple(s.name for s in self.signals)
        raise ProductError("signal-unknown", message=self.name, signal=name, known=known)


@dataclass(frozen=True, slots=True, eq=False)
class DecodedMessage:
    """Frames of one message, decoded.

    rows (m): their places in the frames given; values: physical values (m) of each signal; present: mask (m) of
    each multiplexed signal, whose values mean nothing where it is False.
    """

    rows: NDArray[np.intp]
    values: Mapping[str, Array]
    present: Mapping[str, NDArray[np.bool_]]


def decode(frames: Frames, layout: FrameLayout) -> DecodedMessage:
    """All signals of the frames that carry `layout`; other, remote, error and too short frames are left out."""
    rows = np.flatnonzero((frames.can_id == np.uint32(layout.can_id)) & (frames.length >= layout.length))
    data = frames.data[rows]
    if data.shape[1] < layout.length:  # frames of CAN FD are looked for where none is
        rows, data = rows[:0], np.zeros((0, layout.length), np.uint8)
    values = {s.name: physical(raw(data, s), s) for s in layout.signals}
    present = {s.name: _present(data, layout, s) for s in layout.signals if s.selector is not None}
    return DecodedMessage(rows, values, present)


def raw(data: NDArray[np.uint8], signal: SignalLayout) -> Array:
    """Raw values (n) of a signal in payloads (n, w): int64, uint64 for unsigned, float64 for IEEE floats."""
    bits = _bits(data, signal)
    if signal.is_float:
        kinds = {16: ("<u2", "<f2"), 32: ("<u4", "<f4"), 64: ("<u8", "<f8")}
        integer, real = kinds[signal.length]
        # A signalling NaN off the bus is data: it becomes a quiet one without a word.
        with np.errstate(invalid="ignore"):
            return np.asarray(bits.astype(integer).view(real).astype(np.float64))
    return bits


def are_adjacent(signals: Sequence[SignalLayout]) -> bool:
    """Whether signals are whole words of one meaning, one behind the other, in the order given."""
    first = signals[0]
    if not _is_whole_word(first) or first.is_float:
        return False
    meaning = _meaning(first)
    return all(
        signal.first_bit == first.first_bit + place * first.length and _meaning(signal) == meaning
        for place, signal in enumerate(signals)
    )


def raw_words(data: NDArray[np.uint8], first: SignalLayout, count: int) -> Array:
    """Raw values (n, count) of adjacent signals that begin with `first`; nothing is copied."""
    start = first.first_bit // first.length
    return _words(data, first)[:, start : start + count]


def physical(values: Array, signal: SignalLayout) -> Array:
    """raw · scale + offset in the order and arithmetic of cantools: integers stay integers.

    An integer product that 64 bits cannot hold is worked out exactly and rounded once, to float64.
    """
    scale, offset = signal.scale, signal.offset
    if scale == 1 and offset == 0:
        return values
    if signal.is_float:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(values * float(scale) + float(offset))
    if float(scale).is_integer() and float(offset).is_integer():
        scale, offset = int(scale), int(offset)
    if isinstance(scale, float):
        product = np.asarray(values * scale)
        product += offset
        return product
    if (abs(scale) << signal.length) + abs(int(offset)) < 1 << 63:
        return np.asarray(values.astype(np.int64) * scale + offset)
    return np.asarray((values.astype(object) * scale + offset).astype(np.float64))


def _bits(data: NDArray[np.uint8], signal: SignalLayout) -> Array:
    """The signal's bits as integers (n), extended by sign: shifted up against the word's end, then down again."""
    kind = np.int64 if signal.signed and not signal.is_float else np.uint64
    if _is_whole_word(signal):
        return _words(data, signal)[:, signal.first_bit // signal.length].astype(kind)
    first, skip = (0, signal.first_bit) if data.shape[1] == 8 else divmod(signal.first_bit, 8)
    window = _window(data, first)
    rest = skip + signal.length - 64
    if signal.big_endian:
        word = window.view(">u8")[:, 0].astype(np.uint64)
        word <<= np.uint64(skip)
        if rest > 0:
            word |= _byte(data, first + 8) >> np.uint64(8 - skip)
    else:
        word = window.view("<u8")[:, 0].astype(np.uint64)
        if rest > 0:
            word >>= np.uint64(skip)
            word |= _byte(data, first + 8) << np.uint64(64 - skip)
            skip = 0
        word <<= np.uint64(64 - skip - signal.length)
    bits = word.view(kind)
    bits >>= kind(64 - signal.length)
    return bits


def _is_whole_word(signal: SignalLayout) -> bool:
    """Whether the signal is a word of its own in the payload."""
    return signal.length in (8, 16, 32, 64) and signal.first_bit % signal.length == 0


def _words(data: NDArray[np.uint8], signal: SignalLayout) -> Array:
    """Payloads of 8 or 64 bytes as words of the signal's kind (n, width / its length)."""
    order, kind = ">" if signal.big_endian else "<", "i" if signal.signed and not signal.is_float else "u"
    return np.ascontiguousarray(data).view(f"{order}{kind}{signal.length // 8}")


def _meaning(signal: SignalLayout) -> tuple[float, ...]:
    """What raw values need to become physical."""
    return (signal.length, signal.big_endian, signal.signed, signal.is_float, signal.scale, signal.offset)


def _window(data: NDArray[np.uint8], first: int) -> NDArray[np.uint8]:
    """Eight bytes (n, 8) of each payload from `first`; zeros beyond the end. A classic payload is its own window."""
    if data.shape[1] == 8:
        return np.ascontiguousarray(data)
    window = np.zeros((len(data), 8), np.uint8)
    part = data[:, first : first + 8]
    window[:, : part.shape[1]] = part
    return window


def _byte(data: NDArray[np.uint8], index: int) -> NDArray[np.uint64]:
    return data[:, index].astype(np.uint64)


def _present(data: NDArray[np.uint8], layout: FrameLayout, signal: SignalLayout) -> NDArray[np.bool_]:
    """Where a signal is there: its selector is there and shows one of its values."""
    if signal.selector is None:
        return np.ones(len(data), bool)
    selector = layout.signal(signal.selector)
    shown = np.isin(raw(data, selector), np.array(signal.selected_by))
    return np.asarray(shown & _present(data, layout, selector))
