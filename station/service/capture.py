"""Frames of one stop as they come in: settling, dwelling, and the wait for a person who turns the fixture."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from station.domain.can.decode import decode_samples
from station.domain.capture.rest_detection import angle_deg, at_rest, expected_noise, face, has_direction
from station.domain.capture.visit_check import FACE_DEG
from station.domain.core.types import ERROR, Floats, Frames
from station.domain.noise.noise_prior import MAX_UNITS
from station.domain.recipe.plan import PlannedVisit as Planned
from station.domain.run.progress import Event, LiveReading, Notice
from station.errors import PositionerFault
from station.messages import Message
from station.service import dwell_control
from station.service.bus_errors import refuse_bus_off
from station.service.dwell_control import GOLD_KEY, Readings
from station.service.frame_collector import FrameCollector
from station.service.station import Job, Station
from station.service.stop_request import StopRequest
from station.service.unit import Unit

#: How often the stream is looked at, s, while waiting for rest and while dwelling; how soon a stop is noticed.
POLL_S, DWELL_POLL_S = 0.05, 0.2
#: How long the part must have been still before it counts, s, and the readings that this needs at least.
HOLD_S, HOLD_READINGS = 0.2, 16
#: Where any pose will do, the next one is so far from the last, degrees.
POSE_CHANGE_MIN_DEG = 15.0
#: A hand needs longer to let go.
HOLD_BY_HAND_S = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class CapturedDwell:
    """What came in at one stop since the arrival, when the dwell began and ended, kernel drops in it."""

    intake: FrameCollector
    arrived_ns: int
    from_ns: int
    to_ns: int
    lasted_s: float
    drops: int


class Capture:
    """The stream of a fixed set of nests, open as long as the load lasts."""

    def __init__(self, station: Station, job: Job, stop: StopRequest, units: Sequence[Unit]) -> None:
        self._station, self._job, self._stop = station, job, stop
        self._errors: list[Frames] = []
        self._channel = station.bus.stream(tuple({i for u in units for i in job.ids(u.seat.node)}))
        self._noise = expected_noise(job.recipe)
        earlier = partial(station.store.dwells, job.recipe_hash, MAX_UNITS)
        self.pace = dwell_control.control_for(job.recipe, earlier)
        self._lsb = max(abs(axis.scale) for axis in job.layout.axes)

    def close(self) -> None:
        """Closes the stream."""
        self._channel.close()

    def wait(self, duration_s: float) -> None:
        """Lets time pass, with the stream emptied and the operator's stop seen."""
        until_s = self._station.clock.monotonic_s() + duration_s
        while (left_s := until_s - self._station.clock.monotonic_s()) > 0:
            self._pass_over(self._look(min(DWELL_POLL_S, left_s)))

    def drain(self) -> None:
        """Drops what is waiting: frames from before the arrival belong to no stop, error frames to the next one."""
        while len(frames := self._receive()):
            self._pass_over(frames)
            self._stop.check()

    def _pass_over(self, frames: Frames) -> None:
        """Of frames that belong to no stop the error frames are kept for the record of the next one."""
        errors = frames[(frames.can_id & np.uint32(ERROR)) != 0]
        if len(errors):
            self._errors.append(errors)

    def take(self, units: Sequence[Unit], stop: int | None) -> Generator[Event, None, CapturedDwell]:
        """Settles and dwells; the fixture has just arrived. Yields what is read meanwhile. Errors: BusFault,
        Aborted. stop: its place in the plan of all runs, None for a verification."""
        clock = self._station.clock
        arrived_ns = clock.epoch_ns()
        before, self._errors = self._errors, []
        intake = FrameCollector(units, self._job)
        for errors in before:
            intake.add(errors)
        self._settle(units, intake)
        drops, began_s, from_ns = self._channel.drops(), clock.monotonic_s(), clock.epoch_ns()
        ask_s, lasted_s = self.pace.first_s(stop), 0.0
        inside: list[Frames] = []
        read = partial(self._readings, inside, units)
        while ask_s - lasted_s > 1e-9:
            inside.append(self._look(min(DWELL_POLL_S, ask_s - lasted_s)))
            intake.add(inside[-1])
            intake.encode_pending()
            yield self._reading(inside[-1], units)
            lasted_s = clock.monotonic_s() - began_s
            if ask_s - lasted_s <= 1e-9:
                ask_s = self.pace.until_s(stop, lasted_s, read)
        to_ns = clock.epoch_ns()
        self.pace.ended(stop, lasted_s, read)
        intake.add(self._receive())
        intake.encode_pending()
        return CapturedDwell(intake, arrived_ns, from_ns, to_ns, lasted_s, self._channel.drops() - drops)

    def wait_for_face(self, units: Sequence[Unit], planned: Planned, asked: str) -> Generator[Event, None, None]:
        """Until the wanted face is up and still in every nest; says once what else was brought up."""
        clock, face_s = self._station.clock, self._station.settings.timeouts.face_s
        deadline_s = clock.monotonic_s() + face_s
        said: set[str] = set()
        frames, turned = Frames.empty(), False
        while clock.monotonic_s() < deadline_s:
            newest = self._look(DWELL_POLL_S)
            self._pass_over(newest)
            frames = Frames.join([frames, newest])
            frames = frames[frames.time_ns > clock.epoch_ns() - round(2 * HOLD_BY_HAND_S * 1e9)]
            windows = [self._window(frames, unit, HOLD_BY_HAND_S) for unit in units]
            if not all(at_rest(w, self._noise, self._lsb) for w in windows):
                turned = turned or all(len(w) for w in windows)
                continue
            wrong = {self._wrong_face(u, w, planned) for u, w in zip(units, windows, strict=True)} - {""}
            if not wrong:
                return
            if turned:
                for sentence in sorted(wrong - said):
                    yield Notice(Message.text(f"{sentence}; {asked}"))
                said |= wrong
        raise PositionerFault(
            f"position {planned.position!r} was not brought up and held still within {face_s:g} s; "
            "start again when somebody is there to turn the fixture"
        )

    def _reading(self, newest: Frames, units: Sequence[Unit]) -> LiveReading:
        """The newest frames as a page may show them; a unit that sent fewer than two readings is left out."""
        read = {u.seat.serial: xyz for u in units if len(xyz := self._usable(newest, u.seat.node)) > 1}
        return LiveReading(
            {serial: tuple(float(v) for v in xyz.mean(axis=0)) for serial, xyz in read.items()},
            {serial: float(xyz.std(axis=0, ddof=1).max()) for serial, xyz in read.items()},
        )

    def _readings(self, inside: list[Frames], units: Sequence[Unit]) -> Readings:
        """What the units have said in this dwell, and the gold reference beside them."""
        block = Frames.join(inside)
        said = {u.seat.serial: self._usable(block, u.seat.node) for u in units}
        gold = self._job.gold_node
        return said if gold is None else said | {GOLD_KEY: self._usable(block, gold)}

    def _settle(self, units: Sequence[Unit], intake: FrameCollector) -> None:
        """The recipe's settling time, then until every unit is still; a unit that never is, the stop's check names.

        A recipe without settling time wants to see the settling, so nothing is waited for.
        """
        settle_s = self._job.recipe.settle.time_s
        clock, parts = self._station.clock, list[Frames]()
        began_s = clock.monotonic_s()
        while settle_s and clock.monotonic_s() - began_s < self._station.settings.timeouts.settle_s:
            parts.append(self._look(POLL_S))
            intake.add(parts[-1])
            if clock.monotonic_s() - began_s < settle_s:
                continue
            recent = Frames.join(parts[-round(1 / POLL_S) :])
            if all(at_rest(self._window(recent, u, HOLD_S), self._noise, self._lsb) for u in units):
                break

    def _look(self, duration_s: float) -> Frames:
        """Lets a moment pass and takes what came."""
        self._stop.check()
        self._station.clock.sleep(duration_s)
        return self._receive()

    def _receive(self) -> Frames:
        """What is waiting. Errors: BusFault, after bus-off too."""
        return refuse_bus_off(self._channel.receive(0.0), self._station.bus)

    def _window(self, frames: Frames, unit: Unit, hold_s: float) -> Floats:
        """The newest readings of a unit (n, 3), long enough to tell rest from movement; none when they are too few."""
        count = max(HOLD_READINGS, round(hold_s * self._job.recipe.device.rate_hz))
        readings = self._usable(frames, unit.seat.node)
        return readings[-count:] if len(readings) >= count else readings[:0]

    def _usable(self, frames: Frames, node: int) -> Floats:
        told = decode_samples(frames, self._job.layout, node)
        return told.xyz[told.usable]

    def _wrong_face(self, unit: Unit, window: Floats, planned: Planned) -> str:
        """What is up instead, in words; '' where it is right. Where any pose will do, it must be another one."""
        mean = np.asarray(window.mean(axis=0))
        if not self._job.recipe.pose_known:
            same = unit.last_mean is not None and angle_deg(mean, unit.last_mean) < POSE_CHANGE_MIN_DEG
            return f"nest {unit.seat.nest} still shows the same side" if same else ""
        if not has_direction(planned.true, self._job.recipe) or angle_deg(mean, planned.true) <= FACE_DEG:
            return ""
        return f"nest {unit.seat.nest} shows {face(mean)} up"
