"""CAN buses, one file each: a real interface, a recording, a simulated one; and CAN logs as files."""

from typing import Any

from station import plugins
from station.adapters.bus._logs import read_blocks, read_log, write_log
from station.errors import ConfigError
from station.ports.bus import Bus
from station.ports.clock import Clock

__all__ = ["open_bus", "read_blocks", "read_log", "write_log"]


def open_bus(interface: str, channel: str, clock: Clock, *, receive_buffer_bytes: int | None = None) -> Bus:
    """Opens a bus by the name of its file: socketcan can0, replay some.log, simulated NAME (on an EventClock).

    receive_buffer_bytes: of a stream in the kernel; left out: the bus's own choice. Only socketcan has one.

    Errors: ConfigError for an unknown or absent interface, LogError for a log that cannot be read.
    """
    if interface not in plugins.names(__name__):
        known = ", ".join(plugins.names(__name__))
        raise ConfigError(f"bus.interface {interface!r} is unknown; the known ones are {known}")
    kind: Any = plugins.load(__name__, interface)
    bus: Bus = kind.open(channel, clock, receive_buffer_bytes)
    return bus
