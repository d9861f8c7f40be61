"""One stop of the whole fixture: move, settle, dwell, check, keep. Every nest at once."""

from collections.abc import Generator, Mapping, Sequence

import numpy as np

from station.domain.can.decode import decode_samples, decode_temperatures
from station.domain.can.error_frames import error_frames
from station.domain.capture.assemble import CapturedVisit
from station.domain.capture.rest_detection import face
from station.domain.capture.visit_check import Visit, check, statistics
from station.domain.core import rotation
from station.domain.core.types import Reason
from station.domain.recipe import plan
from station.domain.recipe.plan import PlannedVisit as Planned
from station.domain.records.framepack.plain import PlainFrames
from station.domain.run.progress import Event, VisitDone, VisitRejected, VisitStarted
from station.errors import PositionerFault
from station.messages import Message
from station.ports.store import VisitRecord
from station.service.capture import Capture, CapturedDwell
from station.service.station import Job, Station
from station.service.stop_request import StopRequest
from station.service.unit import Unit

#: So many heartbeats may be late before the device counts as dead.
MAX_LATE_HEARTBEATS = 3
#: Of a gold reference's readings so many must come. It has no counter that tells of each one that is missing.
GOLD_MIN_SHARE = 0.9

Reasons = tuple[Reason, ...]
#: Units whose stop stayed bad, by serial, with every reason.
RejectedUnits = Mapping[str, Reasons]
CheckedVisits = Mapping[str, tuple[Visit, Reasons]]


class VisitMeasurement:
    """Goes to stops and measures them. Errors of its calls are those of the whole fixture: PositionerFault,
    BusFault, StoreFault, Aborted."""

    def __init__(self, station: Station, job: Job, stop: StopRequest, capture: Capture) -> None:
        self._station, self._job, self._stop, self._capture = station, job, stop, capture

    def at_stop(
        self, units: Sequence[Unit], planned: Planned, place: tuple[int, int], kind: str
    ) -> Generator[Event, None, RejectedUnits]:
        """Moves there and measures; place: (number, total). A bad stop is measured again as the recipe allows."""
        asked = self._asked(planned)
        yield VisitStarted(*place, planned.position, Message.text(asked) if asked else None)
        self._move(planned)
        number = plan.visit_index(self._job.recipe, planned.run, planned.visit) if kind == "tumble" else None
        means: dict[str, tuple[float, ...]] = {}
        bad: dict[str, Reasons] = {}
        waiting = list(units)
        for repeats_left in range(self._job.recipe.visit_repeats, -1, -1):
            self._capture.drain()
            if asked:
                yield from self._capture.wait_for_face(waiting, planned, asked)
            taken = yield from self._capture.take(waiting, number)
            gold = self._gold_silent(planned, taken)
            found = {unit.seat.serial: self._judge(unit, planned, taken, gold) for unit in waiting}
            self._keep(waiting, planned, taken, found, kind)
            means |= {serial: _mean(dwelled) for serial, (dwelled, reasons) in found.items() if not reasons}
            bad = {serial: reasons for serial, (_, reasons) in found.items() if reasons}
            for serial, reasons in bad.items():
                yield VisitRejected(serial, planned.position, reasons, repeats_left > 0)
            waiting = [unit for unit in waiting if unit.seat.serial in bad]
            if not waiting:
                break
        yield VisitDone(*place, planned.position, means)
        return bad

    def _move(self, planned: Planned) -> None:
        settings = self._station.settings
        with self._stop:
            self._station.positioner.move(planned, settings.timeouts.move_s)
        where = self._station.positioner.where()
        if where is None:
            return
        off = float(np.degrees(np.linalg.norm(rotation.to_vector(where @ planned.nest.T))))
        if off > settings.arrival_tolerance_deg:
            raise PositionerFault(
                f"the positioner stands {off:.1f} degrees away from position {planned.position!r}; "
                "nothing measured there counts: reference it again and check its load"
            )

    def _judge(self, unit: Unit, planned: Planned, taken: CapturedDwell, gold: Reasons) -> tuple[Visit, Reasons]:
        mine = taken.intake.frames_of(unit)
        inside = (mine.time_ns >= taken.from_ns) & (mine.time_ns < taken.to_ns)
        told = decode_temperatures(mine, self._job.layout, unit.seat.node)[1]
        unit.temperature_degC = float(told[-1]) if len(told) else unit.temperature_degC
        dwelled = Visit(
            position=planned.position,
            samples=decode_samples(mine[inside], self._job.layout, unit.seat.node),
            true=planned.true,
            lasted_s=taken.lasted_s,
            drops=taken.drops,
            temperature_degC=unit.temperature_degC,
            emergencies=self._emergencies(unit),
        )
        return dwelled, (*gold, *self._check_alive(unit, planned), *check(dwelled, self._job.recipe, self._job.layout))

    def _gold_silent(self, planned: Planned, taken: CapturedDwell) -> Reasons:
        """Why no unit's dwell counts: the gold reference does not say what the truth was."""
        node = self._job.gold_node
        gold = self._job.recipe.reference.gold
        if node is None or gold is None:
            return ()
        told = decode_samples(taken.intake.frames(), self._job.layout, node)
        inside = told.usable & (told.time_ns >= taken.from_ns) & (told.time_ns < taken.to_ns)
        count, due = int(np.count_nonzero(inside)), taken.lasted_s * self._job.recipe.device.rate_hz
        if count >= due * GOLD_MIN_SHARE:
            return ()
        sentence = (
            f"the gold reference {gold.serial} (node {node}) gave {count} of {due:.0f} readings at "
            f"{planned.position!r}; without it nothing measured there counts: check its cable and power"
        )
        return (Reason.text("gold-silent", sentence, count, due * GOLD_MIN_SHARE, "1"),)

    def _check_alive(self, unit: Unit, planned: Planned) -> Reasons:
        """What boot-up and heartbeat say against the device."""
        if unit.device.boot_ups() != unit.boot_ups:
            return (Reason.text("rebooted", f"the device restarted by itself at {planned.position!r}"),)
        age_s, limit_s = unit.device.heartbeat_age_s(), MAX_LATE_HEARTBEATS * unit.heartbeat_s
        if unit.heartbeat_s and age_s > limit_s:
            told = f"no heartbeat for {age_s:.1f} s at {planned.position!r}; one is due every {unit.heartbeat_s:g} s"
            return (Reason.text("heartbeat", told, age_s, limit_s, "s"),)
        return ()

    def _emergencies(self, unit: Unit) -> tuple[str, ...]:
        """Errors that the device has reported and not taken back; every message goes into the record."""
        for e in unit.device.emergencies():
            detail = {"code": e.code, "register": e.register, "detail": e.detail, "time_ns": e.time_ns}
            self._station.store.event(unit.attempt, "emergency", detail)
            # Code 0 says that all errors are gone (CiA 301, 7.2.7.1).
            unit.emergency = f"emergency 0x{e.code:04X} (register 0x{e.register:02X})" if e.code else ""
        return (unit.emergency,) if unit.emergency else ()

    def _keep(
        self, units: Sequence[Unit], planned: Planned, taken: CapturedDwell, found: CheckedVisits, kind: str
    ) -> None:
        """Every nest's stop in one transaction; a rejected one is kept too, under its own kind."""
        records = []
        for unit in units:
            dwelled, reasons = found[unit.seat.serial]
            kept = self._kept(unit, planned, taken)
            records.append(_record(kept, taken.intake.laid(unit), "rejected" if reasons else kind, dwelled, reasons))
            if not reasons:
                (unit.visits if kind == "tumble" else unit.verify_visits).append(kept)
                unit.last_mean = np.array(_mean(dwelled))
                std = dwelled.samples.xyz[dwelled.samples.usable].std(axis=0, ddof=1)
                unit.noise = max(unit.noise or 0.0, float(std.max()))
        self._station.store.visit([u.attempt for u in units], records)

    def _kept(self, unit: Unit, planned: Planned, taken: CapturedDwell) -> CapturedVisit:
        return CapturedVisit(
            run=planned.run,
            visit=planned.visit,
            position=planned.position,
            seating=planned.seating,
            arrived_ns=taken.arrived_ns,
            from_ns=taken.from_ns,
            to_ns=taken.to_ns,
            frames=taken.intake.frames_of(unit),
        )

    def _asked(self, planned: Planned) -> str:
        """What a person who turns the fixture must do; '' where a drive turns it."""
        if not self._station.positioner.by_hand:
            return ""
        if not np.isfinite(planned.true).all():
            return "turn the unit to another direction and hold it still"
        return f"bring position {planned.position!r} up ({face(planned.true)} of the unit) and let go"


def _record(kept: CapturedVisit, laid: PlainFrames, kind: str, dwelled: Visit, reasons: Reasons) -> VisitRecord:
    more = {
        "from_ns": kept.from_ns,
        "to_ns": kept.to_ns,
        "bus_errors": list(error_frames(kept.frames)),
        "reasons": [r.sentence for r in reasons],
    }
    return VisitRecord(
        run=kept.run,
        visit=kept.visit,
        position=kept.position,
        seating=kept.seating,
        kind=kind,
        arrived_ns=kept.arrived_ns,
        left_ns=kept.to_ns,
        frames=kept.frames,
        statistics={**statistics(dwelled), **more},
        laid=laid,
    )


def _mean(dwelled: Visit) -> tuple[float, ...]:
    told = dwelled.samples
    return tuple(float(v) for v in told.xyz[told.usable].mean(axis=0))
