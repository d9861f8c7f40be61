"""The CAN interface of this machine, beside a run: its link, its state, and what passes on it."""

from pydantic import ValidationError

from station.adapters.bus._netlink import Link, query_link
from station.adapters.bus.socketcan import SocketCan, state_of
from station.config.settings import BusSettings
from station.config.validation_messages import mistakes
from station.errors import ConfigError
from station.ports.bus import Bus

__all__ = ["Link", "bitrate_of", "open_listener", "query_link", "state_of"]


def bitrate_of(bus: BusSettings) -> int:
    """The bit rate that config.yaml wants of the link, bit/s. Errors: ConfigError."""
    try:
        return SocketCan.Settings.model_validate(bus.options).bitrate
    except ValidationError as exc:
        raise ConfigError("options-mistakes", mistakes=mistakes(exc, SocketCan.Settings)) from None


def open_listener(name: str) -> Bus:
    """The interface, to listen. Errors: BusFault."""
    return SocketCan(name)
