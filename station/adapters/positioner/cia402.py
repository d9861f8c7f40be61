"""Drives with the profile CiA 402 turn the fixture: one or two axes on a CAN bus, as the map of the rig says."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from station.adapters.positioner._cia402 import power, setup
from station.adapters.positioner._cia402.drive import Drive
from station.adapters.positioner._cia402.link import DriveLink
from station.adapters.positioner._cia402.watch import MotionWatch, stop_all
from station.adapters.positioner._twin import twin_bus
from station.config.rigs import load_rig
from station.domain.recipe.fields import StrictModel
from station.domain.recipe.plan import PlannedVisit
from station.domain.rig import drive_profile as profile
from station.domain.rig.paths import quickest_way, safe_way
from station.domain.rig.rig_map import Homing, RigMap
from station.errors import Aborted, BusFault, PositionerFault, StationError
from station.messages import Message
from station.ports.bus import Bus
from station.ports.clock import Clock
from station.ports.positioner import MeasuredPose

#: What the station itself needs besides the drives' own motion, s: to set the drives up and energise them from the
#: parked place; for the handshake of one hop.
START_S, HOP_S = 0.10, 0.015
#: How long a drive may take to acknowledge a set-point, s.
ACKNOWLEDGE_S = 0.5
#: A move may take so much longer than its trapezium of speed.
_LATE_FACTOR, _LATE_S = 1.5, 0.5
#: How far an axis is sent to prove that it stops by itself, degrees.
WATCHED_DEG = 8.0
#: Between target reached and the reading that proves it, s: an axis that creeps on has left its window by then.
_PROOF_S = 0.01


@dataclass(frozen=True, slots=True)
class _Hop:
    """One set-point of each moving axis. targets, ways: by axis, degrees; ways: where it may be meanwhile."""

    moving: Sequence[Drive]
    targets: Mapping[str, float]
    ways: Mapping[str, tuple[float, float]]
    time_s: float

    def is_there(self, drive: Drive) -> bool:
        """Whether its process data say so in both ways: by the bit, and by the place."""
        off_deg = abs(drive.angle_deg - self.targets[drive.name])
        return bool(drive.word & profile.REACHED) and off_deg <= drive.axis.window_deg


class Cia402Positioner:
    """Refuses before it energises, stops all axes together, and never says arrived without reading where they are.

    channel: `simulated` (drives inside this process, nothing moves), `units` (the drives are on the units' bus), or a
    CAN interface of their own.

    positioner: {kind: cia402, map: two-axis, channel: can1}
    """

    by_hand = False
    on_a_bus = True

    class Settings(StrictModel):
        """map: a file of rigs/ by name, or a path; interface: kind of bus where `channel` names one."""

        map: str = "two-axis"
        interface: str = "socketcan"
        channel: str = "simulated"

    def __init__(
        self,
        settings: "Cia402Positioner.Settings",
        clock: Clock,
        bus: Bus | None = None,
        rig: RigMap | None = None,
    ) -> None:
        self.rig: RigMap = rig or load_rig(settings.map)
        self.turns_nothing = settings.channel == "simulated"
        self._clock, self._bus = clock, bus
        self._opened: DriveLink | None = None
        self._ready = self._homed = False
        self._stood_deg: tuple[float, ...] | None = None
        self._left: PositionerFault | None = None

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Turns to the stop by the quickest safe way and proves that it is there. Errors: PositionerFault, BusFault."""
        goals = self._goals(stop)
        self._turn_to(goals, self._clock.monotonic_s() + timeout_s, Message("place-position", position=stop.position))

    def where(self) -> MeasuredPose | None:
        """By the encoders, read now; None before the axes know where they are."""
        if not self._homed:
            return None
        angles = self._angles()
        return MeasuredPose(self.rig.attitude(angles), angles)

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """Time of the quickest safe way, and of the handshakes. Errors: PositionerFault where there is none."""
        starts = [self.rig.park_deg] if origin is None else self._goals(origin)
        way = quickest_way(self.rig.space, starts, self._goals(stop))
        if way is None:
            raise PositionerFault("rig-no-safe-way", place=Message("place-position", position=stop.position))
        window_s = max(axis.window_s for axis in self.rig.axes)
        return way[0] + len(way[1]) * (HOP_S + window_s) + (START_S if origin is None else 0.0)

    def park(self, timeout_s: float) -> None:
        """Turns to the parking place and takes the power away. After a fault nothing is energised again.

        Errors: PositionerFault, BusFault.
        """
        if self._left is not None:
            raise PositionerFault("rig-left-standing", reason=self._left.message)
        if not (self._ready and self._homed and self._is_at(self.rig.park_deg)):
            deadline_s = self._clock.monotonic_s() + timeout_s
            self._turn_to([self.rig.park_deg], deadline_s, Message("place-parking"))
        with self._stopping():
            for drive in self.link.drives:
                power.switch_off(self.link, drive)

    def angles_deg(self) -> tuple[float, ...]:
        """Where the encoders stand, degrees, outer axis first."""
        return self._angles()

    def turn_to(self, angles_deg: tuple[float, ...], timeout_s: float) -> None:
        """Turns the axes to these angles, as `move` does. Errors: PositionerFault, BusFault."""
        self._turn_to([angles_deg], self._clock.monotonic_s() + timeout_s, Message("place-angles", angles=angles_deg))

    def prove_watch(self) -> None:
        """Shows that the drives stop by themselves when the station falls silent in a move: each axis begins one of a
        few degrees, and hears nothing more. Errors: PositionerFault."""
        with self._stopping():
            self._prepare()
            for number, drive in enumerate(self.link.drives):
                power.prove_watch(self.link, drive, self._away_from_limit(number))
                power.switch_off(self.link, drive)

    def _away_from_limit(self, number: int) -> float:
        """A place of an axis a few degrees from here, on the side of the middle of its travel."""
        here, (low, high) = self._angles()[number], self.rig.limits[number]
        return here + (WATCHED_DEG if here < (low + high) / 2 else -WATCHED_DEG)

    def close(self) -> None:
        """Leaves the bus."""
        if self._opened is not None:
            self._opened.close()

    @property
    def link(self) -> DriveLink:
        """The drives; the bus is opened when they are first needed."""
        if self._opened is None:
            self._opened = DriveLink(self._bus or twin_bus(self.rig, self._clock), self._clock, self.rig)
            self._watch = MotionWatch(self._opened)
        return self._opened

    # The way of a move.

    def _goals(self, stop: PlannedVisit) -> list[tuple[float, ...]]:
        goals = self.rig.goals(stop.nest)
        if not goals:
            raise PositionerFault("rig-cannot-reach", position=stop.position, rig=self.rig.name)
        return goals

    def _turn_to(self, goals: Sequence[tuple[float, ...]], deadline_s: float, place: Message) -> None:
        with self._stopping():
            self._prepare()
            here = self._angles()
            self._check_start(here)
            way = safe_way(self.rig.space, self._inside(here), goals)
            if way is None:
                raise PositionerFault("rig-no-safe-way", place=place)
            for point in way[1]:
                self._hop(here, point, deadline_s, place)
                here = point
            self._stood_deg = here

    def _prepare(self) -> None:
        """Everything that must hold before the first motion: all drives looked at before the first is energised."""
        if self._ready and self._homed:
            return
        self._left = None
        link = self.link
        for drive in link.drives:
            setup.check_type(drive, self.rig)
        for drive in link.drives:
            setup.check_free(link, drive)
        for device in link.devices.values():
            device.nmt("pre-operational")
        for drive in link.drives:
            setup.configure(link, drive, self.rig)
        for device in link.devices.values():
            device.nmt("start")
        self._ready = True
        self._homed = not any(isinstance(axis.homing, Homing) for axis in self.rig.axes)
        for drive in link.drives:
            power.home(link, drive, self._watch)
        self._homed, self._stood_deg = True, None

    def _check_start(self, here: tuple[float, ...]) -> None:
        zone = self.rig.space.zone_at(here)
        if zone is not None:
            raise PositionerFault("rig-in-zone", zone=zone.name, angles=here)
        for axis, angle in zip(self.rig.axes, here, strict=True):
            if not axis.limits_deg[0] - axis.following_deg <= angle <= axis.limits_deg[1] + axis.following_deg:
                raise PositionerFault("rig-outside-limits", axis=axis.name, angle_deg=angle)
        for axis, angle, stood in zip(self.rig.axes, here, self._stood_deg or here, strict=True):
            if abs(angle - stood) > axis.following_deg:
                raise PositionerFault("drive-slipped", axis=axis.name, angle_deg=angle, stood_deg=stood)

    def _inside(self, here: tuple[float, ...]) -> tuple[float, ...]:
        """Where it stands, as the way is planned from: no rounding of a count puts it beyond a limit."""
        limits = self.rig.limits
        return tuple(min(max(angle, low), high) for angle, (low, high) in zip(here, limits, strict=True))

    def _hop(self, here: tuple[float, ...], goal: tuple[float, ...], deadline_s: float, place: Message) -> None:
        """One set-point of every axis that has to move: both edges of the handshake, the window, the proof."""
        targets = {drive.name: end for drive, end in zip(self.link.drives, goal, strict=True)}
        moving = [
            drive
            for drive, start, end in zip(self.link.drives, here, goal, strict=True)
            if drive.axis.counts(end) != drive.axis.counts(start)
        ]
        for drive in moving:
            power.enable(self.link, drive)
            drive.settle(profile.TARGET, drive.axis.counts(targets[drive.name]))
        if moving:
            self._run(
                _Hop(moving, targets, self._ways(here, goal), self.rig.space.hop_s(here, goal)), deadline_s, place
            )
        self._prove(self.link.drives, targets, place)

    def _run(self, hop: "_Hop", deadline_s: float, place: Message) -> None:
        link, watch, moving = self.link, self._watch, hop.moving
        began_s = self._clock.monotonic_s()
        watch.begin(moving, hop.ways)
        if (old := _having(moving, profile.ACKNOWLEDGED)) is not None:
            raise PositionerFault("drive-acknowledge-stays", axis=old)
        link.arm()
        link.command({drive.name: profile.ENABLE | profile.START for drive in moving})
        if not watch.wait(lambda: all(d.word & profile.ACKNOWLEDGED for d in moving), ACKNOWLEDGE_S):
            raise PositionerFault("drive-not-acknowledged", axis=_lacking(moving, profile.ACKNOWLEDGED))
        link.command({drive.name: profile.ENABLE for drive in moving})
        if not watch.wait(lambda: not any(d.word & profile.ACKNOWLEDGED for d in moving), ACKNOWLEDGE_S):
            raise PositionerFault("drive-acknowledge-stays", axis=str(_having(moving, profile.ACKNOWLEDGED)))
        window_s = max(drive.axis.window_s for drive in moving)
        patience_s = (
            min(began_s + hop.time_s * _LATE_FACTOR + window_s + _LATE_S, deadline_s) - self._clock.monotonic_s()
        )
        if not watch.wait(lambda: all(map(hop.is_there, moving)), max(patience_s, 0.0)):
            if all(drive.word & profile.REACHED for drive in moving):
                self._prove(moving, hop.targets, place)
            raise PositionerFault("positioner-timed-out", place=place, timeout_s=self._clock.monotonic_s() - began_s)
        link.disarm()
        link.wait(lambda: False, _PROOF_S)

    def _prove(self, drives: Sequence[Drive], targets: Mapping[str, float], place: Message) -> None:
        """Reads where every axis is, by SDO. Errors: PositionerFault."""
        for drive in drives:
            angle = drive.axis.angle_deg(drive.counts())
            off_deg = abs(angle - targets[drive.name])
            if off_deg > drive.axis.window_deg:
                raise PositionerFault("drive-outside-window", axis=drive.name, place=place, off_deg=off_deg)
            if drive.axis.hold == "brake" and drive.state is not profile.DriveState.DISABLED:
                power.switch_off(self.link, drive)

    def _ways(self, here: Sequence[float], goal: Sequence[float]) -> dict[str, tuple[float, float]]:
        axes = zip(self.rig.axes, here, goal, strict=True)
        return {a.name: (min(x, y) - a.following_deg, max(x, y) + a.following_deg) for a, x, y in axes}

    def _angles(self) -> tuple[float, ...]:
        return tuple(drive.axis.angle_deg(drive.counts()) for drive in self.link.drives)

    def _is_at(self, angles_deg: Sequence[float]) -> bool:
        axes = zip(self.rig.axes, self._angles(), angles_deg, strict=True)
        return all(abs(here - there) <= axis.window_deg for axis, here, there in axes)

    @contextmanager
    def _stopping(self) -> Generator[None, None, None]:
        """Whatever ends a motion early, the operator's stop included, stops all axes first. After a fault the rig is
        left standing and is looked at anew before it may move again."""
        try:
            yield
        except BaseException as ended:
            self._stood_deg = None
            fault = self._stop(ended) if self._ready else None
            if fault is None and not isinstance(ended, (Aborted, KeyboardInterrupt)):
                fault = ended if isinstance(ended, PositionerFault) else PositionerFault(_message(ended))
            if fault is not None:
                self._ready = self._homed = False
                self._left = fault
            if fault is None or fault is ended or isinstance(ended, BusFault):
                raise
            raise fault from ended

    def _stop(self, ended: BaseException) -> PositionerFault | None:
        """Quick stop of all; what is wrong where an axis does not stand after it. Errors: BusFault."""
        running = stop_all(self.link)
        if not running:
            return None
        try:
            for drive in self.link.drives:
                self._watch.check_not_restarted(drive)
        except PositionerFault as restarted:
            return restarted
        return PositionerFault("drive-not-stopped", axes=running, reason=_message(ended))


def _message(ended: BaseException) -> Message:
    return ended.message if isinstance(ended, StationError) else Message("stopped-by-operator")


def _lacking(drives: Sequence[Drive], bit: int) -> str:
    return next(drive.name for drive in drives if not drive.word & bit)


def _having(drives: Sequence[Drive], bit: int) -> str | None:
    return next((drive.name for drive in drives if drive.word & bit), None)
