"""The CAN interface of this machine, beside a run: its link, its state, and what passes on it."""

from station.adapters.bus._netlink import Link, query_link
from station.adapters.bus.socketcan import SocketCan, state_of
from station.config.settings import BusSettings
from station.ports.bus import Bus

__all__ = ["Link", "bitrate_of", "open_listener", "query_link", "state_of"]


def bitrate_of(bus: BusSettings) -> int:
    """The bit rate that config.yaml wants of the link, bit/s."""
    return SocketCan.Settings.model_validate(bus.options).bitrate


def open_listener(name: str) -> Bus:
    """The interface, to listen. Errors: BusFault."""
    return SocketCan(name)
