"""Frames of one node → samples, and everything that is wrong with them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from station.domain.can import e2e
from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.sequence_counter import CounterErrors, count_errors, counter_steps
from station.domain.can.signals import FrameLayout, SignalLayout, adjacent_words, physical, raw
from station.domain.core.types import REMOTE, Array, Floats, Frames


@dataclass(frozen=True, slots=True)
class FrameErrors:
    """What was wrong with the sample frames of one node.

    frames: how many came; wrong_length, remote: not decodable; crc_errors: wrong CRC (or data-id nibble);
    not_finite: float signals that are no number; the counter's tale, worked out over frames with a right CRC.
    """

    frames: int = 0
    wrong_length: int = 0
    remote: int = 0
    crc_errors: int = 0
    not_finite: int = 0
    counter: CounterErrors = field(default_factory=CounterErrors)

    @property
    def clean(self) -> bool:
        """Every frame came once, whole, in turn."""
        return self == FrameErrors(frames=self.frames)

    def sentences(self) -> tuple[str, ...]:
        """Each trouble in words, for a person."""
        c = self.counter
        told = [
            (self.wrong_length, "frames of the wrong length"),
            (self.remote, "remote frames with the sensor's identifier"),
            (self.crc_errors, "frames with a wrong CRC"),
            (self.not_finite, "readings that are no number"),
            (c.lost, f"frames lost, at {c.gaps} places"),
            (c.repeats, f"frames repeated, up to {c.longest_repeat} in a row"),
            (c.late, "frames out of order"),
        ]
        said = [f"{number} {what}" for number, what in told if number]
        return tuple(said + ["the frame counter is stuck"] * c.stuck)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Readings of one node in the order of arrival, one row for each decodable frame.

    time_ns (n); xyz (n, 3) physical; payload (n, w) and the axes' places in it; counter, status (n) or None; crc_ok
    (n), all True without a CRC; usable (n): right CRC, finite, and no repeat of the frame before.
    temperature_time_ns, temperature_degC (t): the device's own thermometer.
    """

    time_ns: NDArray[np.int64]
    xyz: Floats
    payload: NDArray[np.uint8]
    axes: tuple[SignalLayout, ...]
    counter: Array | None
    status: Array | None
    crc_ok: NDArray[np.bool_]
    usable: NDArray[np.bool_]
    temperature_time_ns: NDArray[np.int64]
    temperature_degC: Floats
    frame_errors: FrameErrors

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def raw(self) -> Array:
        """Readings as sent (n, 3), taken from the payloads when somebody asks."""
        return np.stack([raw(self.payload, axis) for axis in self.axes], axis=1)


def decode_samples(frames: Frames, layout: SensorLayout, node: int) -> Samples:
    """Everything that `node` said about itself in `frames`; frames of others are left out."""
    whole, trouble = _well_formed(frames, layout.sample, layout.id_of(layout.sample, node))
    xyz = _physical(whole.data, layout.axes)
    counter = None if layout.counter is None else raw(whole.data, layout.counter)
    crc_ok = _crc_ok(whole.data, counter, layout, node)
    finite = _finite(xyz, layout)
    usable, counted = _check_counter(whole.time_ns, counter, crc_ok, layout.counter_values)
    roles = layout.map.sample
    temperature = decode_temperatures(frames, layout, node)
    return Samples(
        time_ns=whole.time_ns,
        xyz=xyz,
        payload=whole.data,
        axes=layout.axes,
        counter=counter,
        status=None if roles.status is None else raw(whole.data, layout.sample.signal(roles.status)),
        crc_ok=crc_ok,
        usable=usable & finite,
        temperature_time_ns=temperature[0],
        temperature_degC=temperature[1],
        frame_errors=FrameErrors(
            frames=trouble.frames,
            wrong_length=trouble.wrong_length,
            remote=trouble.remote,
            crc_errors=int(np.count_nonzero(~crc_ok)),
            not_finite=int(np.count_nonzero(~finite)),
            counter=counted,
        ),
    )


def _physical(data: NDArray[np.uint8], axes: tuple[SignalLayout, ...]) -> Floats:
    """Physical values (n, 3); all at once where the axes lie side by side and mean the same."""
    together = adjacent_words(data, axes)
    if together is not None:
        return np.asarray(physical(together, axes[0]), np.float64)
    return np.asarray(np.stack([physical(raw(data, axis), axis) for axis in axes], axis=1), np.float64)


def _well_formed(frames: Frames, layout: FrameLayout, can_id: int) -> tuple[Frames, FrameErrors]:
    """The node's frames that can be decoded, and how many cannot."""
    named = frames.can_id == np.uint32(can_id)
    right = named & (frames.length == layout.length)
    mine, good = int(np.count_nonzero(named)), int(np.count_nonzero(right))
    asked = 0 if mine == len(frames) else int(np.count_nonzero(frames.can_id == np.uint32(can_id | REMOTE)))
    trouble = FrameErrors(frames=mine + asked, wrong_length=mine - good, remote=asked)
    return (frames if good == len(frames) else frames[right]), trouble


def _finite(xyz: Floats, layout: SensorLayout) -> NDArray[np.bool_]:
    """Which readings are numbers; integers always are."""
    if any(axis.is_float for axis in layout.axes):
        return np.asarray(np.isfinite(xyz).all(axis=1))
    return np.ones(len(xyz), bool)


def _crc_ok(data: NDArray[np.uint8], counter: Array | None, layout: SensorLayout, node: int) -> NDArray[np.bool_]:
    if layout.map.e2e is None or counter is None:
        return np.ones(len(data), bool)
    right = data[:, layout.crc_byte] == e2e.checksum(data, counter, layout, node)
    return np.asarray(right & e2e.nibble_ok(data, layout, node) & (counter < layout.counter_values))


def _check_counter(
    time_ns: NDArray[np.int64], counter: Array | None, crc_ok: NDArray[np.bool_], values: int
) -> tuple[NDArray[np.bool_], CounterErrors]:
    """Which frames say something new, and the counter's tale over those with a right CRC."""
    if counter is None or np.count_nonzero(crc_ok) < 2:
        return crc_ok, CounterErrors()
    if crc_ok.all():
        step = counter_steps(counter, time_ns, values)
        if step.min() == step.max() == 1:
            return crc_ok, CounterErrors()
        return np.concatenate([[True], step != 0]), count_errors(step, np.zeros(len(step), np.int64))
    trusted = np.flatnonzero(crc_ok)
    step = counter_steps(counter[trusted], time_ns[trusted], values)
    fresh = crc_ok.copy()
    fresh[trusted[1:]] = step != 0
    return fresh, count_errors(step, np.diff(trusted) - 1)


def decode_temperatures(frames: Frames, layout: SensorLayout, node: int) -> tuple[NDArray[np.int64], Floats]:
    """What the node's own thermometer said in `frames`: times (t), ns, and degC (t)."""
    roles = layout.map.temperature
    if layout.temperature is None or roles is None:
        return np.zeros(0, np.int64), np.zeros(0)
    whole, _ = _well_formed(frames, layout.temperature, layout.id_of(layout.temperature, node))
    signal = layout.temperature.signal(roles.signal)
    return whole.time_ns, physical(raw(whole.data, signal), signal).astype(np.float64)
