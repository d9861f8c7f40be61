"""A rig with simulated drives on a simulated bus, and a witness of every motion that nobody had asked for."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import VirtualClock
from station.adapters.positioner.cia402 import Cia402Positioner
from station.adapters.simulated_device.drive import drive_fault
from station.adapters.simulated_device.drive.node import SimulatedDrive, angles_of, drives_of
from station.config.rigs import load_rig
from station.domain.core import rotation
from station.domain.core.types import Floats, Frames
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.position import UP
from station.domain.rig.rig_map import RigMap
from station.errors import Aborted, StationError
from station.ports.bus import Bus, Channel, ErrorCounters, Repeated

#: Stands among the frames where the operator stopped.
STOP_ID = -1
#: How often the witness looks, s; speeds below this are rest, degrees/s.
LOOK_S, REST_DEG_S = 0.01, 1e-6


def visit(up: str) -> PlannedVisit:
    """The visit that brings an axis of the nest up."""
    nest = rotation.shortest(UP[up], UP["+z"])
    return PlannedVisit(0, 0, f"{up} up", "home", nest, np.eye(3), nest.T @ UP["+z"], None)


@dataclass
class Witness:
    """Looks at the true angles. excess_deg: how far outside the ways that were commanded; unasked_s: how long anything
    moved while no call was under way."""

    angles: Callable[[float], Floats]
    moving: Callable[[float], bool]
    box: tuple[Floats, Floats] | None = None
    excess_deg: float = 0.0
    unasked_s: float = 0.0
    _next_s: float = 0.0

    def next_due_s(self) -> float:
        """Its next look."""
        return self._next_s

    def act(self, now_s: float) -> None:
        """Looks."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + LOOK_S
        if not self.moving(now_s):
            return
        if self.box is None:
            self.unasked_s += LOOK_S
            return
        at = self.angles(now_s)
        self.excess_deg = max(self.excess_deg, float(np.max([self.box[0] - at, at - self.box[1]])))


class Killed(BaseException):
    """The station's process is gone."""


@dataclass
class KillableBus:
    """The station's side of a bus, dead from the n-th frame on: SIGKILL sends nothing any more, also in `finally`."""

    inner: Bus
    clock: VirtualClock
    after: float = math.inf
    stop_at_s: float = math.inf
    sent: list[tuple[int, bytes]] = field(default_factory=list)

    @property
    def name(self) -> str:
        """As the bus."""
        return self.inner.name

    def stream(self, can_ids: tuple[int, ...]) -> Channel:
        """As the bus."""
        return self.inner.stream(can_ids)

    def service(self, can_ids: tuple[int, ...]) -> "KillableChannel":
        """A channel that dies."""
        return KillableChannel(self, self.inner.service(can_ids))

    def repeat(self, can_id: int, data: bytes, period_s: float) -> Repeated:
        """As the bus."""
        return self.inner.repeat(can_id, data, period_s)

    def state(self) -> str:
        """As the bus."""
        return self.inner.state()

    def counters(self) -> ErrorCounters | None:
        """As the bus."""
        return self.inner.counters()

    def close(self) -> None:
        """Not the bus, on which the drives are."""


@dataclass
class KillableChannel:
    """One channel of it."""

    bus: KillableBus
    inner: Channel

    def send(self, can_id: int, data: bytes) -> None:
        """Sends, or dies."""
        if len(self.bus.sent) >= self.bus.after:
            raise Killed
        self.bus.sent.append((can_id, data))
        self.inner.send(can_id, data)

    def receive(self, timeout_s: float) -> Frames:
        """As the channel, while it lives."""
        if len(self.bus.sent) >= self.bus.after:
            raise Killed
        if self.bus.clock.monotonic_s() >= self.bus.stop_at_s:
            self.bus.stop_at_s = math.inf  # a signal interrupts a wait once
            self.bus.sent.append((STOP_ID, b""))
            raise Aborted("stopped-by-operator")
        return self.inner.receive(timeout_s)

    def drops(self) -> int:
        """As the channel."""
        return self.inner.drops()

    def close(self) -> None:
        """As the channel."""
        self.inner.close()


class DrivenRig:
    """Drives of a map on a bus of their own; `station()` is a positioner as a new process would make it."""

    def __init__(self, map_name: str = "two-axis", faults: Sequence[str] = ()) -> None:
        self.clock = VirtualClock()
        self.bus = SimulatedBus(self.clock)
        self.map: RigMap = load_rig(map_name)
        self.map_name = map_name
        parsed = [drive_fault.parse(text) for text in faults]
        self.drives: list[SimulatedDrive] = drives_of(self.map, self.bus.endpoint, self.clock, parsed)
        self.witness = Witness(self.truth_deg, lambda t: self.fastest_deg_s(t) > REST_DEG_S)
        for drive in self.drives:
            self.clock.attach(drive)
        self.clock.attach(self.witness)
        self.killable = KillableBus(self.bus, self.clock)
        self.positioner = self.station()

    def station(self) -> Cia402Positioner:
        """A new positioner on the same drives."""
        self.killable = KillableBus(self.bus, self.clock)
        return Cia402Positioner(
            Cia402Positioner.Settings(map=self.map_name, channel="units"), self.clock, self.killable
        )

    def truth_deg(self, time_s: float | None = None) -> Floats:
        """True angles at an instant, or now."""
        at_s = self.clock.monotonic_s() if time_s is None else time_s
        return np.asarray(angles_of(self.map, self.drives, np.array([at_s]))[0])

    def fastest_deg_s(self, time_s: float) -> float:
        """Greatest true speed of an axis."""
        speeds = [abs(a.motor.at(time_s)[1] / a.mechanics.counts_per_deg) for d in self.drives for a in d.axes]
        return max(speeds)

    def stands(self) -> bool:
        """Whether nothing moves now."""
        return self.fastest_deg_s(self.clock.monotonic_s()) <= REST_DEG_S

    def move(self, up: str, timeout_s: float = 90.0) -> StationError | None:
        """A move under the witness; what it ended with."""
        goals = np.array(self.positioner.rig.goals(visit(up).nest))
        return self._call(lambda: self.positioner.move(visit(up), timeout_s), goals)

    def park(self) -> StationError | None:
        """Parking under the witness."""
        return self._call(lambda: self.positioner.park(60.0), np.array([self.map.park_deg]))

    def _call(self, call: Callable[[], None], goals: Floats) -> StationError | None:
        """homing may go anywhere within the limits; a move stays between where it is and the nearest goal."""
        ends = np.vstack([self.truth_deg()[None], goals])
        homed = self.positioner.where() is not None or all(a.homing == "absolute" for a in self.map.axes)
        whole = np.array(self.map.limits)
        self.witness.box = (ends.min(axis=0), ends.max(axis=0)) if homed else (whole[:, 0] - 5, whole[:, 1] + 5)
        try:
            call()
        except StationError as fault:
            return fault
        finally:
            self.witness.box = None
        return None


def life(rig: DrivenRig, killed_after: float = math.inf) -> None:
    """Prepares (and homes), moves, is stopped in mid-move by the operator, goes on, and parks; or dies on the way."""
    rig.killable.after = killed_after
    try:
        rig.move("-y")
        rig.killable.stop_at_s = rig.clock.monotonic_s() + 0.6
        rig.move("+x")
        rig.park()
    except Killed:
        return


def killed_life(map_name: str, frame: int) -> str:
    """What is wrong after a SIGKILL in front of that frame of a life; empty where nothing is: all stand within half a
    second, nothing was turned that nobody had sent, and the next station comes where it is sent."""
    rig = DrivenRig(map_name)
    life(rig, frame)
    died_s = rig.clock.monotonic_s()
    rig.clock.sleep(0.5)
    if not rig.stands():
        return f"frame {frame}: still turning half a second after {died_s:.3f} s"
    if rig.witness.excess_deg > 0.5:
        return f"frame {frame}: {rig.witness.excess_deg:.2f} degrees outside its way"
    rig.witness.unasked_s = 0.0
    rig.positioner = rig.station()
    fault = rig.move("+y")
    if fault is not None:
        return f"frame {frame}: the next start ends with {fault}"
    off = np.abs(rig.truth_deg() - [90.0, 0.0]).max()
    if off > 0.02 or rig.witness.unasked_s or rig.witness.excess_deg > 0.5:
        return f"frame {frame}: the next move ended {off:.3f} degrees off, {rig.witness.unasked_s} s unasked"
    return ""


def frames_of_a_life(map_name: str) -> list[tuple[int, bytes]]:
    """What the station sends in a whole life."""
    rig = DrivenRig(map_name)
    life(rig)
    return rig.killable.sent
