"""The simulated fixture turned by simulated drives: commanded over the same bus as real ones, by the same adapter."""

from collections.abc import Callable

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import VirtualClock
from station.adapters.positioner.cia402 import Cia402Positioner
from station.adapters.positioner.simulated import MoveListener
from station.adapters.simulated_device.drive.node import angles_of, drives_of
from station.config.documents import Document
from station.config.settings import Settings
from station.domain.core.types import Floats
from station.domain.recipe.plan import PlannedVisit
from station.domain.rig import kinematics
from station.domain.rig.rig_map import RigMap
from station.ports.positioner import MeasuredPose
from station.wiring.positioners import positioner_options, refuse_nodes_of_units

#: A move that is longer under way than this ends by itself, s; nobody knows beforehand how long it takes.
_UNTIL_S = 3600.0


class DrivenFixture:
    """A positioner whose drives turn the simulated plate. moving, arrived: told when a move begins, when it
    ends; mounted: how the rig is built, where it is not as its map says."""

    by_hand = False
    turns_nothing = True

    def __init__(
        self,
        settings: Settings,
        document: Document,
        clock: VirtualClock,
        bus: SimulatedBus,
        moving: MoveListener,
        arrived: Callable[[float], None],
        mounted: RigMap | None = None,
    ) -> None:
        options = positioner_options(settings, document)
        self._clock, self._moving, self._arrived = clock, moving, arrived
        self._drives = Cia402Positioner(options, clock, bus)
        self._options, self._bus = options, bus
        self._map = mounted or self._drives.rig
        refuse_nodes_of_units(settings, self._drives.rig)
        self._motors = drives_of(self._map, bus.endpoint, clock)
        for motor in self._motors:
            clock.attach(motor)

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Turns to the stop. Errors: PositionerFault, BusFault."""
        now_s = self._clock.monotonic_s()
        self._moving(stop, now_s, now_s + _UNTIL_S)
        self._drives.move(stop, timeout_s)
        self._arrived(self._clock.monotonic_s())

    def where(self) -> MeasuredPose | None:
        """By the encoders."""
        return self._drives.where()

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """Time of the quickest safe way. Errors: PositionerFault."""
        return self._drives.estimate_s(origin, stop)

    def park(self, timeout_s: float) -> None:
        """Turns to the parking place. Errors: PositionerFault, BusFault."""
        self._drives.park(timeout_s)

    def of_map(self, rig: RigMap) -> Cia402Positioner:
        """A positioner of another map, on the same drives."""
        return Cia402Positioner(self._options, self._clock, self._bus, rig)

    def plate(self, time_s: Floats) -> Floats:
        """True nest → station rotations (n, 3, 3) at instants (n)."""
        return kinematics.attitudes(self._map.directions, angles_of(self._map, self._motors, time_s))
