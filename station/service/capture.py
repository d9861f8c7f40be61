"""Frames of one visit as they come in: settling, dwelling, and the wait for a person who turns the fixture."""

from collections.abc import Generator, Sequence
from functools import partial

import numpy as np

from station.domain.capture.rest_detection import at_rest, expected_noise
from station.domain.core.types import ERROR, Frames
from station.domain.noise.noise_prior import MAX_UNITS
from station.domain.recipe.plan import PlannedVisit
from station.domain.run.progress import Event, LiveReading, Notice
from station.errors import PositionerFault
from station.messages import Message
from station.service import dwell_control, process_data
from station.service.bus_errors import refuse_bus_off
from station.service.dwell_control import GOLD_KEY, Readings
from station.service.face_wait import FaceWait, rest_window, window_s
from station.service.station import Job, Station
from station.service.stop_request import StopRequest
from station.service.unit import Unit
from station.service.visit_collector import VisitCollector

#: How often the stream is looked at, s, while waiting for rest, and while settling and dwelling; how soon a stop is
#: noticed.
POLL_S, DWELL_POLL_S = 0.05, 0.2
#: While only time has to pass, a stop may wait so long.
WAIT_POLL_S = 0.5
#: How long the part must have been still before it counts, s.
HOLD_S = 0.2
#: Readings older than this say nothing about rest.
RECENT_S = 1.0


class Capture:
    """The stream of a fixed set of nests, open as long as the load lasts."""

    def __init__(self, station: Station, job: Job, stop: StopRequest, units: Sequence[Unit]) -> None:
        self._station, self._job, self._stop = station, job, stop
        self._errors: list[Frames] = []
        self._heard_ids: set[int] = set()
        self._channel = station.bus.stream(tuple({i for u in units for i in job.ids(u.seat.node)}))
        self._noise = expected_noise(job.recipe)
        earlier = partial(station.store.dwells, job.recipe_hash, MAX_UNITS)
        self.pace = dwell_control.control_for(job.recipe, earlier)
        self._lsb = max(abs(axis.scale) for axis in job.layout.axes)

    def sends(self, unit: Unit) -> bool:
        """Whether the unit has sent readings since the stream was opened; what came is passed over."""
        frames = self._receive()
        self._heard_ids |= set(np.unique(frames.can_id).tolist())
        self._pass_over(frames)
        return self._job.layout.id_of(self._job.layout.sample, unit.seat.node) in self._heard_ids

    def close(self) -> None:
        """Closes the stream."""
        self._channel.close()

    def wait(self, duration_s: float) -> None:
        """Lets time pass, with the stream emptied and the operator's stop seen."""
        until_s = self._station.clock.monotonic_s() + duration_s
        while (remaining_s := until_s - self._station.clock.monotonic_s()) > 0:
            self._pass_over(self._poll(min(WAIT_POLL_S, remaining_s)))

    def drain(self) -> None:
        """Drops what is waiting: frames from before the arrival belong to no visit, error frames to the next one."""
        while len(frames := self._receive()):
            self._pass_over(frames)
            self._stop.check()

    def _pass_over(self, frames: Frames) -> None:
        """Of frames that belong to no stop the error frames are kept for the record of the next one."""
        errors = frames[(frames.can_id & np.uint32(ERROR)) != 0]
        if len(errors):
            self._errors.append(errors)

    def take(self, units: Sequence[Unit], number: int | None) -> Generator[Event, None, VisitCollector]:
        """Settles and dwells; the fixture has just arrived. Yields what is read meanwhile. Errors: BusFault,
        Aborted. number: the visit's place in the plan of all runs, None for a verification."""
        clock = self._station.clock
        earlier, self._errors = self._errors, []
        collector = VisitCollector(units, self._job, clock.epoch_ns(), earlier)
        self._settle(collector)
        drops, began_s, from_ns = self._channel.drops(), clock.monotonic_s(), clock.epoch_ns()
        check_s, lasted_s = self.pace.first_s(number), 0.0
        read = partial(_dwell_readings, collector, from_ns)
        while check_s - lasted_s > 1e-9:
            collector.add(self._poll(min(DWELL_POLL_S, check_s - lasted_s)))
            collector.update()
            yield _live_reading(collector)
            lasted_s = clock.monotonic_s() - began_s
            if check_s - lasted_s <= 1e-9:
                check_s = self.pace.until_s(number, lasted_s, read)
        to_ns = clock.epoch_ns()
        self.pace.ended(number, lasted_s, read)
        collector.add(self._receive())
        collector.finish(from_ns, to_ns, self._channel.drops() - drops)
        return collector

    def wait_for_face(
        self, units: Sequence[Unit], planned: PlannedVisit, instruction: Message
    ) -> Generator[Event, None, tuple[list[Unit], list[Unit]]]:
        """Until the wanted face is up and still in every nest; reports once what else was brought up.

        Returns the units that send nothing, and those whose PDOs map other objects than they did: nobody needs to turn
        the fixture for them. Errors: PositionerFault."""
        clock, face_s = self._station.clock, self._station.settings.timeouts.face_s
        begun_s = clock.monotonic_s()
        wait = FaceWait(units, self._job, planned, begun_s, face_s)
        reported: set[Message] = set()
        while clock.monotonic_s() < begun_s + face_s:
            newest = self._poll(DWELL_POLL_S)
            self._pass_over(newest)
            wait.look(newest, clock.monotonic_s(), clock.epoch_ns())
            if wait.over:
                return list(wait.silent), []
            for message in wait.wrong_faces():
                if message not in reported:
                    if changed := self._remapped(units):
                        return [], changed
                    yield Notice(Message("wrong-face-up", found=message, instruction=instruction))
                reported.add(message)
        if changed := self._remapped(units):
            return [], changed
        raise PositionerFault("nobody-turned-it", position=planned.position, timeout_s=face_s, found=wait.found)

    def _remapped(self, units: Sequence[Unit]) -> list[Unit]:
        return [unit for unit in units if process_data.remapped(unit, self._job) is not None]

    def _settle(self, collector: VisitCollector) -> None:
        """The recipe's settling time, then until every unit is still; a unit that never is, the visit's check names.

        A recipe without settling time wants to see the settling, so nothing is waited for.
        """
        recipe, clock = self._job.recipe, self._station.clock
        settle_s, recent_s = recipe.settle.time_s, max(RECENT_S, window_s(HOLD_S, recipe))
        began_s = clock.monotonic_s()
        while settle_s and (lasted_s := clock.monotonic_s() - began_s) < self._station.settings.timeouts.settle_s:
            collector.add(self._poll(min(DWELL_POLL_S, max(POLL_S, settle_s - lasted_s))))
            if clock.monotonic_s() - began_s < settle_s:
                continue
            recent = collector.recent(clock.epoch_ns() - round(recent_s * 1e9))
            if all(at_rest(rest_window(samples, HOLD_S, recipe), self._noise, self._lsb) for samples in recent):
                break

    def _poll(self, duration_s: float) -> Frames:
        """Lets a moment pass and takes what came."""
        self._stop.check()
        self._station.clock.sleep(duration_s)
        return self._receive()

    def _receive(self) -> Frames:
        """What is waiting. Errors: BusFault, after bus-off too."""
        return refuse_bus_off(self._channel.receive(0.0), self._station.bus)


def _live_reading(collector: VisitCollector) -> LiveReading:
    """The newest readings as a page may show them; a unit that sent fewer than two is left out."""
    newest = {serial: xyz for serial, samples in collector.newest().items() if len(xyz := samples.readings) > 1}
    return LiveReading(
        {serial: tuple(float(v) for v in xyz.mean(axis=0)) for serial, xyz in newest.items()},
        {serial: float(xyz.std(axis=0, ddof=1).max()) for serial, xyz in newest.items()},
    )


def _dwell_readings(collector: VisitCollector, from_ns: int) -> Readings:
    """What the units have read in this dwell, and the gold reference with them."""
    gold = collector.gold_readings(from_ns)
    return collector.readings(from_ns) | ({} if gold is None else {GOLD_KEY: gold})
