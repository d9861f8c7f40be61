"""A controller with GRBL turns the fixture, over a serial port: axis X is the outer one of the map, Y the inner one."""

import re
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Protocol

from pydantic import Field

from station.adapters.positioner._twin import twin_port
from station.config.rigs import load_rig
from station.domain.recipe.fields import StrictModel
from station.domain.recipe.plan import PlannedVisit
from station.domain.rig.paths import quickest_way, safe_way
from station.domain.rig.rig_map import RigMap
from station.errors import Aborted, PositionerFault, UsageError
from station.messages import Message, system_reason
from station.ports.clock import Clock
from station.ports.positioner import MeasuredPose

#: How often the state is read in a move, s, and how long an answer may take.
POLL_S, ANSWER_S = 0.02, 1.0
#: A move may take so much longer than its trapezium of speed.
_LATE_FACTOR, _LATE_S = 1.5, 1.0
_STATUS = re.compile(r"<(\w+)(?::(\d))?\|.*?MPos:(-?[\d.]+),(-?[\d.]+)")
_HOLD, _RESET = b"!", b"\x18"


class _SerialLine(Protocol):
    """A serial port that never waits."""

    def write(self, data: bytes) -> object:
        """Sends."""

    def read(self, size: int) -> bytes:
        """What has come, at most so much."""

    def close(self) -> None:
        """Closes it."""


@dataclass(frozen=True, slots=True)
class _Status:
    """A status report. state: Idle, Run, Hold, Alarm, Door …; sub: its number; angles_deg: MPos."""

    state: str
    sub: int
    angles_deg: tuple[float, ...]


class GcodePositioner:
    """`ok` means that a line is in the planner; arrived is the state Idle with the place in the window, read twice.

    An alarm is never unlocked from here: the controller has lost its position, and somebody has to look. port: a serial
    port, or `simulated`.

    positioner: {kind: gcode, map: two-axis, port: /dev/ttyUSB0}
    """

    by_hand = False

    class Settings(StrictModel):
        """map: a file of rigs/ by name, or a path: axes, limits and zones count, its drives do not."""

        map: str = "two-axis"
        port: str = "simulated"
        baud: Annotated[int, Field(ge=9600, le=1_000_000)] = 115_200

    def __init__(self, settings: "GcodePositioner.Settings", clock: Clock, line: _SerialLine | None = None) -> None:
        self.rig: RigMap = load_rig(settings.map)
        self.turns_nothing = settings.port == "simulated"
        self._settings, self._clock, self._line = settings, clock, line
        self._heard = b""
        self._ready = False
        self._left: PositionerFault | None = None

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Turns to the stop and proves that it is there. Errors: PositionerFault."""
        self._turn_to(self._goals(stop), timeout_s, Message("place-position", position=stop.position))

    def where(self) -> MeasuredPose | None:
        """As the controller counts its steps; None before it was found in order."""
        if not self._ready:
            return None
        angles = self._status().angles_deg
        return MeasuredPose(self.rig.attitude(angles), angles)

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """Time of the quickest safe way. Errors: PositionerFault where there is none."""
        starts = [self.rig.park_deg] if origin is None else self._goals(origin)
        way = quickest_way(self.rig.space, starts, self._goals(stop))
        if way is None:
            raise PositionerFault("rig-no-safe-way", place=Message("place-position", position=stop.position))
        return way[0] + len(way[1]) * 2 * POLL_S

    def park(self, timeout_s: float) -> None:
        """Turns to the parking place; after a fault it stays where it is. Errors: PositionerFault."""
        if self._left is not None:
            raise PositionerFault("rig-left-standing", reason=self._left.message)
        self._turn_to([self.rig.park_deg], timeout_s, Message("place-parking"))

    def close(self) -> None:
        """Closes the port."""
        if self._line is not None:
            self._line.close()

    def _goals(self, stop: PlannedVisit) -> list[tuple[float, ...]]:
        goals = self.rig.goals(stop.nest)
        if not goals:
            raise PositionerFault("rig-cannot-reach", position=stop.position, rig=self.rig.name)
        return goals

    def _turn_to(self, goals: Sequence[tuple[float, ...]], timeout_s: float, place: Message) -> None:
        deadline_s = self._clock.monotonic_s() + timeout_s
        with self._stopping():
            self._prepare()
            here = self._status().angles_deg
            if (zone := self.rig.space.zone_at(here)) is not None:
                raise PositionerFault("rig-in-zone", zone=zone.name, angles=here)
            way = safe_way(self.rig.space, here, goals)
            if way is None:
                raise PositionerFault("rig-no-safe-way", place=place)
            for point in way[1]:
                self._hop(here, point, deadline_s, place)
                here = point

    def _prepare(self) -> None:
        """The controller answers, and is in order. Errors: PositionerFault."""
        if self._line is None:
            self._line = twin_port(self.rig, self._clock) if self.turns_nothing else _open(self._settings)
        if self._ready:
            return
        self._left = None
        status = self._status()
        while status.state == "Hold" and status.sub == 1:
            self._clock.sleep(POLL_S)
            status = self._status()
        if status.state == "Hold":  # after the operator's stop: it stands, and knows where
            self._write(_RESET)
            self._clock.sleep(POLL_S)
            status = self._status()
        if status.state != "Idle":
            raise self._not_in_order(status)
        self._command("G21 G90 G94")
        self._ready = True

    def _hop(self, here: tuple[float, ...], goal: tuple[float, ...], deadline_s: float, place: Message) -> None:
        feed = 60.0 * min(axis.speed_deg_s for axis in self.rig.axes)
        words = " ".join(f"{letter}{angle:.3f}" for letter, angle in zip("XY", goal, strict=False))
        began_s = self._clock.monotonic_s()
        late_s = min(began_s + self.rig.space.hop_s(here, goal) * 2**0.5 * _LATE_FACTOR + _LATE_S, deadline_s)
        self._command(f"G1 {words} F{feed:.0f}")
        while True:
            status = self._status()
            if status.state == "Idle":
                self._prove(goal, status, place)
                self._prove(goal, self._status(), place)
                return
            if status.state != "Run":
                raise self._not_in_order(status)
            if self._clock.monotonic_s() > late_s:
                late = self._clock.monotonic_s() - began_s
                raise PositionerFault("positioner-timed-out", place=place, timeout_s=late)
            self._clock.sleep(POLL_S)

    def _prove(self, goal: Sequence[float], status: _Status, place: Message) -> None:
        for axis, angle, wanted in zip(self.rig.axes, status.angles_deg, goal, strict=True):
            if abs(angle - wanted) > axis.window_deg:
                raise PositionerFault("drive-outside-window", axis=axis.name, place=place, off_deg=abs(angle - wanted))

    @contextmanager
    def _stopping(self) -> Generator[None, None, None]:
        """Whatever ends a move early holds the feed first."""
        try:
            yield
        except BaseException as ended:
            moving, self._ready = self._ready, False
            if moving:
                self._write(_HOLD)
                self._clock.sleep(max(axis.speed_deg_s / axis.acceleration_deg_s2 for axis in self.rig.axes) + 0.1)
                self._drop_answers()
            if not isinstance(ended, (Aborted, KeyboardInterrupt)):
                self._left = ended if isinstance(ended, PositionerFault) else PositionerFault("rig-serial-lost")
            raise

    def _not_in_order(self, status: _Status) -> PositionerFault:
        if status.state == "Alarm":
            return PositionerFault("gcode-alarm")
        return PositionerFault("gcode-state", state=status.state)

    # The line.

    def _status(self) -> _Status:
        """A status report, asked for now. Errors: PositionerFault for an alarm or a silent controller."""
        self._write(b"?")
        found = _STATUS.match(self._line_with("<"))
        if found is None:
            raise PositionerFault("gcode-unreadable")
        angles = tuple(float(found[3 + i]) for i in range(len(self.rig.axes)))
        return _Status(found[1], int(found[2] or 0), angles)

    def _command(self, line: str) -> None:
        """A line that must be accepted. Errors: PositionerFault."""
        self._write(line.encode() + b"\n")
        answer = self._line_with("ok", "error:")
        if answer != "ok":
            raise PositionerFault("gcode-refused", line=line, answer=answer)

    def _line_with(self, *starts: str) -> str:
        """The next line with one of these beginnings; others are passed over, an alarm is not."""
        deadline_s = self._clock.monotonic_s() + ANSWER_S
        while True:
            assert self._line is not None
            self._heard += self._line.read(4096)
            while b"\n" in self._heard:
                raw, self._heard = self._heard.split(b"\n", 1)
                line = raw.decode("latin-1").strip()
                if line.startswith("ALARM:") and self._ready:
                    raise PositionerFault("gcode-alarm")
                if line.startswith(starts):
                    return line
            if self._clock.monotonic_s() > deadline_s:
                raise PositionerFault("gcode-silent", port=self._settings.port, timeout_s=ANSWER_S)
            self._clock.sleep(0.002)

    def _drop_answers(self) -> None:
        """What was asked for before the stop says nothing of what is now."""
        self._heard = b""
        if self._line is not None:
            self._line.read(65536)

    def _write(self, data: bytes) -> None:
        assert self._line is not None
        self._line.write(data)


def _open(settings: GcodePositioner.Settings) -> _SerialLine:
    """The serial port. Errors: UsageError without pyserial, PositionerFault where it cannot be opened."""
    try:
        import serial
    except ImportError:
        raise UsageError("gcode-without-pyserial") from None
    try:
        opened: _SerialLine = serial.Serial(settings.port, settings.baud, timeout=0, exclusive=True)
    except OSError as exc:
        raise PositionerFault("gcode-port", port=settings.port, why=system_reason(exc)) from None
    return opened
