"""One visit of the whole fixture: move, settle, dwell, check, keep. Every nest at once."""

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from station.domain.can.error_frames import error_frames
from station.domain.capture import turn_check
from station.domain.capture.visit import CapturedVisit, Visit
from station.domain.capture.visit_check import check, statistics
from station.domain.core import rotation
from station.domain.core.types import Floats, Reason
from station.domain.product.emergency_codes import concerns_unit, emergency
from station.domain.recipe import plan
from station.domain.recipe.plan import PlannedVisit
from station.domain.records.framepack.plain import PlainFrames
from station.domain.records.stored_attempt import AXIS_ANGLES
from station.domain.run.progress import Event, VisitDone, VisitRejected, VisitStarted
from station.errors import PositionerFault
from station.messages import Message, render
from station.ports.store import VisitRecord
from station.service import process_data, silence
from station.service.capture import Capture
from station.service.station import Job, Station
from station.service.stop_request import StopRequest
from station.service.unit import Unit
from station.service.visit_collector import VisitCollector

#: Of a gold reference's readings so many must come. It has no counter that tells of each one that is missing.
GOLD_MIN_SHARE = 0.9

Reasons = tuple[Reason, ...]
#: Units whose visit stayed bad, by serial, with every reason.
RejectedUnits = Mapping[str, Reasons]
CheckedVisits = Mapping[str, tuple[Visit, Reasons]]


class VisitMeasurement:
    """Goes to visits and measures them. Errors of its calls are those of the whole fixture: PositionerFault,
    BusFault, StoreFault, Aborted."""

    def __init__(self, station: Station, job: Job, stop: StopRequest, capture: Capture) -> None:
        self._station, self._job, self._stop, self._capture = station, job, stop, capture
        self._angles_deg: tuple[float, ...] = ()

    def at_visit(
        self, units: Sequence[Unit], planned: PlannedVisit, place: tuple[int, int], kind: str
    ) -> Generator[Event, None, RejectedUnits]:
        """Moves there and measures; place: (number, total). A bad visit is measured again as the recipe allows."""
        instruction = self._instruction(planned)
        yield VisitStarted(*place, planned.position, instruction)
        self._move(planned)
        number = plan.visit_index(self._job.recipe, planned.run, planned.visit) if kind == "tumble" else None
        means: dict[str, tuple[float, ...]] = {}
        bad: dict[str, Reasons] = {}
        gone: dict[str, Reasons] = {}
        waiting = list(units)
        for repeats_remaining in range(self._job.recipe.visit_repeats, -1, -1):
            self._capture.drain()
            if instruction:
                yield from self._wait_for_face(units, planned, instruction, gone)
                waiting = [unit for unit in waiting if unit.seat.serial not in gone]
            if not waiting:
                break
            self._count_heartbeats(waiting)
            collector = yield from self._capture.take(waiting, number)
            found = {unit.seat.serial: self._check(unit, planned, collector) for unit in waiting}
            self._record(waiting, planned, collector, found, kind)
            means |= {serial: _mean(visit) for serial, (visit, reasons) in found.items() if not reasons}
            bad = {serial: reasons for serial, (_, reasons) in found.items() if reasons}
            for serial, reasons in bad.items():
                yield VisitRejected(serial, planned.position, reasons, repeats_remaining > 0)
            waiting = [unit for unit in waiting if unit.seat.serial in bad]
            if not waiting:
                break
        yield VisitDone(*place, planned.position, means)
        return {**bad, **gone}

    def _wait_for_face(
        self, units: Sequence[Unit], planned: PlannedVisit, instruction: Message, gone: dict[str, Reasons]
    ) -> Generator[Event, None, None]:
        """Until the fixture is turned; units that send nothing, or other objects, are added to those gone. Those
        already measured stand by: they tell how the fixture lies."""
        while present := [unit for unit in units if unit.seat.serial not in gone]:
            silent, changed = yield from self._capture.wait_for_face(present, planned, instruction)
            if not silent and not changed:
                return
            gone |= {unit.seat.serial: self._silence(unit, planned) for unit in silent}
            gone |= {unit.seat.serial: () for unit in changed}  # what has changed is said where the unit ends

    def _silence(self, unit: Unit, planned: PlannedVisit) -> Reasons:
        """Why the fixture need not be turned for a unit: it sends nothing."""
        self._emergencies(unit)
        message = silence.explain(unit, self._station, self._job, planned.position)
        reason = Reason(message, 0, self._job.recipe.device.rate_hz * silence.SILENT_S, "1", check="silent")
        return (*self._check_alive(unit, planned), reason)

    def _move(self, planned: PlannedVisit) -> None:
        settings = self._station.settings
        with self._stop:
            self._station.positioner.move(planned, settings.timeouts.move_s)
        where = self._station.positioner.where()
        if where is None:
            return
        self._angles_deg = where.angles_deg
        off = self._off_deg(where.attitude, planned)
        if off > settings.arrival_tolerance_deg:
            raise PositionerFault("positioner-off", angle_deg=off, position=planned.position)

    def _off_deg(self, where: Floats, planned: PlannedVisit) -> float:
        """How far from the plan it stands; gravity does not feel a turn about the vertical."""
        if self._job.recipe.reference.source == "gravity":
            R = rotation.shortest(planned.nest[2], where[2])
        else:
            R = where @ planned.nest.T
        return float(np.degrees(np.linalg.norm(rotation.to_vector(R))))

    def _check(self, unit: Unit, planned: PlannedVisit, collector: VisitCollector) -> tuple[Visit, Reasons]:
        visit = collector.visit(unit, planned, self._emergencies(unit))
        unit.temperature_degC = visit.temperature_degC
        gold, alive = self._gold_silent(visit), self._check_alive(unit, planned)
        found = check(visit, planned.true, self._job.recipe, self._job.layout)
        return visit, (*gold, *alive, *(self._explained(unit, planned, reason) for reason in found))

    def _explained(self, unit: Unit, planned: PlannedVisit, reason: Reason) -> Reason:
        """A silence, or a rate that is too low, with what explains it."""
        if reason.check in ("rate", "too-few"):
            slow = process_data.slow_timer(unit, self._job)
            return (
                reason
                if slow is None
                else replace(reason, message=Message("visit-because", visit=reason.message, cause=slow))
            )
        if reason.check != "silent":
            return reason
        return replace(reason, message=silence.explain(unit, self._station, self._job, planned.position))

    def _gold_silent(self, visit: Visit) -> Reasons:
        """Why no unit's dwell counts: the gold reference does not say what the truth was."""
        gold = self._job.recipe.reference.gold
        if visit.gold is None or gold is None:
            return ()
        count, due = len(visit.gold.readings), visit.lasted_s * self._job.recipe.device.rate_hz
        if count >= due * GOLD_MIN_SHARE:
            return ()
        message = Message(
            "gold-silent", serial=gold.serial, node=gold.node, count=count, due=due, position=visit.position
        )
        return (Reason(message, count, due * GOLD_MIN_SHARE, "1"),)

    def _check_alive(self, unit: Unit, planned: PlannedVisit) -> Reasons:
        """What boot-up and heartbeat say against the device."""
        if unit.device.boot_ups() != unit.boot_ups:
            return (Reason(Message("device-rebooted", position=planned.position), check="rebooted"),)
        age_s, limit_s = unit.device.heartbeat_age_s(), unit.heartbeat_limit_s
        if age_s > limit_s:
            period_s = unit.heartbeat_s
            message = Message("heartbeat-never", position=planned.position, period_s=period_s)
            if math.isfinite(age_s):
                message = Message("heartbeat-late", age_s=age_s, position=planned.position, period_s=period_s)
            return (Reason(message, age_s, limit_s, "s", check="heartbeat"),)
        return self._heartbeat_rare(unit, planned)

    def _count_heartbeats(self, units: Sequence[Unit]) -> None:
        for unit in units:
            unit.heard = unit.heard or (unit.device.heartbeats(), self._station.clock.monotonic_s())

    def _heartbeat_rare(self, unit: Unit, planned: PlannedVisit) -> Reasons:
        """Whether far fewer came since the first visit than the device says that it sends: by the age of the last one
        it would be alive or dead by chance."""
        if unit.heard is None:
            return ()
        before, since_s = unit.heard
        count, lasted_s = unit.device.heartbeats() - before, self._station.clock.monotonic_s() - since_s
        if lasted_s <= (count + 1) * unit.heartbeat_limit_s:
            return ()
        each_s = lasted_s / max(count, 1)
        message = Message("heartbeat-rare", each_s=each_s, position=planned.position, period_s=unit.heartbeat_s)
        return (Reason(message, each_s, unit.heartbeat_limit_s, "s", check="heartbeat"),)

    def _emergencies(self, unit: Unit) -> tuple[Message, ...]:
        """Errors that the device has reported and not taken back; every message goes into the record."""
        for e in unit.device.emergencies():
            detail = {"code": e.code, "register": e.register, "detail": e.detail, "time_ns": e.time_ns}
            self._station.store.event(unit.attempt, "emergency", detail)
            # Code 0 says that all errors are gone (CiA 301, 7.2.7.1).
            if not e.code or concerns_unit(e.code, e.register):
                unit.emergency = emergency(e.code, e.register) if e.code else None
        return (unit.emergency,) if unit.emergency else ()

    def _record(
        self,
        units: Sequence[Unit],
        planned: PlannedVisit,
        collector: VisitCollector,
        found: CheckedVisits,
        kind: str,
    ) -> None:
        """Every nest's visit in one transaction; a rejected one is recorded too, under its own kind."""
        records = []
        for unit in units:
            visit, reasons = found[unit.seat.serial]
            captured, encoded = collector.captured(unit, planned), collector.encoded(unit)
            record = _visit_record(captured, encoded, "rejected" if reasons else kind, visit, reasons)
            records.append(record if not self._angles_deg else _with_angles(record, self._angles_deg))
            if not reasons:
                (unit.visits if kind == "tumble" else unit.verify_visits).append(visit)
                unit.last_shown = visit.readings.mean(axis=0), planned.true
                unit.noise = max(unit.noise or 0.0, float(visit.readings.std(axis=0, ddof=1).max()))
        self._station.store.visit([u.attempt for u in units], records)

    def _instruction(self, planned: PlannedVisit) -> Message | None:
        """What a person who turns the fixture must do; None where a drive turns it."""
        if not self._station.positioner.by_hand:
            return None
        if not np.isfinite(planned.true).all():
            return Message("turn-to-new-direction")
        return turn_check.instruction(planned.position, planned.true, self._job.recipe)


def _visit_record(
    captured: CapturedVisit, encoded: PlainFrames, kind: str, visit: Visit, reasons: Reasons
) -> VisitRecord:
    more = {
        "from_ns": captured.from_ns,
        "to_ns": captured.to_ns,
        "bus_errors": [render(m) for m in error_frames(captured.frames)],
        "reasons": [r.sentence for r in reasons],
        "messages": [r.message.document() for r in reasons],
    }
    return VisitRecord(
        run=captured.run,
        visit=captured.visit,
        position=captured.position,
        seating=captured.seating,
        kind=kind,
        arrived_ns=captured.arrived_ns,
        left_ns=captured.to_ns,
        frames=captured.frames,
        statistics={**statistics(visit), **more},
        encoded=encoded,
    )


def _with_angles(record: VisitRecord, angles_deg: tuple[float, ...]) -> VisitRecord:
    """With what the encoders of the axes read there: what `station rig axes` compares the readings with."""
    return replace(record, statistics={**record.statistics, AXIS_ANGLES: list(angles_deg)})


def _mean(visit: Visit) -> tuple[float, ...]:
    return tuple(float(v) for v in visit.readings.mean(axis=0))
