"""What the bus itself complains of while a fixture is measured: bus-off ends the run, the rest goes into the record."""

from station.domain.can.error_frames import error_frames, has_bus_off
from station.domain.core.types import Frames
from station.errors import BusFault, DeviceSilent, StationError
from station.ports.bus import Bus

#: States in which a device's silence is the bus's doing, with what to look at.
_STATE_REMEDIES = {
    "down": "is down: bring it up",
    "bus-off": "is bus-off: look at bit rate, wiring and termination first",
    "passive": "is passive, nobody acknowledges its frames: look at cable, termination and bit rate first",
}


def refuse_bus_off(frames: Frames, bus: Bus) -> Frames:
    """The same frames. Errors: BusFault when the controller went bus-off among them and did not come back."""
    if has_bus_off(frames):
        raise BusFault(f"{bus.name}: {'; '.join(error_frames(frames))}; nothing can be measured until that is repaired")
    return frames


def with_bus_state(fault: StationError, bus: Bus) -> StationError:
    """A device's silence with the state of the bus, where that tells why."""
    if isinstance(fault, DeviceSilent) and (state := bus.state()) in _STATE_REMEDIES:
        return DeviceSilent(f"{fault.sentence}; {bus.name} {_STATE_REMEDIES[state]}")
    return fault
