"""The simulated fixture turned by a simulated machine, which the adapter of a bench commands as it would the real one.

The machine is a twin in this process, on the clock of the units, or a process of its own at an address of this machine
(`station rig --simulate`), which turns in real time. A real machine is never commanded.
"""

import ipaddress
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from station.adapters.clock import SystemClock
from station.adapters.modbus import PlcLink, load_map
from station.adapters.positioner._twin import twin_port
from station.adapters.positioner.cia402 import Cia402Positioner
from station.adapters.positioner.gcode import GcodePositioner
from station.adapters.positioner.plc import PlcPositioner
from station.adapters.positioner.simulated import MoveListener
from station.adapters.simulated_device.drive.node import EndpointOf, SimulatedDrive, angles_of, drives_of
from station.adapters.simulated_plc import MemoryRegisters, SimulatedPlc
from station.adapters.simulated_plc.drive import TurningFixture
from station.config.documents import Document
from station.config.rigs import load_rig
from station.config.settings import Settings
from station.domain.core.types import Floats
from station.domain.recipe.plan import PlannedVisit
from station.domain.rig import kinematics
from station.domain.rig.rig_map import RigMap
from station.messages import Message
from station.ports.bus import Bus
from station.ports.clock import Clock
from station.ports.positioner import MeasuredPose, Positioner
from station.wiring.positioners import SIMULATED, connected_positioner, positioner_options, refuse_nodes_of_units

#: Kinds with a simulated machine; every other one is replaced by a positioner in numbers.
DRIVEN = ("cia402", "gcode", "plc")
#: Beginnings of names that are no hardware: a CAN interface of the kernel's own, a pseudo-terminal.
_VIRTUAL_CAN, _PSEUDO_TERMINAL = "vcan", "/dev/pts/"
#: A move that is longer under way than this ends by itself, s; nobody knows beforehand how long it takes.
_UNTIL_S = 3600.0


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a machine is simulated among. clock, bus: those of the units; endpoint: a device's side of that bus;
    attach: a drive lives from now on; moving, arrived: told when a move begins, when it ends."""

    settings: Settings
    document: Document
    clock: Clock
    bus: Bus
    endpoint: EndpointOf
    attach: Callable[[SimulatedDrive], None]
    moving: MoveListener
    arrived: Callable[[float], None]


class DrivenFixture:
    """A positioner whose machine turns the simulated plate. plate: true nest → station rotations at instants."""

    by_hand = False
    turns_nothing = True

    def __init__(self, positioner: Positioner, around: Surroundings, plate: Callable[[Floats], Floats]) -> None:
        self._positioner, self._around, self.plate = positioner, around, plate

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Turns to the stop. Errors: PositionerFault, BusFault."""
        now_s = self._around.clock.monotonic_s()
        self._around.moving(stop, now_s, now_s + _UNTIL_S)
        self._positioner.move(stop, timeout_s)
        self._around.arrived(self._around.clock.monotonic_s())

    def where(self) -> MeasuredPose | None:
        """As the machine measures it."""
        return self._positioner.where()

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """As the positioner says. Errors: PositionerFault."""
        return self._positioner.estimate_s(origin, stop)

    def park(self, timeout_s: float) -> None:
        """Turns to the parking place. Errors: PositionerFault, BusFault."""
        self._positioner.park(timeout_s)


class FollowedFixture(DrivenFixture):
    """The same where the machine is another process: it turns in real time, and the plate after it on the units' clock,
    to where the machine says that it stands."""

    def __init__(self, positioner: Positioner, around: Surroundings) -> None:
        self._turning = TurningFixture.at_rest()
        super().__init__(positioner, around, self._turning.attitudes)

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Turns to the stop. Errors: PositionerFault, BusFault."""
        self._positioner.move(stop, timeout_s)
        self._follow(stop)

    def park(self, timeout_s: float) -> None:
        """Turns to the parking place. Errors: PositionerFault, BusFault."""
        self._positioner.park(timeout_s)
        self._follow(None)

    def _follow(self, stop: PlannedVisit | None) -> None:
        pose, now_s = self._positioner.where(), self._around.clock.monotonic_s()
        self._turning.start(np.eye(3) if pose is None else pose.attitude, now_s)
        if stop is not None:
            self._around.moving(stop, now_s, self._turning.arrives_s)
        self._around.clock.sleep(self._turning.arrives_s - now_s)


def driven_fixture(around: Surroundings, opened: ExitStack, mounted: RigMap | None = None) -> DrivenFixture:
    """The fixture of a configured machine. mounted: how a rig of drives is built, where it is not as its map says.

    Errors: UsageError, ConfigError; BusFault where another station has the bus of the drives.
    """
    if mounted is None and is_elsewhere(around.settings, around.document):
        positioner = connected_positioner(around.settings, around.document, SystemClock(), lambda: around.bus, opened)
        return FollowedFixture(positioner, around)
    kind = around.settings.positioner.kind
    return {"cia402": _by_drives, "gcode": _by_grbl, "plc": _by_plc}[kind](around, mounted)


def is_elsewhere(settings: Settings, document: Document) -> bool:
    """Whether the machine is configured at an address where only a simulated one can be."""
    options = positioner_options(settings, document)
    match settings.positioner.kind:
        case "plc":
            return is_this_machine(options.host)
        case "gcode":
            return bool(options.port.startswith(_PSEUDO_TERMINAL))
        case _:
            own = options.channel not in (settings.bus.channel, SIMULATED)
            virtual = options.interface == "udp_multicast" or options.channel.startswith(_VIRTUAL_CAN)
            return bool(own and virtual)


def machine_address(settings: Settings, document: Document) -> str:
    """Where the real machine is; empty where config.yaml names none."""
    options = positioner_options(settings, document)
    given = {"plc": "host", "gcode": "port", "cia402": "channel"}[settings.positioner.kind]
    address: str = getattr(options, given)
    return "" if address == SIMULATED else address


def replaced_positioner(settings: Settings, document: Document) -> list[Message]:
    """What turns the simulated fixture in place of the configured positioner, where that is another."""
    kind = settings.positioner.kind
    if kind in ("simulated", "manual"):
        return []
    if kind not in DRIVEN:
        return [Message("simulated-in-numbers", kind=kind)]
    address = machine_address(settings, document)
    if not address:
        return []
    if is_elsewhere(settings, document):
        return [Message("simulated-elsewhere", kind=kind, address=address)]
    return [Message("simulated-twin", kind=kind, address=address)]


def is_this_machine(host: str) -> bool:
    """Whether only a program of this machine can answer there."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _by_drives(around: Surroundings, mounted: RigMap | None) -> DrivenFixture:
    options = positioner_options(around.settings, around.document)
    positioner = Cia402Positioner(options, around.clock, around.bus)
    refuse_nodes_of_units(around.settings, positioner.rig)
    rig = mounted or positioner.rig
    drives = drives_of(rig, around.endpoint, around.clock)
    for drive in drives:
        around.attach(drive)
    return DrivenFixture(positioner, around, lambda times: _attitudes(rig, angles_of(rig, drives, times)))


def _by_grbl(around: Surroundings, _mounted: RigMap | None) -> DrivenFixture:
    options = positioner_options(around.settings, around.document)
    rig = load_rig(options.map)
    port = twin_port(rig, around.clock)
    positioner = GcodePositioner(options, around.clock, port)
    return DrivenFixture(positioner, around, lambda times: _attitudes(rig, port.stub.places(times)[:, : len(rig.axes)]))


def _by_plc(around: Surroundings, _mounted: RigMap | None) -> DrivenFixture:
    options = positioner_options(around.settings, around.document)
    plc_map = load_map(options.map)
    plc = SimulatedPlc(plc_map, options.speed_deg_s, options.acceleration_deg_s2)
    link = PlcLink(MemoryRegisters(plc, around.clock), plc_map, around.clock)
    return DrivenFixture(PlcPositioner(options, around.clock, link), around, plc.attitudes)


def _attitudes(rig: RigMap, angles_deg: Floats) -> Floats:
    return kinematics.attitudes(rig.directions, angles_deg)
