"""Drives inside this process, for a positioner without a bus: a bench in numbers, and every conformance test."""

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.simulated_device.drive.node import drives_of
from station.adapters.simulated_device.grbl import GrblStub
from station.domain.rig.rig_map import RigMap
from station.errors import UsageError
from station.ports.bus import Bus
from station.ports.clock import Clock, EventClock


def twin_bus(rig: RigMap, clock: Clock) -> Bus:
    """A bus with the rig's drives on it, on simulated time. Errors: UsageError on a real clock."""
    if not isinstance(clock, EventClock):
        raise UsageError("rig-without-bus")
    bus = SimulatedBus(clock, "simulated rig")
    for drive in drives_of(rig, bus.endpoint, clock):
        clock.attach(drive)
    return bus


class TwinPort:
    """A serial port with a simulated GRBL controller behind it, on the clock of whoever asks."""

    def __init__(self, stub: GrblStub, clock: Clock) -> None:
        self.stub, self._clock = stub, clock

    def write(self, data: bytes) -> None:
        """To the controller."""
        self.stub.feed(data, self._clock.monotonic_s())

    def read(self, _size: int) -> bytes:
        """From it."""
        return self.stub.answers(self._clock.monotonic_s())

    def close(self) -> None:
        """Nothing to close."""


def twin_port(rig: RigMap, clock: Clock) -> TwinPort:
    """A controller of the rig's acceleration."""
    return TwinPort(GrblStub(min(axis.acceleration_deg_s2 for axis in rig.axes)), clock)
