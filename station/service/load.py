"""One fixture load: N units go through the phases together, each with an end of its own."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from station.domain.can.sensor_layout import SYNC
from station.domain.capture import thermometer
from station.domain.core import arithmetic
from station.domain.core.types import NestAssignment, Outcome
from station.domain.evaluation import calibration_document, reduced_visits_document
from station.domain.line_quality.history import NOTHING
from station.domain.product import writeback
from station.domain.recipe.plan import PlannedVisit
from station.domain.run.progress import (
    PHASES,
    Event,
    Identified,
    Judged,
    LoadDone,
    LoadStarted,
    Notice,
    Phase,
    PhaseEntered,
    UnitDone,
    UnitResult,
    WarmUpStarted,
)
from station.domain.run.unit_state import UnitState
from station.errors import (
    Aborted,
    DeviceChanged,
    DeviceRefused,
    DeviceSilent,
    ForeignMaster,
    NodeShared,
    PositionerFault,
    StationError,
    StationFault,
    StoreFault,
    UnitFault,
    WrongUnit,
)
from station.messages import Message
from station.ports.bus import Repeated
from station.service import compute, history, process_data, record
from station.service.bus_errors import with_bus_state
from station.service.capture import Capture
from station.service.identify import (
    check_still_set,
    identify,
    make_ready,
    read_old_values,
    restore_as_found,
    set_for_run,
)
from station.service.itinerary import estimate_s, tumble_visits, verification_visits
from station.service.measure import RejectedUnits, VisitMeasurement
from station.service.recovery import check_suspect_unit
from station.service.station import Job, Station
from station.service.stop_request import StopRequest
from station.service.unit import Unit, check_no_foreign_master, check_same_unit, reason_of
from station.service.write_back import WriteBack

#: Errors of one unit, which stop no other.
UNIT_ERRORS = (UnitFault, DeviceSilent, NodeShared, WrongUnit, ForeignMaster, DeviceChanged)


class Load:
    """Use `run()` once, and `leave()` whatever happened."""

    def __init__(self, station: Station, job: Job, stop: StopRequest, confirm: Callable[[Message], None]) -> None:
        self._station, self._job, self._stop, self._confirm = station, job, stop, confirm
        self._units: list[Unit] = []
        self._writers: dict[str, WriteBack] = {}
        self._phase = Phase.BEGIN
        self._capture: Capture | None = None
        self._parked = True
        self._fault: StationError | None = None
        self._sync: Repeated | None = None
        self._history = NOTHING

    def run(self, seats: Sequence[NestAssignment]) -> Iterator[Event]:
        """Everything from the first record to the parked fixture."""
        try:
            yield from self._begin(seats)
            for phase, work in (
                (Phase.IDENTIFY, self._identify),
                (Phase.MEASURE, self._measure),
                (Phase.JUDGE, self._judge),
                (Phase.WRITE, self._write),
                (Phase.SAVE, self._save),
                (Phase.RESTART, self._restart),
                (Phase.VERIFY, self._verify),
            ):
                if not self._alive:
                    break
                yield self._enter(phase)
                yield from work()
        except StationError as fault:
            self._fault = fault
        yield self._enter(Phase.CLOSE)
        for unit in self._alive:
            yield from self._end(unit, self._fault)
        yield self._enter(Phase.PARK)
        self._park()
        yield self._enter(Phase.DONE)
        yield LoadDone(self.results, self._fault)

    @property
    def results(self) -> tuple[UnitResult, ...]:
        """The units that have ended, in the order of their seats."""
        return tuple(u.result for u in self._units if u.result is not None)

    def leave(self) -> None:
        """Ends what has not ended and parks what is not parked; after a regular run there is nothing to do."""
        try:
            for unit in self._alive:
                for _ in self._end(unit, Aborted("run-left")):
                    pass
        finally:
            try:
                self._park()
            finally:
                self._stop_sync()
                if self._capture is not None:
                    self._capture.close()

    @property
    def _alive(self) -> list[Unit]:
        return [u for u in self._units if u.alive]

    def _enter(self, phase: Phase) -> PhaseEntered:
        self._phase = PHASES.follow(self._phase, phase)
        return PhaseEntered(phase)

    def _begin(self, seats: Sequence[NestAssignment]) -> Iterator[Event]:
        """Every attempt stands in the log before any device is touched."""
        self._stop.check()
        self._station.foreign.restart()
        for seat in seats:
            attempt = self._station.store.begin(record.attempt_start(seat, self._station, self._job))
            self._units.append(Unit(seat, attempt, self._station.device(seat.node), self._station.clock.monotonic_s()))
        self._seated(0, "home", powered=True)
        recipe = self._job.recipe
        visits = sum(len(tumble_visits(recipe, run)) for run in range(len(recipe.runs))) + len(
            verification_visits(recipe)
        )
        yield LoadStarted(tuple(seats), visits, estimate_s(recipe, self._station.positioner))

    def _each(self, step: Callable[[Unit], Iterator[Event]]) -> Iterator[Event]:
        """One step for every unit that is left; an error of one unit ends that unit only."""
        for unit in self._alive:
            try:
                yield from step(unit)
            except UNIT_ERRORS as fault:
                yield from self._end(unit, with_bus_state(attribute_silence(unit, fault), self._station.bus))

    def _identify(self) -> Iterator[Event]:
        self._capture = Capture(self._station, self._job, self._stop, self._alive)
        yield from self._each(self._identify_one)
        self._stop.check()

    def _identify_one(self, unit: Unit) -> Iterator[Event]:
        self._stop.check()
        store = self._station.store
        identify(unit, self._job, store)
        if finding := check_suspect_unit(unit, self._station):
            yield Notice(finding, unit.seat.serial)
        read_old_values(unit, self._job, store)
        if self._capture is not None and self._capture.sends(unit):
            unit.found_state = "operational"  # before anybody started it
        make_ready(unit, self._job, store)
        if unit.identity is not None:
            yield Identified(unit.seat, unit.identity.name, unit.identity.software, unit.identity.serial)

    def _measure(self) -> Iterator[Event]:
        self._start_gold()
        self._start_sync()
        if self._capture is None:
            return
        measure = VisitMeasurement(self._station, self._job, self._stop, self._capture)
        recipe = self._job.recipe
        done, total, seating = 0, sum(len(tumble_visits(recipe, run)) for run in range(len(recipe.runs))), "home"
        for number, run in enumerate(recipe.runs):
            if run.seating != seating:
                seating = run.seating
                yield from self._reseat(number, seating)
            yield from self._conditions(number)
            for planned in tumble_visits(recipe, number):
                if not self._alive:
                    return
                done += 1
                self._parked = False
                bad = yield from measure.at_visit(self._alive, planned, (done, total), "tumble")
                yield from self._drop(bad)

    def _start_gold(self) -> None:
        """The gold reference into operation, with raw output: its own calibration stands in the recipe."""
        if self._job.gold_node is None:
            return
        device = self._station.device(self._job.gold_node)
        switch = writeback.output(self._job.product.map, raw=True)
        try:
            device.nmt("start")
            if switch is not None:
                device.download(*switch.address, switch.raw)
        except (DeviceSilent, DeviceRefused) as fault:
            gold = self._job.recipe.reference.gold
            name = gold.serial if gold is not None else ""
            raise StationFault("gold-not-started", serial=name, fault=fault.message) from fault

    def _start_sync(self) -> None:
        """SYNC for the units whose PDOs follow it, at the pace that gives the recipe's rate; others take no harm."""
        every = max((unit.sync_every for unit in self._alive), default=0)
        if every and self._sync is None:
            self._sync = self._station.bus.repeat(SYNC, b"", 1 / (self._job.recipe.device.rate_hz * every))

    def _stop_sync(self) -> None:
        sync, self._sync = self._sync, None
        if sync is not None:
            sync.close()

    def _seated(self, run: int, seating: str, *, powered: bool) -> None:
        """The clocks that creep and warm-up run on, for the record: since when a unit is clamped, and has power."""
        for unit in self._alive:
            detail = {"run": run, "seating": seating, "powered": powered or unit.device.boot_ups() != unit.boot_ups}
            self._station.store.event(unit.attempt, "seated", detail)

    def _reseat(self, number: int, seating: str) -> Iterator[Event]:
        turn = self._job.recipe.seatings.get(seating)
        if turn is None:
            action = Message("turn-units-home", number=number + 1)
        else:
            angle_deg, axis = turn.angle_deg, turn.axis_name
            action = Message("turn-units", number=number + 1, angle_deg=angle_deg, axis=axis, seating=seating)
        yield from self._ask(action)
        self._seated(number, seating, powered=False)
        for unit in self._alive:  # turned units may have been unplugged for it
            if unit.device.boot_ups() != unit.boot_ups:
                make_ready(unit, self._job, self._station.store)

    def _conditions(self, number: int) -> Iterator[Event]:
        """What a run asks of its surroundings and no port can do: a person does it and says so, and time is given."""
        recipe = self._job.recipe
        run = recipe.runs[number]
        # Nobody knows how the load before left the rig.
        if recipe.turns_base and (not number or run.base_turn_deg != recipe.runs[number - 1].base_turn_deg):
            yield from self._ask(Message("turn-base", number=number + 1, angle_deg=run.base_turn_deg))
        if run.temperature_offset_degC:
            offset = run.temperature_offset_degC
            yield from self._ask(Message("set-temperature", number=number + 1, offset_degC=offset))
        if swing := run.temperature_swing_degC:
            yield from self._ask(Message("swing-temperature", number=number + 1, swing_degC=swing))
        if recipe.filters_off and (not number or run.filter != recipe.runs[number - 1].filter):
            yield from self._ask(Message(f"switch-filter-{run.filter}", number=number + 1))
        if run.motors == "off":
            yield from self._ask(Message("switch-motors-off", number=number + 1))
        if run.prewarm_s and self._capture is not None:
            yield Notice(Message("warming-up", number=number + 1, duration_s=run.prewarm_s))
            yield WarmUpStarted(number + 1, run.prewarm_s)
            self._capture.wait(run.prewarm_s)

    def _ask(self, action: Message) -> Iterator[Event]:
        """Waits until a person has done it."""
        yield Notice(Message("action", action=action))
        with self._stop:  # nothing is being written: a signal may end the wait at once
            self._confirm(action)
        self._stop.check()

    def _judge(self) -> Iterator[Event]:
        station, job = self._station, self._job
        device, settings = job.product.map, station.settings
        found = history.learnt(station.store, job.recipe_hash, device, settings, simulated=station.simulated)
        self._history, self._job = found, replace(job, recipe=found.applied(job.recipe))
        yield from self._each(self._judge_one)

    def _judge_one(self, unit: Unit) -> Iterator[Event]:
        if warning := thermometer.frozen_warning(unit.visits, self._job.layout):
            self._station.store.event(unit.attempt, "thermometer-frozen", record.message_entry(warning))
            yield Notice(warning, unit.seat.serial)
        prior = None if self._capture is None else self._capture.pace.prior
        fit = compute.calibrate(unit, self._job, self._station, prior)
        unit.fit = replace(fit, dwells=None)  # the log keeps the readings: a long batch must not, in memory
        if fit.visits is not None:  # what `station backtest` computes from: raw frames of a whole fleet take hours
            self._station.store.result(unit.attempt, "stops", reduced_visits_document.to_document(fit.visits))
        if self._history != NOTHING:
            self._station.store.result(unit.attempt, "history", self._history.document())
        document = calibration_document.unit(fit) | {"arithmetic": arithmetic.fingerprint()}
        self._station.store.result(unit.attempt, "calibration", document)
        if self._capture is not None and (dwell := self._capture.pace.document(unit.seat.serial)):
            self._station.store.result(unit.attempt, "dwell", dwell)
        yield Judged(unit.seat, fit)
        if fit.calibration is None or fit.verdict.outcome is not Outcome.PASS:
            unit.reasons.extend(fit.verdict.reasons)
            yield from self._end(unit, None, fit.verdict.outcome)
            return
        if not self._job.product.map.writes:  # measured and certified: the device keeps no calibration
            process_data.check_unchanged(unit, self._job)
            check_still_set(unit, self._job, raw=True)
            yield from self._end(unit, None, Outcome.PASS)
            return
        self._writers[unit.attempt] = writer = WriteBack(unit, self._station, self._job)
        writer.plan(fit.calibration)

    def _write(self) -> Iterator[Event]:
        """From the first write until every unit is back, no stop is seen: it would leave mixtures."""
        self._stop.check()
        yield from self._each(lambda unit: self._writers[unit.attempt].write())

    def _save(self) -> Iterator[Event]:
        yield from self._each(lambda unit: _without_events(self._writers[unit.attempt].save))

    def _restart(self) -> Iterator[Event]:
        yield from self._each(lambda unit: _without_events(self._writers[unit.attempt].restart))
        yield from self._each(lambda unit: _without_events(self._writers[unit.attempt].read_again))

    def _verify(self) -> Iterator[Event]:
        visits = verification_visits(self._job.recipe)
        yield from self._each(lambda unit: _without_events(lambda: set_for_run(unit, self._job, raw=False)))
        for number, planned in enumerate(visits, 1):
            if not self._alive or self._capture is None:
                return
            measure = VisitMeasurement(self._station, self._job, self._stop, self._capture)
            bad = yield from measure.at_visit(self._alive, planned, (number, len(visits)), "verify")
            yield from self._drop(bad)
        yield from self._each(lambda unit: self._verify_one(unit, visits))

    def _verify_one(self, unit: Unit, visits: Sequence[PlannedVisit]) -> Iterator[Event]:
        reasons, shown = compute.verify(unit, self._job, visits)
        self._station.store.result(unit.attempt, "verification", shown)
        unit.reasons.extend(reasons)
        self._writers[unit.attempt].confirm()
        check_no_foreign_master(unit, self._station.foreign)
        if not reasons:
            unit.enter(UnitState.VERIFIED)
        yield from self._end(unit, None, Outcome.FAIL if reasons else Outcome.PASS)

    def _drop(self, bad: RejectedUnits) -> Iterator[Event]:
        """Ends the units whose visit stayed bad; a wrong face in every nest is the positioner's."""
        for unit in self._alive:
            if unit.seat.serial in bad:
                unit.reasons.extend(bad[unit.seat.serial])
                yield from self._end(unit, None, record.rejection_outcome(bad, unit.seat.serial, len(self._alive)))

    def _end(self, unit: Unit, fault: StationError | None, outcome: Outcome = Outcome.ERROR) -> Iterator[Event]:
        """Leaves the device, closes the attempt, and only then says how it ended."""
        fault = fault or (None if outcome is Outcome.PASS else process_data.remapped(unit, self._job))
        if fault is not None:
            unit.reasons.insert(0, reason_of(fault))  # before what came of it
            outcome = Outcome(fault.outcome)
        failed = restore_as_found(unit, self._job)
        outcome = self._disturbed(unit, outcome)
        try:
            if failed:
                self._station.store.event(unit.attempt, "not-left-as-found", record.message_entry(failed))
            self._station.store.result(unit.attempt, "verdict", record.verdict_document(unit, outcome))
            self._station.store.finish(unit.attempt, outcome, self._station.clock.epoch_ns())
        except StoreFault as lost:
            self._fault = self._fault or lost
            unit.reasons.append(reason_of(lost))
            outcome = Outcome.ERROR
        yield UnitDone(unit.end(outcome, self._station.clock.monotonic_s() - unit.began_s))

    def _disturbed(self, unit: Unit, outcome: Outcome) -> Outcome:
        """ERROR where somebody else commanded the device, or it restarted or was exchanged at the last moment, after it
        was left as it was found: neither a PASS nor a FAIL says anything of the unit then."""
        if outcome not in (Outcome.PASS, Outcome.FAIL):
            return outcome
        try:
            if outcome is Outcome.PASS:
                check_same_unit(unit, self._job)
            check_no_foreign_master(unit, self._station.foreign)
            if outcome is Outcome.PASS and unit.device.boot_ups() != unit.boot_ups:
                raise DeviceChanged("unit-restarted", unit=unit.label, when=Message("while-verified"))
        except (StationFault, DeviceRefused) as fault:
            unit.reasons.append(reason_of(fault))
            return Outcome.ERROR
        return outcome

    def _park(self) -> None:
        if self._parked:
            return
        self._parked = True
        try:
            self._station.positioner.park(self._station.settings.timeouts.park_s)
        except PositionerFault as fault:
            self._fault = self._fault or fault


def attribute_silence(unit: Unit, fault: StationError) -> StationError:
    """A silence that came of a restart is the unit's own."""
    if isinstance(fault, DeviceSilent) and 0 < unit.boot_ups != unit.device.boot_ups():
        return UnitFault("unit-restarted", unit=unit.label, when=Message("silent-then", fault=fault.message))
    return fault


def _without_events(step: Callable[[], None]) -> Iterator[Event]:
    """A step that has nothing to tell."""
    step()
    yield from ()
