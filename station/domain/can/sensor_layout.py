"""Which message and signals of a DBC play which role: the block `frames:` of a product file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from station.domain.can.sample_parts import Cell, SamplePart, part_of
from station.domain.can.signals import FrameLayout, SignalLayout, are_adjacent
from station.domain.core.types import EXTENDED
from station.domain.recipe.fields import Name, Positive, StrictModel
from station.errors import InvalidValue, ProductError

Node = Annotated[int, Field(ge=1, le=127)]
#: Identifier of SYNC (CiA 301, 7.2.5).
SYNC = 0x080


AxisSignals = Name | Annotated[tuple[Name, ...], Field(min_length=1, max_length=64)]


class SampleRoles(StrictModel):
    """The message that carries one reading, and the names of its signals.

    An axis whose signal stands in another message is named `MESSAGE.SIGNAL`; the signals of several readings in one
    frame are a list, oldest first. z may be left out by a sensor of two axes, y too by one of one.
    """

    message: Name
    x: AxisSignals
    y: AxisSignals | None = None
    z: AxisSignals | None = None
    counter: Name | None = None
    status: Name | None = None
    crc: Name | None = None

    @model_validator(mode="after")
    def _check_axes(self) -> Self:
        if self.z is not None and self.y is None:
            raise InvalidValue("axis-y-missing")
        if len({len(names) for names in self.axes}) > 1:
            raise InvalidValue("readings-of-axes-differ", counts=tuple(len(names) for names in self.axes))
        return self

    @property
    def axes(self) -> tuple[tuple[str, ...], ...]:
        """Names of the signals of each axis, one for each reading of a frame."""
        given = [names for names in (self.x, self.y, self.z) if names is not None]
        return tuple((names,) if isinstance(names, str) else names for names in given)

    def place(self, name: str) -> tuple[str, str]:
        """(message, signal) that a name means."""
        message, dot, signal = name.rpartition(".")
        return (message, signal) if dot else (self.message, name)

    @property
    def controls(self) -> tuple[str, ...]:
        """Names of the other signals of the message: counter, status, CRC."""
        return tuple(name for name in (self.counter, self.status, self.crc) if name is not None)


class JoinRule(StrictModel):
    """How the messages of one reading are put together. by: equal counters, the same SYNC, or nearness in time.

    within_s: how far apart in time they may be; left out: half a period, of the counter half a turn. counters: the
    counting signal of a message where its name is not that of sample.counter.
    """

    by: Literal["counter", "sync", "time"]
    within_s: Positive | None = None
    counters: dict[Name, Name] = Field(default_factory=dict)


class TemperatureRole(StrictModel):
    """The signal that carries the device's own temperature, degC."""

    message: Name
    signal: Name


class EndToEnd(StrictModel):
    """AUTOSAR end-to-end protection. P01: data_id and mode; P02: data_ids, one for each counter value."""

    profile: Literal["P01", "P02"]
    mode: Literal["both", "alt", "low", "nibble"] = "both"
    data_id: Annotated[int, Field(ge=0, le=0xFFFF)] | None = None
    data_id_plus_node: bool = False
    data_ids: tuple[Annotated[int, Field(ge=0, le=0xFF)], ...] | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.profile == "P01" and (self.data_id is None or self.data_ids is not None):
            raise InvalidValue("e2e-needs-data-id")
        if self.profile == "P02" and (self.data_ids is None or len(self.data_ids) != 16 or self.data_id is not None):
            raise InvalidValue("e2e-needs-data-ids")
        return self

    @property
    def counter_values(self) -> int:
        """How many values the profile's counter takes: P01 counts 0–14, P02 0–15."""
        return 15 if self.profile == "P01" else 16

    def data_id_of(self, node: int) -> int:
        """Profile 1's 16-bit data id of a node."""
        return ((self.data_id or 0) + (node if self.data_id_plus_node else 0)) & 0xFFFF


class FrameMap(StrictModel):
    """The roles of a DBC's signals. The DBC describes the device with node id `node_of_dbc`.

    The frames of node n have the DBC's identifiers − node_of_dbc + n. counter_values: how many values the counter
    takes before it starts again at 0; left out: the profile's number, or all that its bits can hold. join: how a
    reading that comes in several messages is put together. sample_period_s: between the readings of one frame, where
    there are several; left out: the frames' period by their number. unit: of the readings, where the DBC says none or
    another. bad_status: what the unit must not say of itself, and the bits of sample.status that say so.
    """

    dbc: Name
    sample: SampleRoles
    temperature: TemperatureRole | None = None
    node_of_dbc: Node = 1
    counter_values: Annotated[int, Field(ge=2, le=1 << 32)] | None = None
    e2e: EndToEnd | None = None
    join: JoinRule | None = None
    sample_period_s: Positive | None = None
    unit: str | None = None
    bad_status: dict[Name, Annotated[int, Field(ge=1, lt=1 << 64)]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _hangs_together(self) -> Self:
        if self.bad_status and self.sample.status is None:
            raise InvalidValue("bad-status-without-status")
        if self.e2e is not None and (self.sample.crc is None or self.sample.counter is None):
            raise InvalidValue("e2e-needs-signals")
        if self.counter_values is not None and self.sample.counter is None:
            raise InvalidValue("counter-values-without-counter")
        if self.e2e is not None and self.counter_values not in (None, self.e2e.counter_values):
            raise InvalidValue("counter-values-of-profile", profile=self.e2e.profile, values=self.e2e.counter_values)
        return self


@dataclass(frozen=True)
class SensorLayout:
    """A frame map whose names have been found in its DBC: what decoding and encoding need.

    sample: the message that gives a reading its time; others: the further messages of a reading. Without slots: what
    follows of the map is looked up once, for every portion of a dwell asks for it again.
    """

    map: FrameMap
    sample: FrameLayout
    temperature: FrameLayout | None
    others: tuple[FrameLayout, ...] = ()

    @cached_property
    def axes(self) -> tuple[SignalLayout, ...]:
        """The signals of the axes that there are; of several readings in a frame those of the first."""
        return tuple(self.signal(names[0]) for names in self.map.sample.axes)

    @cached_property
    def samples_a_frame(self) -> int:
        """Readings in one frame."""
        return len(self.map.sample.axes[0])

    @cached_property
    def axes_are_adjacent(self) -> bool:
        """Whether the axes are decoded at once."""
        return are_adjacent(self.axes)

    @cached_property
    def is_plain(self) -> bool:
        """One message that is always there is one reading of three axes."""
        axes = self.axes
        return (
            not self.others and self.samples_a_frame == 1 and len(axes) == 3 and all(a.selector is None for a in axes)
        )

    @cached_property
    def parts(self) -> tuple[SamplePart, ...]:
        """What of a reading comes together, that which gives it its time first."""
        groups: dict[tuple[str, str | None, tuple[int, ...]], list[Cell]] = {}
        for axis, names in enumerate(self.map.sample.axes):
            for place, name in enumerate(names):
                message, _ = self.map.sample.place(name)
                signal = self.signal(name)
                groups.setdefault((message, signal.selector, signal.selected_by), []).append((3 * place + axis, signal))
        ordered = sorted(groups.items(), key=lambda item: item[0][0] != self.sample.name)
        messages = [(self.message(name), cells) for (name, _, _), cells in ordered]
        return tuple(part_of(message, cells, self.counter_of(message)) for message, cells in messages)

    def signal(self, name: str) -> SignalLayout:
        """The signal that a name of the frame map means. Errors: ProductError."""
        message, signal = self.map.sample.place(name)
        return self.message(message).signal(signal)

    def message(self, name: str) -> FrameLayout:
        """The message of that name among those of a reading."""
        return next(m for m in (self.sample, *self.others) if m.name == name)

    @cached_property
    def counter(self) -> SignalLayout | None:
        """The counting signal."""
        name = self.map.sample.counter
        return None if name is None else self.sample.signal(name)

    @cached_property
    def frame_counter_values(self) -> int:
        """Modulus of the counter of the frames; 1 when there is none."""
        if self.counter is None:
            return 1
        profile = self.map.e2e.counter_values if self.map.e2e else None
        return self.map.counter_values or profile or 1 << self.counter.length

    @cached_property
    def counter_values(self) -> int:
        """Modulus of the count of readings; 1 when there is none."""
        return self.frame_counter_values * self.samples_a_frame if self.counts_readings else 1

    @cached_property
    def crc_byte(self) -> int:
        """Which byte of the sample's payload is the CRC."""
        return self.sample.signal(self.map.sample.crc or "").first_bit // 8

    @cached_property
    def joined_by(self) -> str:
        """What puts the messages of a reading together: counter, sync or time."""
        if self.map.join is not None:
            return self.map.join.by
        counted = self.counter is not None and all(self.counter_of(m) is not None for m in self.others)
        return "counter" if counted and not self.takes_turns else "time"

    @cached_property
    def takes_turns(self) -> bool:
        """Whether the frames of one message carry the axes by turns."""
        signals = [(m, m.signal(s)) for m, s in map(self._placed, self.map.sample.axes)]
        ways = {(m.name, s.selector, s.selected_by) for m, s in signals}
        return len({name for name, _, _ in ways}) < len(ways)

    @cached_property
    def counts_readings(self) -> bool:
        """Whether there is a counter that goes on by one from one leading frame to the next."""
        return self.counter is not None and (not self.takes_turns or self.joined_by == "counter")

    def _placed(self, names: tuple[str, ...]) -> tuple[FrameLayout, str]:
        message, signal = self.map.sample.place(names[0])
        return self.message(message), signal

    def counter_of(self, message: FrameLayout) -> SignalLayout | None:
        """The counting signal of one of the messages; None where it has none."""
        join = self.map.join
        name = (join.counters if join is not None else {}).get(message.name, self.map.sample.counter)
        return next((s for s in message.signals if s.name == name), None)

    def ids(self, node: int) -> tuple[int, ...]:
        """Identifiers of a node's sample and temperature frames, and of SYNC where it is needed, for a channel's
        filter."""
        layouts = [self.sample, *self.others, *([] if self.temperature is None else [self.temperature])]
        sync = (SYNC,) if self.joined_by == "sync" else ()
        return tuple(dict.fromkeys((*(self.id_of(layout, node) for layout in layouts), *sync)))

    def id_of(self, layout: FrameLayout, node: int) -> int:
        """Identifier of a message when a node sends it; ProductError when it does not fit its format."""
        can_id = layout.can_id - self.map.node_of_dbc + node
        if not 0 <= can_id & ~EXTENDED <= (0x1FFF_FFFF if layout.can_id & EXTENDED else 0x7FF):
            raise ProductError(
                "identifier-out-of-range", dbc=self.map.dbc, message=layout.name, node=node, can_id=can_id
            )
        return can_id

    def scaled(self, factors: Mapping[str, float], unit: str) -> "SensorLayout":
        """The same with every axis in `unit`; factors: by name of the frame map, of its own unit to that one."""
        changed = {self.map.sample.place(name): factor for name, factor in factors.items() if factor != 1.0}
        frames = [_scaled(m, {s: f for (of, s), f in changed.items() if of == m.name}, unit) for m in self.messages]
        return replace(self, sample=frames[0], others=tuple(frames[1:]))

    @cached_property
    def temperature_rides(self) -> bool:
        """Whether the temperature stands in a message of the readings."""
        return self.temperature is not None and self.temperature.name in {m.name for m in self.messages}

    @cached_property
    def messages(self) -> tuple[FrameLayout, ...]:
        """The messages of a reading, that which gives it its time first."""
        return self.sample, *self.others


def _scaled(message: FrameLayout, factors: Mapping[str, float], unit: str) -> FrameLayout:
    if not factors:
        return message

    def times(value: float | None, factor: float) -> float | None:
        return None if value is None else value * factor

    def one(signal: SignalLayout) -> SignalLayout:
        factor = factors.get(signal.name)
        if factor is None:
            return signal
        scaled = replace(signal, scale=signal.scale * factor, offset=signal.offset * factor, unit=unit)
        return replace(scaled, minimum=times(signal.minimum, factor), maximum=times(signal.maximum, factor))

    return replace(message, signals=tuple(one(s) for s in message.signals))


def used_signals(roles: FrameMap) -> dict[str, frozenset[str]]:
    """The signals of a DBC that a product uses, by message."""
    used: dict[str, frozenset[str]] = {roles.sample.message: frozenset(roles.sample.controls)}
    places = [roles.sample.place(name) for names in roles.sample.axes for name in names]
    if roles.temperature is not None:
        places.append((roles.temperature.message, roles.temperature.signal))
    places += (roles.join.counters if roles.join is not None else {}).items()
    for message, signal in places:
        used[message] = used.get(message, frozenset()) | {signal}
    return used


def resolve(roles: FrameMap, layouts: Mapping[str, FrameLayout]) -> SensorLayout:
    """Finds a frame map's names among the messages of its DBC; ProductError names what is missing or cannot be."""
    sample = _message(roles.dbc, layouts, roles.sample.message)
    places = [roles.sample.place(name) for names in roles.sample.axes for name in names]
    others = tuple(
        _message(roles.dbc, layouts, name)
        for name in dict.fromkeys(message for message, _ in places)
        if name != sample.name
    )
    temperature = None
    layout = SensorLayout(roles, sample, None, others)
    try:
        for name in roles.sample.controls:
            sample.signal(name)
        for message, signal in places:
            layout.message(message).signal(signal)
        if roles.temperature is not None:
            temperature = _message(roles.dbc, layouts, roles.temperature.message)
            temperature.signal(roles.temperature.signal)
    except ProductError as error:
        raise ProductError("frame-map-names", dbc=roles.dbc, reason=error.message) from None
    layout = replace(layout, temperature=temperature)
    _check_counter(layout)
    _check_bad_status(layout)
    _check_crc(layout)
    _check_join(layout)
    return layout


def _message(dbc: str, layouts: Mapping[str, FrameLayout], name: str) -> FrameLayout:
    if name not in layouts:
        raise ProductError("dbc-message-unknown", dbc=dbc, message=name, known=tuple(layouts))
    return layouts[name]


def _check_counter(layout: SensorLayout) -> None:
    counter = layout.counter
    if counter is None:
        return
    if counter.is_float or counter.signed or counter.selector is not None:
        raise ProductError("counter-not-unsigned", dbc=layout.map.dbc, counter=counter.name)
    if layout.frame_counter_values > 1 << counter.length:
        where = {"dbc": layout.map.dbc, "counter": counter.name}
        raise ProductError("counter-too-short", bits=counter.length, values=layout.frame_counter_values, **where)


def _check_bad_status(layout: SensorLayout) -> None:
    for name, bits in layout.map.bad_status.items():
        status = layout.sample.signal(layout.map.sample.status or "")
        if status.is_float or bits >> status.length:
            where = {"dbc": layout.map.dbc, "status": status.name}
            raise ProductError("bad-status-beyond-status", name=name, bits=f"0x{bits:X}", length=status.length, **where)


def _check_crc(layout: SensorLayout) -> None:
    if layout.map.e2e is None:
        return
    crc = layout.sample.signal(layout.map.sample.crc or "")
    if crc.length != 8 or crc.first_bit % 8:
        raise ProductError("crc-not-byte", dbc=layout.map.dbc, crc=crc.name, profile=layout.map.e2e.profile)


def _check_join(layout: SensorLayout) -> None:
    join = layout.map.join
    if join is None or join.by != "counter":
        return
    for message in layout.messages:
        if layout.counter_of(message) is None:
            raise ProductError("join-without-counter", dbc=layout.map.dbc, message=message.name)
