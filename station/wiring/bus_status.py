"""The CAN interface of this machine, beside a run: its link, its state, and what passes on it."""

from station.adapters.bus._netlink import Link, query_link
from station.adapters.bus.socketcan import SocketCan, state_of
from station.ports.bus import Bus

__all__ = ["Link", "open_listener", "query_link", "state_of"]


def open_listener(name: str) -> Bus:
    """The interface, to listen. Errors: BusFault."""
    return SocketCan(name)
