"""The positioner that config.yaml names, with its own options checked."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from station import plugins
from station.adapters.clock import VirtualClock
from station.config.documents import Document
from station.config.rigs import load_rig
from station.config.settings import BusSettings, Settings
from station.domain.rig.rig_map import RigMap
from station.errors import ConfigError, UsageError
from station.ports.bus import Bus
from station.ports.clock import Clock
from station.ports.positioner import Positioner
from station.wiring.bus_owner import claim_bus
from station.wiring.buses import bus_kind, open_bus
from station.wiring.options import options_of

POSITIONERS = "station.adapters.positioner"
#: Those whose `map` is one of axes (rigs/).
AXIS_KINDS = ("cia402", "gcode")
#: Words for `positioner.channel`: drives inside this process; drives on the units' bus. Any other is a channel.
SIMULATED, UNITS = "simulated", "units"


def positioner(settings: Settings, document: Document, clock: Clock) -> Positioner:
    """Builds it. Errors: UsageError for an unknown kind, ConfigError for its options."""
    made: Any = plugins.load(POSITIONERS, settings.positioner.kind)
    options = positioner_options(settings, document)
    built: Positioner = made(options, clock)
    return built


def positioner_options(settings: Settings, document: Document) -> Any:
    """Its own options, checked. Errors: UsageError, ConfigError."""
    made: Any = plugins.load(POSITIONERS, settings.positioner.kind)
    return options_of("positioner", settings.positioner.options, document, made.Settings)


def connected_positioner(
    settings: Settings, document: Document, clock: Clock, units_bus: Callable[[], Bus], opened: ExitStack
) -> Positioner:
    """The same with its drives on a bus: that of the units, or one of its own, which is closed with `opened`.

    Errors: UsageError, ConfigError; BusFault where another station has that bus.
    """
    made: Any = plugins.load(POSITIONERS, settings.positioner.kind)
    if not getattr(made, "on_a_bus", False):
        alone = positioner(settings, document, clock)
        opened.callback(getattr(alone, "close", lambda: None))  # a connection, a serial port
        return alone
    options = positioner_options(settings, document)
    if options.channel == SIMULATED:
        raise UsageError("rig-without-bus")
    built: Positioner = made(options, clock, bus_of_drives(settings, document, clock, units_bus, opened))
    return built


def bus_of_drives(
    settings: Settings, document: Document, clock: Clock, units_bus: Callable[[], Bus], opened: ExitStack
) -> Bus:
    """The bus that the drives are on. Errors: ConfigError; BusFault where another station has it."""
    options = positioner_options(settings, document)
    if options.channel in (UNITS, settings.bus.channel):
        refuse_nodes_of_units(settings, load_rig(options.map))
        return units_bus()
    own = BusSettings(interface=options.interface, channel=options.channel)
    if bus_kind(own).interface_of_kernel:
        opened.callback(claim_bus(own, settings.station).release)
    bus = open_bus(own, document, clock)
    opened.callback(bus.close)
    return bus


def refuse_nodes_of_units(settings: Settings, rig: RigMap) -> None:
    """Errors: ConfigError where a drive or the station itself has the node id of a nest, on one bus."""
    taken = {axis.node: axis.name for axis in rig.axes} | {rig.station_node: "station_node"}
    for nest in settings.nests:
        if nest.node in taken:
            raise ConfigError("rig-node-of-nest", node=nest.node, nest=nest.name, of=taken[nest.node], rig=rig.name)


def refuse_numbers_for_real_units(settings: Settings, built: Positioner) -> None:
    """Errors: UsageError where a positioner that turns nothing is to turn units on a wire."""
    if built.turns_nothing and bus_kind(settings.bus).on_a_wire(settings.bus.channel):
        raise UsageError("positioner-moves-nothing", bus=settings.bus.channel)


def unused_positioner(settings: Settings, document: Document) -> Positioner:
    """The same for its estimates only: nothing is moved with it. Errors: UsageError, ConfigError."""
    return positioner(settings, document, VirtualClock())
