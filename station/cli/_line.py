"""The face of `station line`: one line of text for each change of state and each step of a load."""

import errno
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

from station.cli import _output
from station.cli._stop_signals import stop_signals, stop_socket
from station.config.settings import load_config
from station.domain.cell import symbol_content
from station.domain.cell.adjustment import ADJUSTABLE
from station.domain.cell.handover import Bin, Close, Measure, Place, Take
from station.domain.cell.packml import Command, State
from station.domain.core.types import NestAssignment
from station.domain.recipe import serial as serials_of
from station.domain.run.progress import LoadDone, Notice, UnitDone
from station.errors import ConfigError, StationError, UsageError
from station.messages import Message, render, system_reason
from station.panel_protocol.journal_seal import JournalSealer, sealing_journal
from station.panel_protocol.line_adjustment import LineAdjustments
from station.panel_protocol.line_state import LineCommands, LineStateWriter, send_line_command
from station.panel_protocol.live_state import LiveStateWriter
from station.panel_protocol.sealing_socket import taking_requests
from station.service.golden_register import refuse_unless_checked
from station.service.line import Adjusted, Line, LinePorts, LoadStep, StateEntered
from station.service.runner import Runner
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench, open_bench
from station.wiring.line import LineParts, open_line
from station.wiring.logs import find_log
from station.wiring.run_order import RunOrder

#: Id of the stop that a command makes.
STOPPED_BY_COMMAND = "line-stopped-by-command"


@dataclass(frozen=True, slots=True)
class LineRequest:
    """How a line is run. loads: so many, None without end; faults: of the simulated PLC; clear: go on after a crash."""

    loads: int | None = None
    faults: tuple[str, ...] = ()
    clear: bool = False
    as_json: bool = False


@dataclass(slots=True)
class _Counts:
    """What came of the units, for the last line."""

    loads: int = 0
    bins: dict[str, int] = field(default_factory=lambda: {b.name.lower(): 0 for b in Bin})


def run_line(order: RunOrder, request: LineRequest) -> int:
    """Opens the station and its cell, and runs until it is complete or stopped; the exit code."""
    if order.device_state is not None and order.device_state.exists() and not order.device_state.is_dir():
        why = system_reason(FileExistsError(errno.EEXIST, ""))
        raise ConfigError("memory-folder-not-made", folder=str(order.device_state), why=why)
    stop = StopRequest()
    with stop_signals(stop), ExitStack() as opened:
        with stop:
            bench = opened.enter_context(open_bench(order))
            sealer = opened.enter_context(sealing_journal(bench.station.store, bench.database))
            opened.enter_context(stop_socket(bench.database, stop))
            opened.enter_context(taking_requests(bench.station.store, bench.database))
        parts = open_line(bench, order, request.loads, request.faults, opened)
        for sentence in (*bench.notices, *map(render, parts.notices)):
            _output.print_remark(sentence)
        shift = _Shift(bench, parts, stop, request, sealer)
        try:
            counts = shift.run()
        except StationError as fault:
            _output.print_remark(f"station: {fault.sentence}")
            return fault.exit_code
        document = {"schema": "station.line-run/1", "loads": counts.loads, "bins": counts.bins, "state": shift.state}
        if request.as_json:
            _output.print_json(document)
        else:
            units = ", ".join(f"{count} {name}" for name, count in counts.bins.items())
            _output.print_line(f"{counts.loads} loads: {units}; state {shift.state}; log: {bench.database}")
    return 0 if shift.state in ("complete", "stopped") else 3


class _Shift:
    """A line with its bench: what the service asks for, done with labels, runs and files."""

    def __init__(
        self, bench: Bench, parts: LineParts, stop: StopRequest, request: LineRequest, sealer: JournalSealer
    ) -> None:
        self._bench, self._parts, self._stop, self._request, self._sealer = bench, parts, stop, request, sealer
        settings, recipe = bench.station.settings, bench.job.recipe
        self._nests = [nest.name for nest in settings.nests]
        name = f"{recipe.name}/{recipe.version}"
        self._live = LineStateWriter(bench.database, settings.station, name, tuple(self._nests))
        self._commands = LineCommands(bench.database)
        self._adjustments = LineAdjustments(bench.database)
        self._clear = request.clear
        self._pending: Command | None = None
        ports = LinePorts(
            cell=parts.cell,
            store=bench.station.store,
            positioner=bench.station.positioner,
            clock=parts.clock,
            identify=self._identify,
            test=self._measure,
            commands=self._next_command,
            printer=parts.printer,
            adjustments=self._adjustments.next,
        )
        self._line = Line(
            ports, parts.settings, stop, settings.timeouts.park_s, request.loads, unattended=parts.simulated
        )
        self._why: Message | None = None

    @property
    def state(self) -> str:
        """The outer state's name."""
        return self._line.state.label

    def run(self) -> _Counts:
        """Everything until the end."""
        counts = _Counts()
        for event in self._line.run():
            if isinstance(event, StateEntered):
                new = event.why if event.why != self._why else None
                self._why = event.why
                _output.print_remark(f"{event.state.label}{': ' + render(new) if new else ''}")
            elif isinstance(event, Adjusted):
                _output.print_remark(render(Message("line-adjusted", mode=event.mode.label)))
            else:
                self._tell_step(event, counts)
            self._show()
        return counts

    def _tell_step(self, event: LoadStep, counts: _Counts) -> None:
        step = event.step
        if isinstance(step, Take):
            _output.print_remark(f"load {step.load}: taken")
            self._live.outcomes.clear()
        elif isinstance(step, Measure):
            _output.print_remark(f"load {step.load}: measured")
        elif isinstance(step, Close):
            counts.loads += 1
            for bin_ in step.bins.values():
                counts.bins[Bin(bin_).name.lower()] += 1
            bins = ", ".join(f"{self._nests[place]} {Bin(b).name.lower()}" for place, b in sorted(step.bins.items()))
            _output.print_remark(f"load {step.load}: handed back ({bins})")

    def _show(self) -> None:
        line, live = self._line, self._live
        live.counts, live.mode, live.ideal_s = line.counts, line.mode, line.settings.ideal_s
        live.times_s = {adjustable.name: getattr(line.settings, adjustable.name) for adjustable in ADJUSTABLE.values()}
        self._live.write(line.times, line.journal, line.loads, self._why, self._parts.clock.monotonic_s())

    def _next_command(self) -> Command | None:
        self._sealer.step(self._parts.clock.monotonic_s())
        if self._clear and self._line.state is State.ABORTED:
            self._clear = False
            return Command.CLEAR
        pending, self._pending = self._pending, None
        return pending or self._commands.next()

    def _identify(self, present: frozenset[int]) -> list[Place]:
        """Labels of every nest with a part; one that cannot be read, or that stands twice, is none."""
        found: dict[int, str] = {}
        for place in sorted(present):
            found[place] = self._label(self._nests[place])
        spelt = [serials_of.canonical(serial) for serial in found.values() if serial]
        for place, serial in found.items():
            if serial and spelt.count(serials_of.canonical(serial)) > 1:
                _output.print_remark(render(Message("line-serial-twice", serial=serial, nest=self._nests[place])))
                found[place] = ""
        return [Place(place, self._nests[place], serial) for place, serial in found.items()]

    def _label(self, nest: str) -> str:
        text = self._parts.scanner.read(nest, self._line.settings.scan_s)
        if text is None:
            _output.print_remark(render(Message("line-label-unread", nest=nest, limit_s=self._line.settings.scan_s)))
            return ""
        try:
            return serials_of.check(
                symbol_content.serial_of_symbol(text, self._parts.settings.label), self._bench.job.recipe
            )
        except UsageError as wrong:
            _output.print_remark(render(Message("line-label-wrong", nest=nest, reason=wrong.message)))
            return ""

    def _measure(self, places: Sequence[Place]) -> StationError | None:
        """One load through the recipe; what ended it for everybody."""
        bench = self._bench
        nodes = {nest.name: nest.node for nest in bench.station.settings.nests}
        seats = [NestAssignment(p.serial, p.nest, nodes[p.nest]) for p in places]
        try:
            refuse_unless_checked(bench.station.settings, partial(find_log, bench.database), [s.serial for s in seats])
        except StationError as overdue:
            return overdue
        bench.fixture.place(seats)
        settings = bench.station.settings
        head = {"station": settings.station, "operator": settings.operator, "simulated": bench.simulated}
        live = LiveStateWriter(bench.database, bench.job.recipe, head, _output.print_remark, bench.station.bus)
        fault: StationError | None = None
        with closing(Runner(bench.station, bench.job, self._stop).run(seats)) as events:
            for event in events:
                live.event(event)
                self._sealer.step(self._parts.clock.monotonic_s())
                self._heed(self._commands.next())
                if isinstance(event, UnitDone):
                    self._live.outcomes[event.result.seat.serial] = str(event.result.outcome)
                    self._show()
                elif isinstance(event, Notice):
                    _output.print_remark(render(event.message))
                elif isinstance(event, LoadDone):
                    fault = event.fault
        if self._pending is not None and self._stop.why.id == STOPPED_BY_COMMAND:
            self._stop.requested = False  # it ended this run; the line itself follows the command
        return fault

    def _heed(self, command: Command | None) -> None:
        """A stop or an abort ends the present run at the next safe place; everything else waits until it is over."""
        self._pending = command or self._pending
        if command in (Command.STOP, Command.ABORT):
            self._stop.request(Message("line-stopped-by-command", command=command.label))


def command_line(order: RunOrder, name: str) -> int:
    """Leaves a command for the running line."""
    command = next((c for c in Command if c.label == name.lower()), None)
    if command is None:
        raise UsageError("line-command-unknown", name=name[:40], commands=[c.label for c in Command])
    send_line_command(_database(order), command)
    return 0


def serve_line(order: RunOrder, how: Literal["opcua", "modbus"]) -> int:
    """Serves the line's state until Ctrl-C."""
    from station.wiring.line_servers import serve

    settings, _ = load_config(order.config)
    served = None if settings.line is None else settings.line.opcua if how == "opcua" else settings.line.modbus
    if served is None:
        raise UsageError("line-not-served", how=how)

    def ready(address: str) -> None:
        _output.print_remark(render(Message("line-served", address=address)))

    try:
        serve(how, served.host, served.port, _database(order), ready)
    except KeyboardInterrupt:
        _output.print_remark("stopped")
    return 0


def _database(order: RunOrder) -> Path:
    return order.database or Path(load_config(order.config)[0].database)
