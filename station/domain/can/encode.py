"""Values → payloads and frames: the inverse of decoding, for the simulation and the simulated device."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from station.domain.can import e2e
from station.domain.can.sample_parts import SamplePart
from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import Array, Floats, Frames

#: Integers of so many bits are exact as float64.
_EXACT_BITS = 53


def payloads(layout: FrameLayout, values: Mapping[str, Array]) -> NDArray[np.uint8]:
    """Payloads (n, 8), of FD frames (n, 64), of one message from physical values (n) by signal name; others are 0.

    A value between two steps goes to the nearer, one out of range to the last that the bits can hold, as in a
    converter.
    """
    sizes = {np.size(array) for array in values.values()}
    count = (sizes - {1} or sizes or {0}).pop()
    signals = [layout.signal(name) for name in values]
    words = [_bits(to_raw(array, signal), signal) for array, signal in zip(values.values(), signals, strict=True)]
    words = [word if word.shape == (count,) else np.broadcast_to(word, count) for word in words]
    return _classic(signals, words, count) if layout.length <= 8 else _wide(signals, words, count)


def _classic(signals: Sequence[SignalLayout], words: Sequence[Array], count: int) -> NDArray[np.uint8]:
    little = np.zeros(count, np.uint64)
    big = little.copy()
    for signal, word in zip(signals, words, strict=True):
        if signal.big_endian:
            big |= word << np.uint64(64 - signal.length - signal.first_bit)
        else:
            little |= word << np.uint64(signal.first_bit)
    data = little.astype("<u8").view(np.uint8) | big.astype(">u8").view(np.uint8)
    return data.reshape(-1, 8)


def _wide(signals: Sequence[SignalLayout], words: Sequence[Array], count: int) -> NDArray[np.uint8]:
    """Bit by bit: the simulation sends few such frames."""
    bits = np.zeros((count, 512), np.uint8)
    for signal, word in zip(signals, words, strict=True):
        order = range(signal.length - 1, -1, -1) if signal.big_endian else range(signal.length)
        for place, bit in enumerate(order, signal.first_bit):
            # Of a little-endian signal the bits of a byte count from its low end, of a big-endian one from its high.
            at = place if signal.big_endian else 8 * (place // 8) + 7 - place % 8
            bits[:, at] = word >> np.uint64(bit) & np.uint64(1)
    return np.packbits(bits, axis=1)


def to_raw(physical: Array, signal: SignalLayout) -> Array:
    """Raw values (n) of physical ones: int64 or uint64 rounded half to even and clipped, float64 for floats."""
    value = (np.asarray(physical, np.float64) - signal.offset) / signal.scale
    if signal.is_float:
        return np.asarray(value, np.float64)
    low, high = signal.raw_limits()
    kind = np.int64 if signal.signed else np.uint64
    rounded = np.rint(value)
    if signal.length <= _EXACT_BITS:
        return np.asarray(np.minimum(np.maximum(rounded, low), high).astype(kind))
    inside = np.clip(rounded, low, np.nextafter(float(high) + 1, 0)).astype(kind)
    return np.where(rounded >= high, kind(high), inside)


def sample_frames(
    layout: SensorLayout,
    node: int,
    time_ns: NDArray[np.int64],
    xyz: Floats,
    *,
    first_count: int = 0,
    count_step: int = 1,
    status: Array | int = 0,
    temperature_degC: Array | float = 0.0,
) -> Frames:
    """Sample frames of a node from readings (n, 3) at time_ns (n): quantised, counted from `first_count`, protected.
    count_step: 0 where the counter is stuck. temperature_degC: goes with the readings where their message has it.

    Where a frame holds several readings, a rest that fills none is not sent; where a reading needs several frames, they
    come at one instant, one behind the other.
    """
    each = layout.samples_a_frame
    count = len(time_ns) // each
    times = time_ns[each - 1 : count * each : each]
    readings = np.asarray(xyz, float)[: count * each].reshape(count, each, 3)
    counted = ((first_count // each + count_step * np.arange(count)) % layout.frame_counter_values).astype(np.uint64)
    flags, shown = (
        np.broadcast_to(np.asarray(given), len(time_ns))[each - 1 : count * each : each]
        for given in (status, temperature_degC)
    )
    sent = [_part_frames(layout, node, part, times, readings, counted, flags, shown) for part in layout.parts]
    if len(sent) == 1:
        return sent[0]
    frames = Frames.join(sent)
    return frames[np.argsort(frames.time_ns, kind="stable")]


def _part_frames(
    layout: SensorLayout,
    node: int,
    part: SamplePart,
    time_ns: NDArray[np.int64],
    readings: Floats,
    counter: NDArray[np.uint64],
    status: Array,
    temperature_degC: Array,
) -> Frames:
    """Frames (n) of one part of the readings (n, k, 3)."""
    roles, lead = layout.map.sample, part.message.name == layout.sample.name
    values: dict[str, Array] = {signal.name: readings[:, cell // 3, cell % 3] for cell, signal in part.cells}
    values |= {signal.name: np.full(len(time_ns), shown[0]) for signal, shown in part.selectors}
    if part.counter is not None:
        values[part.counter.name] = counter
    if lead and roles.status is not None:
        values[roles.status] = status
    if layout.temperature is not None and layout.temperature.name == part.message.name:
        values[_temperature_signal(layout)] = temperature_degC
    data = payloads(part.message, values)
    if lead:
        data = protect(data, counter, layout, node)
    return _frames(part.message, layout.id_of(part.message, node), time_ns, data)


def temperature_frames(layout: SensorLayout, node: int, time_ns: NDArray[np.int64], temperature_degC: Floats) -> Frames:
    """Temperature frames (n) of a node; none when the product has no such message, or the readings have it."""
    if layout.temperature is None or layout.temperature_rides:
        return Frames.empty()
    data = payloads(layout.temperature, {_temperature_signal(layout): temperature_degC})
    return _frames(layout.temperature, layout.id_of(layout.temperature, node), time_ns, data)


def _temperature_signal(layout: SensorLayout) -> str:
    assert layout.map.temperature is not None
    return layout.map.temperature.signal


def protect(data: NDArray[np.uint8], counter: NDArray[np.uint64], layout: SensorLayout, node: int) -> NDArray[np.uint8]:
    """Payloads with the CRC put in (and the data id's nibble, in mode nibble); as they are without protection."""
    if layout.map.e2e is None:
        return data
    data = data.copy()
    if layout.map.e2e.profile == "P01" and layout.map.e2e.mode == "nibble":
        data[:, 1] = data[:, 1] & 0x0F | (layout.map.e2e.data_id_of(node) >> 8 & 0xF) << 4
    data[:, layout.crc_byte] = e2e.checksum(data, counter, layout, node)
    return data


def _bits(raw: Array, signal: SignalLayout) -> NDArray[np.uint64]:
    """The signal's bits in the low end of a word (n)."""
    if signal.is_float:
        kind, word = {16: ("<f2", "<u2"), 32: ("<f4", "<u4"), 64: ("<f8", "<u8")}[signal.length]
        return np.ascontiguousarray(raw).astype(kind).view(word).astype(np.uint64)
    mask = np.uint64((1 << signal.length) - 1)
    return raw.astype(np.int64).view(np.uint64) & mask if signal.signed else raw.astype(np.uint64) & mask


def _frames(layout: FrameLayout, can_id: int, time_ns: NDArray[np.int64], data: NDArray[np.uint8]) -> Frames:
    n = len(time_ns)
    return Frames(time_ns, np.full(n, can_id, np.uint32), np.full(n, layout.length, np.uint8), data)
