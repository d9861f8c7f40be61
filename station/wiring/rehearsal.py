"""The rehearsal bench: where config.yaml's bus is `simulated`, every command works as on a bench, without one."""

from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from station.config.settings import RehearsalSettings, Settings, load_settings
from station.errors import ConfigError
from station.wiring.buses import bus_kind
from station.wiring.run_order import RunOrder


def is_rehearsal(settings: Settings) -> bool:
    """Whether config.yaml describes a rehearsal bench. Errors: ConfigError where it contradicts itself."""
    # Nothing but devices of this process can be on python-can's virtual bus: they live in real time there.
    simulated = bus_kind(settings.bus).without_units or settings.bus.interface == "virtual"
    if settings.rehearsal is not None and not simulated:
        for key in settings.bus.options:
            if nearest := get_close_matches(key, ("interface",)):
                raise ConfigError("bus-key-near", key=key[:40], nearest=nearest[0])
        raise ConfigError("rehearsal-on-real-bus", interface=settings.bus.interface)
    return simulated


def rehearsed(order: RunOrder, settings: Settings) -> RunOrder:
    """The order as it is carried out: simulated on a rehearsal bench, with the devices that config.yaml describes.

    An interface on the command line is a real one, and config.yaml's rehearsal is left aside.
    """
    if order.interface is not None or not is_rehearsal(settings):
        return order
    own = settings.rehearsal or RehearsalSettings()
    memory = None if order.simulate else Path(own.device_state)
    return replace(
        order,
        simulate=True,
        device_state=order.device_state or memory,
        faults=order.faults if order.simulate else (*order.faults, *own.faults),
    )


def rehearsing(config: Path | None) -> bool:
    """Whether the config file of a command describes a rehearsal bench. Errors: ConfigError."""
    return is_rehearsal(load_settings(config))
