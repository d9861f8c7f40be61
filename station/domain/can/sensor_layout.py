"""Which message and signals of a DBC play which role: the block `frames:` of a product file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import EXTENDED
from station.domain.recipe.fields import Name, StrictModel
from station.errors import InvalidValue, ProductError

Node = Annotated[int, Field(ge=1, le=127)]


class SampleRoles(StrictModel):
    """The message that carries one reading, and the names of its signals."""

    message: Name
    x: Name
    y: Name
    z: Name
    counter: Name | None = None
    status: Name | None = None
    crc: Name | None = None


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
    takes before it starts again at 0; left out: the profile's number, or all that its bits can hold.
    """

    dbc: Name
    sample: SampleRoles
    temperature: TemperatureRole | None = None
    node_of_dbc: Node = 1
    counter_values: Annotated[int, Field(ge=2, le=1 << 32)] | None = None
    e2e: EndToEnd | None = None

    @model_validator(mode="after")
    def _hangs_together(self) -> Self:
        if self.e2e is not None and (self.sample.crc is None or self.sample.counter is None):
            raise InvalidValue("e2e-needs-signals")
        if self.counter_values is not None and self.sample.counter is None:
            raise InvalidValue("counter-values-without-counter")
        if self.e2e is not None and self.counter_values not in (None, self.e2e.counter_values):
            raise InvalidValue("counter-values-of-profile", profile=self.e2e.profile, values=self.e2e.counter_values)
        return self


@dataclass(frozen=True, slots=True)
class SensorLayout:
    """A frame map whose names have been found in its DBC: what decoding and encoding need."""

    map: FrameMap
    sample: FrameLayout
    temperature: FrameLayout | None

    @property
    def axes(self) -> tuple[SignalLayout, SignalLayout, SignalLayout]:
        """The signals x, y, z."""
        roles = self.map.sample
        return self.sample.signal(roles.x), self.sample.signal(roles.y), self.sample.signal(roles.z)

    @property
    def counter(self) -> SignalLayout | None:
        """The counting signal."""
        name = self.map.sample.counter
        return None if name is None else self.sample.signal(name)

    @property
    def counter_values(self) -> int:
        """Modulus of the counter; 1 when there is none."""
        if self.counter is None:
            return 1
        profile = self.map.e2e.counter_values if self.map.e2e else None
        return self.map.counter_values or profile or 1 << self.counter.length

    @property
    def crc_byte(self) -> int:
        """Which byte of the sample's payload is the CRC."""
        return self.sample.signal(self.map.sample.crc or "").first_bit // 8

    def ids(self, node: int) -> tuple[int, ...]:
        """Identifiers of a node's sample and temperature frames, for a channel's filter."""
        layouts = [self.sample] if self.temperature is None else [self.sample, self.temperature]
        return tuple(self.id_of(layout, node) for layout in layouts)

    def id_of(self, layout: FrameLayout, node: int) -> int:
        """Identifier of a message when a node sends it; ProductError when it does not fit its format."""
        can_id = layout.can_id - self.map.node_of_dbc + node
        if not 0 <= can_id & ~EXTENDED <= (0x1FFF_FFFF if layout.can_id & EXTENDED else 0x7FF):
            raise ProductError(
                "identifier-out-of-range", dbc=self.map.dbc, message=layout.name, node=node, can_id=can_id
            )
        return can_id


def used_signals(roles: FrameMap) -> dict[str, frozenset[str]]:
    """The signals of a DBC that a product uses, by message."""
    sample = frozenset(v for k, v in roles.sample if k != "message" and v is not None)
    used = {roles.sample.message: sample}
    if roles.temperature is not None:
        message = roles.temperature.message
        used[message] = used.get(message, frozenset()) | {roles.temperature.signal}
    return used


def resolve(roles: FrameMap, layouts: Mapping[str, FrameLayout]) -> SensorLayout:
    """Finds a frame map's names among the messages of its DBC; ProductError names what is missing or cannot be."""
    sample = _message(roles.dbc, layouts, roles.sample.message)
    temperature = None
    try:
        for name in (v for k, v in roles.sample if k != "message" and v is not None):
            sample.signal(name)
        if roles.temperature is not None:
            temperature = _message(roles.dbc, layouts, roles.temperature.message)
            temperature.signal(roles.temperature.signal)
    except ProductError as error:
        raise ProductError("frame-map-names", dbc=roles.dbc, reason=error.message) from None
    layout = SensorLayout(roles, sample, temperature)
    _check_counter(layout)
    _check_crc(layout)
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
    if layout.counter_values > 1 << counter.length:
        where = {"dbc": layout.map.dbc, "counter": counter.name}
        raise ProductError("counter-too-short", bits=counter.length, values=layout.counter_values, **where)


def _check_crc(layout: SensorLayout) -> None:
    if layout.map.e2e is None:
        return
    crc = layout.sample.signal(layout.map.sample.crc or "")
    if crc.length != 8 or crc.first_bit % 8:
        raise ProductError("crc-not-byte", dbc=layout.map.dbc, crc=crc.name, profile=layout.map.e2e.profile)
