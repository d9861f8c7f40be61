"""The station for a shift: PackML outside, loads inside. A generator of what happens; the log is written on the way."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from station.config.line import LineSettings
from station.domain.cell import lamps
from station.domain.cell.adjustment import MODE_CHANGES_IN, REFUSED_IN_MAINTENANCE, LineAdjustment, UnitMode
from station.domain.cell.handover import Close, Hold, LoadJournal, Offer, Place, Step, Wait
from station.domain.cell.packml import Command, State, after_command
from station.domain.cell.state_times import StateTimes
from station.domain.cell.unit_counts import UnitCounts
from station.errors import PlcFault, StationError, StationFault, UsageError
from station.messages import Message
from station.ports.cell import Cell, LabelPrinter, UnitLabel
from station.ports.clock import Clock
from station.ports.positioner import Positioner
from station.ports.store import Store
from station.service.handover import Handover
from station.service.load_journal import StoreLoadJournal
from station.service.shift_effectiveness import START_EVENT, STATE_EVENT
from station.service.stop_request import StopRequest

#: Between two looks at the cell, s.
POLL_S = 0.2


@dataclass(frozen=True, slots=True)
class StateEntered:
    """The outer state changed; command: what led there, '' for the state's own work; why: where a person must act."""

    state: State
    command: str
    why: Message | None = None


@dataclass(frozen=True, slots=True)
class LoadStep:
    """A step of the hand-over was done."""

    step: Step


@dataclass(frozen=True, slots=True)
class Adjusted:
    """A line controller changed the unit mode or a time; refused: the mode, which stays what it was in this state."""

    mode: UnitMode
    refused: bool


LineEvent = StateEntered | LoadStep | Adjusted


@dataclass(frozen=True, slots=True)
class LinePorts:
    """What a line is made of. identify: reads the labels of these places; test: takes units through the recipe, and
    returns the fault that ended it for everybody; commands, adjustments: what somebody wants, None for nothing."""

    cell: Cell
    store: Store
    positioner: Positioner
    clock: Clock
    identify: Callable[[frozenset[int]], Sequence[Place]]
    test: Callable[[Sequence[Place]], StationError | None]
    commands: Callable[[], Command | None]
    printer: LabelPrinter | None = None
    adjustments: Callable[[], LineAdjustment | None] = lambda: None


class Line:
    """Use `run()` once. most_loads: so many, then it is complete; park_s: longest for parking; unattended: nobody can
    answer, so it ends where a person would have to look."""

    def __init__(
        self,
        ports: LinePorts,
        settings: LineSettings,
        stop: StopRequest,
        park_s: float,
        most_loads: int | None = None,
        *,
        unattended: bool = False,
    ) -> None:
        self._ports, self._settings, self._stop = ports, settings, stop
        self._park_s, self._most_loads, self._unattended = park_s, most_loads, unattended
        self._journal = StoreLoadJournal(ports.store)
        self._handover = Handover(ports.cell, self._journal, ports.identify, self._test)
        self._times = StateTimes.begin(self._state_found(), ports.clock.monotonic_s())
        self._why: Message | None = None
        self._fault: StationError | None = None
        self._waited_from_s: float | None = None
        self._silent_from_s: float | None = None
        self._by_hand = False  # after a stop or abort that somebody wanted, nothing starts by itself
        self._mode = UnitMode.PRODUCE
        self._counts = UnitCounts.after(self._journal.handed_back())
        self.loads = 0

    @property
    def state(self) -> State:
        """The outer state."""
        return self._times.state

    @property
    def mode(self) -> UnitMode:
        """In maintenance nothing starts."""
        return self._mode

    @property
    def settings(self) -> LineSettings:
        """As they are now, adjustments included."""
        return self._settings

    @property
    def times(self) -> StateTimes:
        """Seconds and entries of each state since this start."""
        return self._times

    @property
    def journal(self) -> LoadJournal:
        """The present load."""
        return LoadJournal.of(self._journal.entries())

    @property
    def counts(self) -> UnitCounts:
        """Units handed back."""
        return self._counts

    def run(self) -> Iterator[LineEvent]:
        """Until it is complete, or stopped from here."""
        given = self._settings
        shifts = {"shift_h": given.shift_h, "shift_begins_h": given.shift_begins_h, "ideal_s": given.ideal_s}
        self._ports.store.event("", START_EVENT, {"state": int(self.state), **shifts})
        yield StateEntered(self.state, "", self._why)
        while not self._over():
            if (adjustment := self._ports.adjustments()) is not None:
                yield self._adjust(adjustment)
            command = self._wanted()
            if command is not None:
                yield from self._command(command)
            yield from self._work()

    def _over(self) -> bool:
        if self._unattended and self._why is not None and self.state in (State.HELD, State.ABORTED):
            return True
        ended = self.state in (State.STOPPED, State.ABORTED, State.COMPLETE)
        return (self._stop.requested and ended) or self.state is State.COMPLETE

    def _state_found(self) -> State:
        """Stopped after an orderly end; aborted where the log breaks off in the middle of something."""
        changes = self._ports.store.station_events(STATE_EVENT, 1)
        orderly = not changes or changes[0][2]["state"] in (State.STOPPED, State.COMPLETE, State.IDLE)
        return State.STOPPED if orderly and LoadJournal.of(self._journal.entries()).open is None else State.ABORTED

    def _adjust(self, wanted: LineAdjustment) -> Adjusted:
        if wanted.mode is self._mode or self.state in MODE_CHANGES_IN:
            self._mode = wanted.mode
        self._settings = self._settings.model_copy(update=dict(wanted.times_s))
        self._ports.store.event("", "line-adjusted", {"mode": self._mode.label, "times_s": dict(wanted.times_s)})
        return Adjusted(self._mode, refused=self._mode is not wanted.mode)

    def _wanted(self) -> Command | None:
        """What somebody wants, or what the settings do without anybody."""
        if self._stop.requested:
            return Command.STOP if self.state not in (State.STOPPED, State.ABORTED) else None
        if (wanted := self._ports.commands()) is not None:
            return wanted
        automatic = self._settings.start == "auto" and not self._by_hand and self._mode is UnitMode.PRODUCE
        if self.state is State.STOPPED and automatic:
            return Command.RESET
        if self.state is State.IDLE and automatic:
            return Command.START
        continues = self._settings.after_crash == "continue" and not self._by_hand
        if self.state is State.ABORTED and continues and self._cell_lives():
            return Command.CLEAR
        return None

    def _cell_lives(self) -> bool:
        try:
            self._ports.cell.view()
        except PlcFault:
            return False
        return True

    def _command(self, command: Command) -> Iterator[LineEvent]:
        try:
            after_command(self.state, command)
            if self._mode is UnitMode.MAINTENANCE and command in REFUSED_IN_MAINTENANCE:
                raise UsageError("line-in-maintenance", command=command.label)
        except UsageError as refused:
            self._ports.store.event("", "packml-refused", {"command": command.label, "state": int(self.state)})
            yield StateEntered(self.state, "", refused.message)
            return
        if command in (Command.STOP, Command.ABORT, Command.RESET):
            self._by_hand = command is not Command.RESET
        yield self._enter(command)

    def _enter(self, command: Command | None, why: Message | None = None) -> StateEntered:
        now_s = self._ports.clock.monotonic_s()
        self._times = self._times.done(now_s) if command is None else self._times.command(command, now_s)
        self._why = why
        label = command.label if command else ""
        detail = {"state": int(self.state), "name": self.state.label, "command": label}
        self._ports.store.event("", STATE_EVENT, detail | ({"message": why.document()} if why else {}))
        self._show()
        return StateEntered(self.state, label, why)

    def _show(self) -> None:
        try:
            self._ports.cell.show(self.state, lamps.lamps(self.state))
        except PlcFault:
            return  # who cannot be reached is shown nothing; the next look at the cell says so

    def _work(self) -> Iterator[LineEvent]:
        """What the present state does. Acting states end by themselves."""
        try:
            if self.state is State.EXECUTE:
                yield from self._execute()
            elif self.state is State.SUSPENDED:
                if not isinstance(self._handover.next_step(), Wait):
                    yield self._enter(Command.UNSUSPEND)
                else:
                    self._pause()
            elif self.state in (State.RESETTING, State.STOPPING):
                if self.state is State.RESETTING:
                    self._ports.cell.view()  # a cell of another protocol is refused before anything moves
                self._ports.positioner.park(self._park_s)
                yield self._enter(None)
            elif self.state is State.UNHOLDING:
                self._release()
                yield self._enter(None)
            elif self._times.done(0.0).state is not self.state:
                yield self._enter(None, self._why)
            else:
                self._pause()
            self._silent_from_s = None
        except PlcFault as fault:
            yield from self._silent(fault)
        except StationFault as fault:
            yield from self._abort(fault)

    def _execute(self) -> Iterator[LineEvent]:
        if self._most_loads is not None and self.loads >= self._most_loads:
            yield self._enter(Command.COMPLETE)
            return
        upcoming = self._handover.next_step()
        if isinstance(upcoming, Hold):
            yield self._enter(Command.HOLD, upcoming.why)
            return
        if isinstance(upcoming, Wait):
            yield from self._starve()
            return
        self._waited_from_s = None
        if isinstance(upcoming, Offer) and upcoming.record and self._ports.printer is not None:
            try:
                self._print(self._ports.printer)
            except StationFault as wants:
                yield self._enter(Command.HOLD, wants.message)
                return
        step = self._handover.step()
        if isinstance(step, Close):
            self.loads += 1
            self._counts = self._counts.handed_back(step.bins, self._ports.clock.monotonic_s())
        yield LoadStep(step)
        if self._fault is not None:
            fault, self._fault = self._fault, None
            yield from self._abort(fault)

    def _starve(self) -> Iterator[LineEvent]:
        now_s = self._ports.clock.monotonic_s()
        if self._waited_from_s is None:
            self._waited_from_s = now_s
        if now_s - self._waited_from_s >= self._settings.starved_s:
            self._waited_from_s = None
            yield self._enter(Command.SUSPEND, Message("line-starved"))
        else:
            self._pause()

    def _test(self, places: Sequence[Place]) -> None:
        fault = self._ports.test(places)
        # What ends a load for everybody needs a person; a stop is no fault.
        self._fault = fault if isinstance(fault, StationFault) else None

    def _release(self) -> None:
        """After a hold: where the units of the open load are no longer there, a person has taken them."""
        open_load = self.journal.open
        if open_load is None:
            self._handover.clear(load_removed=False)
            return
        view = self._ports.cell.view()
        same = view.load == open_load.load and view.present == {p.place for p in open_load.places}
        self._handover.clear(load_removed=not same or view.taken == open_load.load)

    def _print(self, printer: LabelPrinter) -> None:
        """Labels before the hand-over: where they cannot be printed, the units stay."""
        journal = self.journal
        if journal.open is None:
            return
        for place in journal.open.places:
            if place.serial:
                outcomes = self._journal.outcomes(place.serial, place.nest, journal.open.number)
                record = f"{place.serial}#{journal.open.number}"
                printer.print(UnitLabel(place.serial, outcomes[-1] if outcomes else "ERROR", record, place.nest))

    def _silent(self, fault: PlcFault) -> Iterator[LineEvent]:
        """The cell does not answer: for a moment nothing, then everything stops until somebody clears."""
        now_s = self._ports.clock.monotonic_s()
        if self._silent_from_s is None:
            self._silent_from_s = now_s
        if now_s - self._silent_from_s < self._settings.lost_s or self.state in (State.ABORTED, State.STOPPED):
            self._pause()
        else:
            yield from self._abort(fault)

    def _abort(self, fault: StationError) -> Iterator[LineEvent]:
        self._silent_from_s = None
        yield self._enter(Command.ABORT, fault.message)
        # Nothing is moved here: whatever failed may have been what moves.
        yield self._enter(None, fault.message)

    def _pause(self) -> None:
        if self._stop.requested:
            return
        self._ports.clock.sleep(POLL_S)
