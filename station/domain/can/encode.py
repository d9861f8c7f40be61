"""Values → payloads and frames: the inverse of decoding, for the simulation and the simulated device."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from station.domain.can import e2e
from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import Array, Floats, Frames


def payloads(layout: FrameLayout, values: Mapping[str, Array]) -> NDArray[np.uint8]:
    """Payloads (n, 8) of one message from physical values (n) by signal name; signals not given are 0.

    A value between two steps goes to the nearer, one out of range to the last that the bits can hold, as in a
    converter. Messages of up to 8 bytes.
    """
    arrays = np.broadcast_arrays(*values.values()) if values else []
    little = np.zeros(arrays[0].shape if arrays else 0, np.uint64)
    big = little.copy()
    for name, physical in zip(values, arrays, strict=True):
        signal = layout.signal(name)
        word = _bits(to_raw(physical, signal), signal)
        if signal.big_endian:
            big |= word << np.uint64(64 - signal.length - signal.first_bit)
        else:
            little |= word << np.uint64(signal.first_bit)
    data = little.astype("<u8").view(np.uint8) | big.astype(">u8").view(np.uint8)
    return data.reshape(-1, 8)


def to_raw(physical: Array, signal: SignalLayout) -> Array:
    """Raw values (n) of physical ones: int64 or uint64 rounded half to even and clipped, float64 for floats."""
    value = (np.asarray(physical, np.float64) - signal.offset) / signal.scale
    if signal.is_float:
        return np.asarray(value, np.float64)
    low, high = signal.raw_limits()
    kind = np.int64 if signal.signed else np.uint64
    rounded = np.rint(value)
    inside = np.clip(rounded, low, np.nextafter(float(high) + 1, 0)).astype(kind)
    return np.where(rounded >= high, kind(high), inside)


def sample_frames(
    layout: SensorLayout,
    node: int,
    time_ns: NDArray[np.int64],
    xyz: Floats,
    *,
    first_count: int = 0,
    status: Array | int = 0,
) -> Frames:
    """Sample frames (n) of a node from readings (n, 3): quantised, counted from `first_count`, protected."""
    roles = layout.map.sample
    values: dict[str, Array] = dict(zip((roles.x, roles.y, roles.z), np.asarray(xyz, float).T, strict=True))
    counter = ((first_count + np.arange(len(time_ns))) % layout.counter_values).astype(np.uint64)
    if roles.counter is not None:
        values[roles.counter] = counter
    if roles.status is not None:
        values[roles.status] = np.broadcast_to(np.asarray(status), counter.shape)
    data = protect(payloads(layout.sample, values), counter, layout, node)
    return _frames(layout.sample, layout.id_of(layout.sample, node), time_ns, data)


def temperature_frames(layout: SensorLayout, node: int, time_ns: NDArray[np.int64], temperature_degC: Floats) -> Frames:
    """Temperature frames (n) of a node; none when the product has no such message."""
    role = layout.map.temperature
    if layout.temperature is None or role is None:
        return Frames.empty()
    data = payloads(layout.temperature, {role.signal: temperature_degC})
    return _frames(layout.temperature, layout.id_of(layout.temperature, node), time_ns, data)


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
