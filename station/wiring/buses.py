"""The bus that config.yaml names by its file in adapters/bus, with its own options checked."""

from typing import Any, ClassVar, Protocol

from pydantic import BaseModel

from station import plugins
from station.config.documents import Document
from station.config.settings import BusSettings
from station.errors import ConfigError
from station.ports.bus import Bus
from station.ports.clock import Clock
from station.wiring.options import options_of

BUSES = "station.adapters.bus"


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
    """The class behind `bus.interface`. Errors: ConfigError for an unknown one."""
    known = plugins.names(BUSES)
    if bus.interface not in known:
        raise ConfigError("bus-unknown", given=bus.interface, known=", ".join(known))
    kind: Any = plugins.load(BUSES, bus.interface)
    found: BusKind = kind
    return found


def bus_options(bus: BusSettings, document: Document) -> BaseModel:
    """Its own options, checked. Errors: ConfigError with line and key."""
    return options_of("bus", bus.options, document, bus_kind(bus).Settings)


def open_bus(bus: BusSettings, document: Document, clock: Clock) -> Bus:
    """Opens it. Errors: ConfigError for its options or an absent interface, LogError for a recording."""
    return bus_kind(bus).open(bus.channel, clock, bus_options(bus, document))
