"""One bus, one owner: a second station on the same CAN interface is refused with the first one's name."""

import tempfile
import time
from pathlib import Path

from station.config.settings import BusSettings
from station.errors import BusFault
from station.files.owner import OwnerLock
from station.messages import Message

#: Where programs of every user of a machine keep the locks of its devices (FHS 3.0, 3.15.4 and 5.9).
_LOCKS = Path("/run/lock")
#: Any user of the machine may send on its buses, and may be the next to own one.
_EVERYBODY = 0o666


def claim_bus(bus: BusSettings, name: str) -> OwnerLock:
    """Takes the interface for the station of that name, until it is released or dies.

    Errors: BusFault with the name, process and start of the station that has it.
    """
    what = Message("owned-bus", channel=bus.channel)
    return OwnerLock(lock_path(bus.channel), what, name, time.time_ns(), BusFault, _EVERYBODY)


def lock_path(channel: str) -> Path:
    """The lock of an interface; each network namespace has interfaces of its own."""
    folder = _LOCKS if _LOCKS.is_dir() else Path(tempfile.gettempdir())
    space = Path("/proc/self/ns/net")
    number = space.stat().st_ino if space.exists() else 0
    name = "".join(c if c.isalnum() else "_" for c in channel)
    return folder / f"station-{name}-{number}.lock"
