"""Frames of one node → samples, and everything that is wrong with them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.can import e2e
from station.domain.can.sample_join import JoinedReadings, PartFrames, join_messages, key_of_sync
from station.domain.can.sample_parts import SamplePart
from station.domain.can.sensor_layout import SYNC, SensorLayout
from station.domain.can.sequence_counter import CounterErrors, count_errors, counter_steps
from station.domain.can.signals import FrameLayout, physical, raw, raw_words
from station.domain.core.types import REMOTE, Array, Floats, Frames, widened
from station.messages import Message


@dataclass(frozen=True, slots=True)
class FrameErrors:
    """What was wrong with the sample frames of one node.

    frames: how many came; wrong_length, remote: not decodable; crc_errors: wrong CRC (or data-id nibble);
    not_finite: float signals that are no number; incomplete: readings of which a message is missing; readings_each:
    readings in one frame; the counter's tale, worked out over frames with a right CRC.
    """

    frames: int = 0
    wrong_length: int = 0
    remote: int = 0
    crc_errors: int = 0
    not_finite: int = 0
    incomplete: int = 0
    readings_each: int = 1
    counter: CounterErrors = field(default_factory=CounterErrors)

    @property
    def clean(self) -> bool:
        """Every frame came once, whole, in turn."""
        return self == FrameErrors(frames=self.frames, readings_each=self.readings_each)

    def messages(self) -> tuple[Message, ...]:
        """Each kind of error that occurred, with how often."""
        c = self.counter
        kinds = (
            (self.wrong_length, Message("frames-wrong-length", count=self.wrong_length)),
            (self.remote, Message("frames-remote", count=self.remote)),
            (self.crc_errors, Message("frames-wrong-crc", count=self.crc_errors)),
            (self.not_finite, Message("readings-not-finite", count=self.not_finite)),
            (self.incomplete, Message("readings-incomplete", count=self.incomplete)),
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
    frames came that cannot be decoded; temperature_time_ns, temperature_degC (t). Where a reading is more than one
    plain message, parts has the frames of each of its parts, the leading one first, sync_ns when SYNC came, and xyz is
    what the leading frames hold.
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
    parts: tuple[PartFrames, ...] = ()
    sync_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @staticmethod
    def join(parts: "Sequence[DecodedFrames]") -> "DecodedFrames":
        """At least one part of one node, one after the other."""
        if len(parts) == 1:
            return parts[0]
        columns: dict[str, list[Array]] = {
            f.name: [getattr(part, f.name) for part in parts]
            for f in fields(DecodedFrames)
            if f.name != "parts" and getattr(parts[0], f.name) is not None
        }
        joined: dict[str, Any] = {name: np.concatenate(column) for name, column in columns.items()}
        joined["parts"] = tuple(PartFrames.join(same) for same in zip(*(part.parts for part in parts), strict=True))
        return replace(parts[0], **joined)

    def between(self, from_ns: int, to_ns: int) -> "DecodedFrames":
        """The readings in [from_ns, to_ns), and what was wrong among them; temperatures stay as they are."""
        rows = _inside(self.time_ns, from_ns, to_ns)
        cut: dict[str, Any] = {
            "parts": tuple(part[_inside(part.time_ns, from_ns, to_ns)] for part in self.parts),
            "sync_ns": self.sync_ns[_inside(self.sync_ns, from_ns, to_ns)],
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
    return check_sequence(decode_frames(frames, layout, node), layout)


def decode_frames(frames: Frames, layout: SensorLayout, node: int) -> DecodedFrames:
    """The frames of `node` among `frames`, each decoded by itself."""
    if not layout.is_plain:
        return _decode_parts(frames, layout, node)
    whole, wrong_length_ns, remote_ns = _well_formed(frames, layout.sample, layout.id_of(layout.sample, node))
    return _decoded(
        frames,
        whole,
        _physical(whole.data, layout),
        layout,
        node,
        wrong_length_ns=wrong_length_ns,
        remote_ns=remote_ns,
    )


def _decoded(
    frames: Frames,
    lead: Frames,
    xyz: Floats,
    layout: SensorLayout,
    node: int,
    *,
    wrong_length_ns: NDArray[np.int64],
    remote_ns: NDArray[np.int64],
) -> DecodedFrames:
    """What the leading frames of the readings hold beside their values xyz (n, 3) or (n, k, 3)."""
    counter = None if layout.counter is None else raw(lead.data, layout.counter)
    roles = layout.map.sample
    temperature_time_ns, temperature_degC = decode_temperatures(frames, layout, node)
    return DecodedFrames(
        time_ns=lead.time_ns,
        xyz=xyz,
        counter=counter,
        status=None if roles.status is None else raw(lead.data, layout.sample.signal(roles.status)),
        crc_ok=_crc_ok(lead.data, counter, layout, node),
        finite=_finite(xyz, layout),
        wrong_length_ns=wrong_length_ns,
        remote_ns=remote_ns,
        temperature_time_ns=temperature_time_ns,
        temperature_degC=temperature_degC,
    )


def _decode_parts(frames: Frames, layout: SensorLayout, node: int) -> DecodedFrames:
    """Readings whose axes come in several messages, by turns in one, or several to a frame."""
    messages, wrong_length_ns, remote_ns = _well_formed_all(frames, layout, node)
    wholes = [_present(messages[part.message.name], part) for part in layout.parts]
    readings = [part.readings(w.data, layout.samples_a_frame) for part, w in zip(layout.parts, wholes, strict=True)]
    decoded = _decoded(
        frames, wholes[0], readings[0], layout, node, wrong_length_ns=wrong_length_ns, remote_ns=remote_ns
    )
    keys = [
        decoded.counter if part.counter is layout.counter else part.key(whole.data)
        for part, whole in zip(layout.parts, wholes, strict=True)
    ]
    found = tuple(map(PartFrames, [whole.time_ns for whole in wholes], readings, keys))
    sync = frames.time_ns[frames.can_id == np.uint32(SYNC)] if layout.joined_by == "sync" else decoded.sync_ns
    return replace(decoded, parts=found, sync_ns=sync)


def _present(whole: Frames, part: SamplePart) -> Frames:
    """The frames of a message that carry a part."""
    present = part.present(whole.data)
    return whole if present is None else whole[present]


def check_sequence(decoded: DecodedFrames, layout: SensorLayout) -> Samples:
    """The frames as a sequence: which of them say something new, and what is wrong with it."""
    counter = decoded.counter if layout.counts_readings else None
    usable, counted = _check_counter(decoded.time_ns, counter, decoded.crc_ok, layout.frame_counter_values)
    joined = _join(decoded, layout) if decoded.parts else None
    xyz = decoded.xyz if joined is None else joined.readings.reshape(-1, 3)
    finite = decoded.finite if joined is None else _finite(xyz, layout)
    wrong_length, remote = len(decoded.wrong_length_ns), len(decoded.remote_ns)
    errors = FrameErrors(
        frames=len(decoded.time_ns) + wrong_length + remote,
        wrong_length=wrong_length,
        remote=remote,
        crc_errors=int(np.count_nonzero(~decoded.crc_ok)),
        not_finite=int(np.count_nonzero(~finite)),
        incomplete=0 if joined is None else joined.gaps,
        readings_each=layout.samples_a_frame,
        counter=counted,
    )
    columns: dict[str, Any] = {
        "time_ns": decoded.time_ns,
        "counter": counter,
        "status": decoded.status,
        "crc_ok": decoded.crc_ok,
        "usable": usable,
    }
    if joined is not None and joined.rows is not None:
        columns = {name: None if column is None else column[joined.rows] for name, column in columns.items()}
    if layout.samples_a_frame > 1:
        columns = _several_each(columns, layout)
    columns["usable"] = columns["usable"] & finite
    return Samples(
        xyz=xyz,
        temperature_time_ns=decoded.temperature_time_ns,
        temperature_degC=decoded.temperature_degC,
        frame_errors=errors,
        **columns,
    )


def _join(decoded: DecodedFrames, layout: SensorLayout) -> JoinedReadings:
    """The readings of several messages as one each."""
    parts, by = decoded.parts, layout.joined_by
    if by != "counter":
        keys = [None if by == "time" else key_of_sync(p.time_ns, decoded.sync_ns) for p in parts]
        parts = tuple(replace(part, key=key) for part, key in zip(parts, keys, strict=True))
    join_rule = layout.map.join
    within_ns = None if join_rule is None or join_rule.within_s is None else join_rule.within_s * 1e9
    values = layout.frame_counter_values if by == "counter" else 2
    return join_messages(parts[0], parts[1:], within_ns, values)


def _several_each(columns: dict[str, Any], layout: SensorLayout) -> dict[str, Any]:
    """What each of the readings of a frame takes over from it; its time is that of the last one."""
    each, time_ns, status = layout.samples_a_frame, columns["time_ns"], columns["status"]
    back = (np.arange(each) - (each - 1)) * _sample_period_ns(time_ns, layout)
    return {
        "time_ns": (time_ns[:, None] + np.rint(back).astype(np.int64)).ravel(),
        "counter": _counted_each(columns["counter"], each),
        "status": None if status is None else np.repeat(status, each),
        "crc_ok": np.repeat(columns["crc_ok"], each),
        "usable": np.repeat(columns["usable"], each),
    }


def _sample_period_ns(time_ns: NDArray[np.int64], layout: SensorLayout) -> float:
    """Time between the readings of one frame, ns."""
    if layout.map.sample_period_s is not None:
        return layout.map.sample_period_s * 1e9
    return float(np.median(np.diff(time_ns))) / layout.samples_a_frame if len(time_ns) > 1 else 0.0


def _counted_each(counter: Array | None, each: int) -> Array | None:
    """The frames' counter as a count of readings."""
    if counter is None:
        return None
    own = counter.astype(np.uint64)[:, None] * np.uint64(each) + np.arange(each, dtype=np.uint64)
    return np.asarray(own.ravel())


def _inside(time_ns: NDArray[np.int64], from_ns: int, to_ns: int) -> NDArray[np.bool_]:
    return np.asarray((time_ns >= from_ns) & (time_ns < to_ns))


def _physical(data: NDArray[np.uint8], layout: SensorLayout) -> Floats:
    """Physical values (n, 3); all at once where the axes lie side by side and mean the same."""
    axes = layout.axes
    if layout.axes_are_adjacent:
        return np.asarray(physical(raw_words(data, axes[0], len(axes)), axes[0]), np.float64)
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
    whole = frames if good == len(frames) else frames[right]
    return widened(whole, layout.length), wrong_length_ns, remote_ns


def _well_formed_all(
    frames: Frames, layout: SensorLayout, node: int
) -> tuple[dict[str, Frames], NDArray[np.int64], NDArray[np.int64]]:
    """The same for every message of a reading, by name; times in their order."""
    ids = [layout.id_of(message, node) for message in layout.messages]
    rights = [
        np.flatnonzero((frames.can_id == np.uint32(can_id)) & (frames.length == message.length))
        for message, can_id in zip(layout.messages, ids, strict=True)
    ]
    whole = {m.name: widened(frames[rows], m.length) for m, rows in zip(layout.messages, rights, strict=True)}
    if sum(map(len, rights)) == len(frames):
        return whole, frames.time_ns[:0], frames.time_ns[:0]
    address = frames.can_id & ~np.uint32(REMOTE)
    others = np.isin(address, ids)
    others[np.concatenate(rights)] = False
    is_remote = (frames.can_id & np.uint32(REMOTE)) != 0
    return whole, frames.time_ns[others & ~is_remote], frames.time_ns[others & is_remote]


def _finite(xyz: Floats, layout: SensorLayout) -> NDArray[np.bool_]:
    """Which readings are numbers; integers always are."""
    if any(axis.is_float for axis in layout.axes):
        return np.asarray(np.isfinite(xyz).reshape(len(xyz), -1).all(axis=1))
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
