"""The bus that config.yaml names by its file in adapters/bus, with its own options checked."""

import re
from typing import Any, ClassVar, Protocol

from pydantic import BaseModel, ValidationError

from station import plugins
from station.adapters.bus._several import SeveralBuses
from station.config.documents import Document
from station.config.settings import BusSettings, Settings
from station.config.validation_messages import mistakes
from station.errors import ConfigError, StationError, UsageError
from station.ports.bus import Bus, Endpoint
from station.ports.clock import Clock
from station.wiring.options import options_of

BUSES, PYTHON_CAN = "station.adapters.bus", "python-can"


class BusKind(Protocol):
    """What the one public class of a file in adapters/bus offers beside the bus itself.

    interface_of_kernel: the channel is a network interface of this machine, which one station at a time may have.
    without_units: only simulated units can be on it.
    """

    interface_of_kernel: ClassVar[bool]
    without_units: ClassVar[bool]
    Settings: ClassVar[type[BaseModel]]

    @classmethod
    def on_a_wire(cls, channel: str) -> bool:
        """Whether real units may be behind the channel."""

    @classmethod
    def open(cls, channel: str, clock: Clock, settings: Any) -> Bus:
        """The bus of that channel. Errors: ConfigError, LogError."""


def bus_kind(bus: BusSettings) -> BusKind:
    """The class behind `bus.interface`: a file here, else python-can's interface of that name. Errors: ConfigError."""
    own = plugins.names(BUSES)
    if bus.interface not in own and bus.interface not in python_can_interfaces():
        if re.fullmatch(r"(v|sl)?can\d+", bus.interface):
            raise ConfigError("bus-is-channel", given=bus.interface)
        known = ", ".join((*own, *python_can_interfaces()))
        raise ConfigError("bus-unknown", given=bus.interface, known=known)
    kind: Any = plugins.load(BUSES, bus.interface if bus.interface in own else PYTHON_CAN)
    found: BusKind = kind
    return found


def bus_options(bus: BusSettings, document: Document, block: tuple[str, ...] = ("bus",)) -> BaseModel:
    """Its own options, checked. Errors: ConfigError with line and key."""
    options = options_of(block, bus.options, document, bus_kind(bus).Settings)
    if bus.interface in plugins.names(BUSES):
        return options
    return options.model_copy(update={"driver": bus.interface})


def python_can_interfaces() -> tuple[str, ...]:
    """Interfaces that python-can brings or that a package adds to it, but for those that are a file here."""
    from station.adapters.bus.python_can import interfaces

    return tuple(name for name in interfaces() if name not in plugins.names(BUSES))


def open_bus(bus: BusSettings, document: Document, clock: Clock, block: tuple[str, ...] = ("bus",)) -> Bus:
    """Opens it. Errors: ConfigError for its options or an absent interface, LogError for a recording."""
    return bus_kind(bus).open(bus.channel, clock, bus_options(bus, document, block))


def named_bus(interface: str, channel: str) -> BusSettings:
    """A bus as the command line names it. Errors: UsageError."""
    try:
        return BusSettings(interface=interface, channel=channel)
    except ValidationError as exc:
        raise UsageError("options-mistakes", mistakes=mistakes(exc, BusSettings)) from None


def open_interface(bus: BusSettings, clock: Clock) -> Bus:
    """A bus that the command line names, without options of its own. Errors: ConfigError."""
    kind = bus_kind(bus)
    own = bus.interface in plugins.names(BUSES)
    return kind.open(bus.channel, clock, kind.Settings.model_validate({} if own else {"driver": bus.interface}))


def open_endpoint(bus: BusSettings, clock: Clock, can_ids: tuple[int, ...]) -> Endpoint:
    """A channel for simulated devices. Errors: ConfigError, also for an interface that only reads."""
    channel = open_interface(bus, clock).service(can_ids)
    if not isinstance(channel, Endpoint):
        channel.close()
        raise ConfigError("interface-only-reads", interface=bus.interface)
    return channel


def used_buses(settings: Settings) -> dict[str, BusSettings]:
    """The fixture's buses by name; the one of `bus` has none."""
    return dict(settings.buses) or {"": settings.bus}


def open_buses(settings: Settings, document: Document, clock: Clock) -> Bus:
    """Opens the bus of the fixture, or all of them as one. Errors: as open_bus."""
    if not settings.buses:
        return open_bus(settings.bus, document, clock)
    parts: dict[str, Bus] = {}
    try:
        for name, bus in settings.buses.items():
            parts[name] = open_bus(bus, document, clock, ("buses", name))
    except StationError:
        for opened in parts.values():
            opened.close()
        raise
    return SeveralBuses(parts, {nest.node: nest.bus for nest in settings.nests if nest.bus is not None})
