"""What the bus itself reports while a fixture is measured: bus-off ends the run, the rest goes into the record."""

from station.domain.can.error_frames import error_frames, has_bus_off
from station.domain.core.types import Frames
from station.errors import BusFault, DeviceSilent, StationError
from station.messages import Message
from station.ports.bus import Bus

#: States of the bus that explain a device's silence, each with its remedy.
STATE_REMEDIES = {"down": "bus-is-down", "bus-off": "bus-is-off", "passive": "bus-is-passive"}


def refuse_bus_off(frames: Frames, bus: Bus) -> Frames:
    """The same frames. Errors: BusFault when the controller went bus-off among them and did not come back."""
    if has_bus_off(frames):
        raise BusFault("bus-off-while-measuring", bus=bus.name, errors=error_frames(frames))
    return frames


def with_bus_state(fault: StationError, bus: Bus) -> StationError:
    """A device's silence with the state of the bus, where that tells why."""
    if isinstance(fault, DeviceSilent) and (state := bus.state()) in STATE_REMEDIES:
        remedy = Message(STATE_REMEDIES[state], bus=bus.name)
        return DeviceSilent("silence-of-bus", fault=fault.message, bus=remedy)
    return fault
