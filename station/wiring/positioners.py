"""The positioner that config.yaml names, with its own options checked."""

from typing import Any

from station import plugins
from station.adapters.clock import VirtualClock
from station.config.documents import Document
from station.config.settings import Settings
from station.errors import UsageError
from station.ports.clock import Clock
from station.ports.positioner import Positioner
from station.wiring.buses import bus_kind
from station.wiring.options import options_of

POSITIONERS = "station.adapters.positioner"


def positioner(settings: Settings, document: Document, clock: Clock) -> Positioner:
    """Builds it. Errors: UsageError for an unknown kind, ConfigError for its options."""
    made: Any = plugins.load(POSITIONERS, settings.positioner.kind)
    options = options_of("positioner", settings.positioner.options, document, made.Settings)
    built: Positioner = made(options, clock)
    return built


def refuse_numbers_for_real_units(settings: Settings, built: Positioner) -> None:
    """Errors: UsageError where a positioner that turns nothing is to turn units on a wire."""
    if built.turns_nothing and bus_kind(settings.bus).on_a_wire(settings.bus.channel):
        raise UsageError("positioner-moves-nothing", bus=settings.bus.channel)


def unused_positioner(settings: Settings, document: Document) -> Positioner:
    """The same for its estimates only: nothing is moved with it. Errors: UsageError, ConfigError."""
    return positioner(settings, document, VirtualClock())
