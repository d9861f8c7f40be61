"""A simulated drive as a CANopen node: NMT, SDO, process data latched by SYNC, heartbeat both ways, EMCY.

It is an actor like the simulated devices: it lives in `act`, on simulated or on real time.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from station.adapters.simulated_device.drive.axis import DriveAxis, Mechanics
from station.adapters.simulated_device.drive.drive_fault import DriveFault
from station.adapters.simulated_device.drive.objects import PDO_OFF, DriveObjects
from station.adapters.simulated_device.sdo import Agenda
from station.adapters.simulated_device.sdo_server import SdoServer
from station.adapters.simulated_device.stream import Timer
from station.domain.core.types import ERROR, EXTENDED, REMOTE, Floats
from station.domain.rig import drive_profile as profile
from station.domain.rig.drive_profile import DriveState
from station.domain.rig.rig_map import Axis, DriveType, Homing, RigMap
from station.ports.bus import Endpoint
from station.ports.clock import Clock

BOOTING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
_NMT_STATES = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}
_RESETS = (0x81, 0x82)
_LAST_SYNCHRONOUS = 240
#: Identifiers → an endpoint on the bus that receives them.
EndpointOf = Callable[[tuple[int, ...]], Endpoint]


@dataclass(frozen=True, slots=True)
class Speed:
    """How fast a drive answers and starts."""

    turnaround_s: float = 0.0004
    boot_s: float = 0.3


def heard_ids(node: int, station_node: int) -> tuple[int, ...]:
    """Identifiers that the drive's channel must receive."""
    return (0x000, 0x080, 0x600 + node, *(0x200 + 0x100 * k + node for k in range(4)), 0x700 + station_node)


class SimulatedDrive:
    """One node with one or two axes. places: where the axes stand at the start, counts of their mechanics."""

    def __init__(
        self,
        channel: Endpoint,
        clock: Clock,
        node: int,
        identity: DriveType,
        mechanics: Sequence[Mechanics],
        *,
        faults: Sequence[DriveFault] = (),
        places: Sequence[float] | None = None,
        speed: Speed = Speed(),
    ) -> None:
        self.node, self._identity, self._channel, self._speed = node, identity, channel, speed
        self._now_s = clock.monotonic_s()
        places = places or [0.0] * len(mechanics)
        self.axes = tuple(DriveAxis(i, m, faults, p) for i, (m, p) in enumerate(zip(mechanics, places, strict=True)))
        self._objects = DriveObjects(self.axes, self._written, lambda: self._now_s)
        self._server = SdoServer(self._objects)
        self.powered = True
        self._start_up()
        self._agenda.at(self._now_s, self._boot_up)

    def next_due_s(self) -> float:
        """When it next does something by itself."""
        if not self.powered:
            return min((axis.next_due_s() for axis in self.axes), default=math.inf)
        timers = [timer.next_s for timer in self._timers]
        return min(
            self._agenda.next_s, self._heartbeat.next_s, self._watched_until_s, *timers,
            *(axis.next_due_s() for axis in self.axes), *self._pending_s,
        )  # fmt: skip

    def act(self, now_s: float) -> None:
        """Brings it up to `now_s`."""
        self._now_s = now_s
        self._run()
        frames = self._channel.receive(0.0)
        for can_id, length, data in zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True):
            if self.powered and not can_id & (ERROR | REMOTE | EXTENDED):
                self._hear(can_id, data[:length].tobytes())
        self._run()

    def power_off(self) -> None:
        """Loses its supply: motors brake, nothing answers."""
        self.powered = False
        self.state = BOOTING
        for axis in self.axes:
            axis.motor.stop(self._now_s, abs(axis.mechanics.counts_per_deg) * 3000.0)
            axis.state = DriveState.DISABLED

    def power_on(self) -> None:
        """Starts again."""
        self.powered = True
        self.restart()

    def restart(self) -> None:
        """Resets, as after a dip of its supply."""
        for axis in self.axes:
            axis.power_on(self._now_s)
        self._start_up()
        self._agenda.at(self._now_s + self._speed.boot_s, self._boot_up)

    def moving(self, time_s: float) -> bool:
        """Whether any axis turns at an instant."""
        return any(abs(axis.motor.at(time_s)[1]) > 1e-9 for axis in self.axes)

    def _start_up(self) -> None:
        self.state = BOOTING
        self._agenda, self._heartbeat = Agenda(), Timer()
        self._timers = [Timer() for _ in self.axes]
        self._shown: list[int | None] = [None for _ in self.axes]
        self._sent_s = [-math.inf for _ in self.axes]
        self._pending_s = [math.inf for _ in self.axes]
        self._latched: dict[int, bytes] = {}
        self._watched_until_s = math.inf
        self._server.reset()
        identity = self._identity
        self._objects.power_on(identity.vendor, identity.product, identity.revision, self.node)

    def _boot_up(self) -> None:
        self.state = PRE_OPERATIONAL
        self._channel.send(0x700 + self.node, bytes([BOOTING]))

    def _run(self) -> None:
        now_s = self._now_s
        for axis in self.axes:
            axis.run(now_s)
            if axis.reset_wanted:
                axis.reset_wanted = False
                self.restart()
                return
            if axis.power_cut and self.powered:
                self.power_off()
        if not self.powered:
            return
        self._agenda.run(now_s)
        if now_s >= self._watched_until_s:
            self._watched_until_s = math.inf
            for axis in self.axes:
                axis.lose_connection(now_s)
        self._produce(now_s)

    def _produce(self, now_s: float) -> None:
        """Heartbeat, EMCY and process data that are due."""
        if len(self._heartbeat.due(now_s)) and not self._active("heartbeat-stops"):
            self._channel.send(0x700 + self.node, bytes([self.state]))
        for axis in self.axes:
            for code in axis.errors:
                self._channel.send(0x080 + self.node, code.to_bytes(2, "little") + bytes([0x21, 0, 0, 0, 0, 0]))
            axis.errors.clear()
        if self.state == OPERATIONAL:
            for number, axis in enumerate(self.axes):
                self._report(number, axis, now_s)

    def _report(self, number: int, axis: DriveAxis, now_s: float) -> None:
        """The process data of an axis: when its statusword changes, not before the inhibit time, and by its timer."""
        objects = self._objects
        if objects.values[0x1800 + number, 1] & PDO_OFF or self._active("status-silent"):
            self._pending_s[number] = self._timers[number].next_s = math.inf
            return
        timed = len(self._timers[number].due(now_s)) > 0
        changed = axis.reported(now_s)[0] != self._shown[number]
        free_s = self._sent_s[number] + objects.values[0x1800 + number, 3] * 1e-4
        if not changed and not timed:
            self._pending_s[number] = math.inf
        elif now_s < free_s - 1e-9:
            self._pending_s[number] = free_s
        else:
            self._pending_s[number] = math.inf
            self._send_report(number, axis, now_s)

    def _send_report(self, number: int, axis: DriveAxis, now_s: float) -> None:
        objects = self._objects
        word, place = axis.reported(now_s)
        shown = {profile.STATUSWORD: word, profile.POSITION: place, profile.MODE_DISPLAY: axis.shown_mode}
        data = b""
        for entry in range(1, objects.values[0x1A00 + number, 0] + 1):
            mapped = objects.values[0x1A00 + number, entry]
            plain = 0x6000 + ((mapped >> 16) - 0x6000) % profile.AXIS_OFFSET
            size = (mapped & 0xFF) // 8
            data += (shown.get(plain, 0) & (1 << 8 * size) - 1).to_bytes(size, "little")
        self._shown[number], self._sent_s[number] = word, now_s
        self._channel.send(objects.values[0x1800 + number, 1] & 0x7FF, data)

    def _active(self, kind: str) -> bool:
        return any(axis.active(self._now_s, kind) for axis in self.axes)

    # What comes in.

    def _hear(self, can_id: int, data: bytes) -> None:
        if can_id == 0x000 and len(data) >= 2 and data[1] in (0, self.node):
            self._obey(data[0])
        elif self.state == BOOTING:
            return
        elif can_id == 0x080:
            self._on_sync()
        elif can_id == 0x600 + self.node and len(data) == 8 and self.state != STOPPED:
            self._serve(data)
        elif can_id == self._watched_id():
            self._watched_until_s = self._now_s + (self._objects.values[0x1016, 1] & 0xFFFF) / 1000
        elif self.state == OPERATIONAL:
            self._take_process_data(can_id, data)

    def _watched_id(self) -> int:
        """Identifier of the heartbeat that is watched; -1: none."""
        watched = self._objects.values[0x1016, 1]
        node, period_ms = watched >> 16 & 0x7F, watched & 0xFFFF
        return 0x700 + node if node and period_ms else -1

    def _obey(self, command: int) -> None:
        if command in _RESETS:
            self.restart()
        elif command in _NMT_STATES and self.state != BOOTING:
            self.state = _NMT_STATES[command]
            self._pending_s = [math.inf for _ in self.axes]
            for number, timer in enumerate(self._timers):
                period_ms = self._objects.values[0x1800 + number, 5]
                timer.start(self._now_s, period_ms / 1000 if self.state == OPERATIONAL else 0.0)
                self._shown[number] = None

    def _serve(self, data: bytes) -> None:
        if self._active("sdo-silent"):
            return
        answers = self._server.handle(data)
        late_s = 0.5 if self._active("speaks-after-stop") else 0.0
        for answer in answers:
            self._agenda.at(
                self._now_s + self._speed.turnaround_s + late_s,
                lambda a=answer: self._channel.send(0x580 + self.node, a),  # type: ignore[misc]
            )

    def _written(self, index: int, _sub: int, value: int) -> None:
        if index == 0x1017:
            self._heartbeat.start(self._now_s, value / 1000)
        elif index == 0x1016:
            self._watched_until_s = math.inf  # watched from the first heartbeat on (CiA 301, 7.2.8.3.2.2)
        for number in range(len(self.axes)):
            if index == 0x1800 + number and self.state == OPERATIONAL:
                self._timers[number].start(self._now_s, self._objects.values[index, 5] / 1000)

    def _take_process_data(self, can_id: int, data: bytes) -> None:
        for number in range(len(self.axes)):
            cob = self._objects.values[0x1400 + number, 1]
            if cob & PDO_OFF or cob & 0x7FF != can_id:
                continue
            if self._objects.values[0x1400 + number, 2] <= _LAST_SYNCHRONOUS:
                self._latched[number] = data
            else:
                self._apply(number, data)

    def _on_sync(self) -> None:
        if self.state == OPERATIONAL:
            latched, self._latched = self._latched, {}
            for number, data in latched.items():
                self._apply(number, data)

    def _apply(self, number: int, data: bytes) -> None:
        at = 0
        for entry in range(1, self._objects.values[0x1600 + number, 0] + 1):
            mapped = self._objects.values[0x1600 + number, entry]
            size = (mapped & 0xFF) // 8
            if at + size <= len(data):
                self._objects.write(mapped >> 16, mapped >> 8 & 0xFF, data[at : at + size])
            at += size


def mechanics_of(axis: Axis) -> Mechanics:
    """The mechanics that a map describes; limit switches five degrees beyond its limits."""
    ends = sorted(axis.counts(angle + sign * 5.0) for angle, sign in zip(axis.limits_deg, (-1, 1), strict=True))
    homing = axis.homing
    home = float(axis.counts(homing.home_deg)) if isinstance(homing, Homing) else 0.0
    return Mechanics(axis.counts_per_deg, home, (ends[0], ends[1]), absolute=not isinstance(homing, Homing))


def drives_of(
    rig: RigMap,
    endpoint: EndpointOf,
    clock: Clock,
    faults: Sequence[DriveFault] = (),
    angles_deg: Sequence[float] | None = None,
    mechanics: Sequence[Mechanics] | None = None,
) -> list[SimulatedDrive]:
    """The drives of a rig, a node each; faults and angles count the axes of the rig from 0."""
    angles = list(angles_deg or rig.park_deg)
    bodies = list(mechanics or map(mechanics_of, rig.axes))
    made = []
    for node in dict.fromkeys(axis.node for axis in rig.axes):
        own = [i for i, axis in enumerate(rig.axes) if axis.node == node]
        own.sort(key=lambda i: rig.axes[i].axis)
        mine = [DriveFault(f.kind, own.index(f.axis), f.after_s, f.move) for f in faults if f.axis in own]
        made.append(
            SimulatedDrive(
                endpoint(heard_ids(node, rig.station_node)),
                clock,
                node,
                rig.drive,
                [bodies[i] for i in own],
                faults=mine,
                places=[float(rig.axes[i].counts(angles[i])) for i in own],
            )
        )
    return made


def angles_of(rig: RigMap, drives: Sequence[SimulatedDrive], times_s: Floats) -> Floats:
    """True angles (n, axes) of the rig's axes at instants (n), degrees."""
    columns = []
    for axis in rig.axes:
        drive = next(d for d in drives if d.node == axis.node)
        motor = drive.axes[_place(rig, axis)].motor
        columns.append((motor.places(times_s) - axis.zero_counts) / axis.counts_per_deg)
    return np.stack(columns, axis=-1)


def _place(rig: RigMap, axis: Axis) -> int:
    """Place of an axis among those of its node."""
    return sorted(other.axis for other in rig.axes if other.node == axis.node).index(axis.axis)
