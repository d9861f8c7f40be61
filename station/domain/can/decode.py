"""Frames of one node → samples, and everything that is wrong with them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.can import e2e
from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.sequence_counter import CounterErrors, count_errors, counter_steps
from station.domain.can.signals import FrameLayout, SignalLayout, adjacent_words, physical, raw
from station.domain.core.types import REMOTE, Array, Floats, Frames
from station.messages import Message


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

    def messages(self) -> tuple[Message, ...]:
        """Each kind of error that occurred, with how often."""
        c = self.counter
        kinds = (
            (self.wrong_length, Message("frames-wrong-length", count=self.wrong_length)),
            (self.remote, Message("frames-remote", count=self.remote)),
            (self.crc_errors, Message("frames-wrong-crc", count=self.crc_errors)),
            (self.not_finite, Message("readings-not-finite", count=self.not_finite)),
            (c.lost, Message("frames-lost", count=c.lost, gaps=c.gaps)),
            (c.repeats, Message("frames-repeated", count=c.repeats, longest=c.longest_repeat)),
            (c.late, Message("frames-late", count=c.late)),
            (c.stuck, Message("counter-stuck")),
        )
        return tuple(message for count, message in kinds if count)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Readings of one node in the order of arrival, one row for each decodable frame.

    time_ns (n); xyz (n, 3) physical; counter, status (n) or None; crc_ok (n), all True without a CRC; usable (n):
    right CRC, finite, and no repeat of the frame before. temperature_time_ns, temperature_degC (t): the device's own
    thermometer, which may have spoken outside of the readings' span.
    """

    time_ns: NDArray[np.int64]
    xyz: Floats
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
    def readings(self) -> Floats:
        """The usable readings (m, 3)."""
        return self.xyz if self.usable.all() else self.xyz[self.usable]


@dataclass(frozen=True, slots=True, eq=False)
class DecodedFrames:
    """Frames of one node, each decoded by itself; what its neighbours say about it is `check_sequence`'s.

    time_ns, counter, status, crc_ok (n), xyz (n, 3), finite (n): as in `Samples`; wrong_length_ns, remote_ns: when
    frames came that cannot be decoded; temperature_time_ns, temperature_degC (t).
    """

    time_ns: NDArray[np.int64]
    xyz: Floats
    counter: Array | None
    status: Array | None
    crc_ok: NDArray[np.bool_]
    finite: NDArray[np.bool_]
    wrong_length_ns: NDArray[np.int64]
    remote_ns: NDArray[np.int64]
    temperature_time_ns: NDArray[np.int64]
    temperature_degC: Floats

    @staticmethod
    def join(parts: "Sequence[DecodedFrames]") -> "DecodedFrames":
        """At least one part of one node, one after the other."""
        if len(parts) == 1:
            return parts[0]
        columns: dict[str, list[Array]] = {
            f.name: [getattr(part, f.name) for part in parts]
            for f in fields(DecodedFrames)
            if getattr(parts[0], f.name) is not None
        }
        return replace(parts[0], **{name: np.concatenate(column) for name, column in columns.items()})

    def between(self, from_ns: int, to_ns: int) -> "DecodedFrames":
        """The readings in [from_ns, to_ns), and what was wrong among them; temperatures stay as they are."""
        rows = _inside(self.time_ns, from_ns, to_ns)
        cut: dict[str, Array] = {
            "wrong_length_ns": self.wrong_length_ns[_inside(self.wrong_length_ns, from_ns, to_ns)],
            "remote_ns": self.remote_ns[_inside(self.remote_ns, from_ns, to_ns)],
        }
        if not rows.all():
            cut |= {name: value[rows] for name in _ROWS if (value := getattr(self, name)) is not None}
        return replace(self, **cut)


#: Columns of `DecodedFrames` that have one row for each decodable frame.
_ROWS = ("time_ns", "xyz", "counter", "status", "crc_ok", "finite")


def decode_samples(frames: Frames, layout: SensorLayout, node: int) -> Samples:
    """Everything that `node` said about itself in `frames`; frames of others are left out."""
    return check_sequence(decode_frames(frames, layout, node), layout.counter_values)


def decode_frames(frames: Frames, layout: SensorLayout, node: int) -> DecodedFrames:
    """The frames of `node` among `frames`, each decoded by itself."""
    whole, wrong_length_ns, remote_ns = _well_formed(frames, layout.sample, layout.id_of(layout.sample, node))
    xyz = _physical(whole.data, layout.axes)
    counter = None if layout.counter is None else raw(whole.data, layout.counter)
    roles = layout.map.sample
    temperature_time_ns, temperature_degC = decode_temperatures(frames, layout, node)
    return DecodedFrames(
        time_ns=whole.time_ns,
        xyz=xyz,
        counter=counter,
        status=None if roles.status is None else raw(whole.data, layout.sample.signal(roles.status)),
        crc_ok=_crc_ok(whole.data, counter, layout, node),
        finite=_finite(xyz, layout),
        wrong_length_ns=wrong_length_ns,
        remote_ns=remote_ns,
        temperature_time_ns=temperature_time_ns,
        temperature_degC=temperature_degC,
    )


def check_sequence(decoded: DecodedFrames, counter_values: int) -> Samples:
    """The frames as a sequence: which of them say something new, and what is wrong with it."""
    usable, counted = _check_counter(decoded.time_ns, decoded.counter, decoded.crc_ok, counter_values)
    wrong_length, remote = len(decoded.wrong_length_ns), len(decoded.remote_ns)
    return Samples(
        time_ns=decoded.time_ns,
        xyz=decoded.xyz,
        counter=decoded.counter,
        status=decoded.status,
        crc_ok=decoded.crc_ok,
        usable=usable & decoded.finite,
        temperature_time_ns=decoded.temperature_time_ns,
        temperature_degC=decoded.temperature_degC,
        frame_errors=FrameErrors(
            frames=len(decoded.time_ns) + wrong_length + remote,
            wrong_length=wrong_length,
            remote=remote,
            crc_errors=int(np.count_nonzero(~decoded.crc_ok)),
            not_finite=int(np.count_nonzero(~decoded.finite)),
            counter=counted,
        ),
    )


def _inside(time_ns: NDArray[np.int64], from_ns: int, to_ns: int) -> NDArray[np.bool_]:
    return np.asarray((time_ns >= from_ns) & (time_ns < to_ns))


def _physical(data: NDArray[np.uint8], axes: tuple[SignalLayout, ...]) -> Floats:
    """Physical values (n, 3); all at once where the axes lie side by side and mean the same."""
    together = adjacent_words(data, axes)
    if together is not None:
        return np.asarray(physical(together, axes[0]), np.float64)
    return np.asarray(np.stack([physical(raw(data, axis), axis) for axis in axes], axis=1), np.float64)


def _well_formed(
    frames: Frames, layout: FrameLayout, can_id: int
) -> tuple[Frames, NDArray[np.int64], NDArray[np.int64]]:
    """The node's frames that can be decoded, and when those came that cannot: of the wrong length, and remote ones."""
    named = frames.can_id == np.uint32(can_id)
    right = named & (frames.length == layout.length)
    mine, good = int(np.count_nonzero(named)), int(np.count_nonzero(right))
    none = frames.time_ns[:0]
    wrong_length_ns = none if mine == good else frames.time_ns[named & ~right]
    remote_ns = none if mine == len(frames) else frames.time_ns[frames.can_id == np.uint32(can_id | REMOTE)]
    return (frames if good == len(frames) else frames[right]), wrong_length_ns, remote_ns


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
    whole, _, _ = _well_formed(frames, layout.temperature, layout.id_of(layout.temperature, node))
    signal = layout.temperature.signal(roles.signal)
    return whole.time_ns, physical(raw(whole.data, signal), signal).astype(np.float64)
