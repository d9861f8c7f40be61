"""Drives inside this process, for a positioner without a bus: a bench in numbers, and every conformance test."""

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.simulated_device.drive.node import drives_of
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
