"""`station rig --simulate cia402`: simulated drives on a real bus, in a process of their own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from station.adapters.clock import SystemClock
from station.adapters.simulated_device.drive import drive_fault
from station.adapters.simulated_device.drive.node import SimulatedDrive, drives_of, heard_ids
from station.adapters.simulated_device.live import Hub, serve
from station.config.rigs import load_rig
from station.config.settings import BusSettings
from station.domain.rig.rig_map import RigMap
from station.wiring.buses import open_endpoint


@dataclass(frozen=True, slots=True)
class LiveRig:
    """Simulated drives on their interface: they listen as soon as this is made."""

    rig: RigMap
    drives: Sequence[SimulatedDrive]
    hub: Hub
    close: Callable[[], None]

    @classmethod
    def open(cls, name: str, bus: BusSettings, faults: Sequence[str]) -> "LiveRig":
        """The drives of a rig by name. Errors: ConfigError for map and interface, UsageError for a fault."""
        rig = load_rig(name)
        parsed = [drive_fault.parse(text) for text in faults]
        ids = sorted({i for axis in rig.axes for i in heard_ids(axis.node, rig.station_node)})
        channel = open_endpoint(bus, SystemClock(), tuple(ids))
        hub = Hub(channel)
        return cls(rig, drives_of(rig, lambda _ids: hub.endpoint(), SystemClock(), parsed), hub, channel.close)

    def live(self, go_on: Callable[[], bool]) -> None:
        """Serves the bus for as long as `go_on()`, then leaves it."""
        try:
            serve(self.hub, self.drives, SystemClock(), go_on)
        finally:
            self.close()
