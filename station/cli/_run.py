"""The face of a run: serials in, progress while it goes, a table or one JSON document at the end."""

import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from station.cli import _output
from station.cli._confirm import PageConfirmation, wait_for_person
from station.cli._pacing import RealTimePacer
from station.cli._results import print_results, run_document, run_row
from station.cli._serials import ask_serials, assign_nests, check_given
from station.cli._stop_signals import stop_signals, stop_socket
from station.domain.core.folded_reasons import MOST_OF_A_KIND
from station.domain.core.types import Outcome
from station.domain.recipe import serial as serials_of
from station.domain.run.progress import (
    Event,
    LoadDone,
    LoadStarted,
    Notice,
    Phase,
    PhaseEntered,
    UnitDone,
    UnitResult,
    VisitDone,
    VisitRejected,
    VisitStarted,
    WarmUpStarted,
)
from station.domain.run.run_state import rejection, with_unit
from station.errors import Aborted, StationError, UsageError
from station.messages import Message, render
from station.panel_protocol.journal_seal import JournalSealer, sealing_journal
from station.panel_protocol.live_state import LiveStateWriter
from station.panel_protocol.sealing_socket import taking_requests
from station.service.golden_register import refuse_unless_checked
from station.service.runner import Runner
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench, open_bench
from station.wiring.logs import find_log
from station.wiring.rehearsal import is_rehearsal
from station.wiring.run_order import RunOrder

PHASES = {
    Phase.IDENTIFY: "identifying",
    Phase.JUDGE: "computing",
    Phase.WRITE: "writing",
    Phase.SAVE: "saving",
    Phase.RESTART: "restarting",
    Phase.VERIFY: "verifying",
    Phase.PARK: "parking",
}


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How a run meets people. pace: of virtual time, None as fast as it goes; nests: one for each serial, or none said;
    at_page: somebody at the page confirms what a person has to do."""

    as_json: bool = False
    pace: float | None = None
    nests: tuple[str, ...] = ()
    confirm_at_page: bool = False


def run_units(order: RunOrder, given: Sequence[str], units: int | None, face: RunOptions) -> int:
    """Opens the station, takes every unit through it, and says how it went; the exit code."""
    if given:
        check_given(order, given)
    stop = StopRequest()
    with stop_signals(stop), ExitStack() as opened:
        with stop:  # nothing has begun: a signal may end it at once
            bench = opened.enter_context(open_bench(order))
            sealer = opened.enter_context(sealing_journal(bench.station.store, bench.database))
            opened.enter_context(stop_socket(bench.database, stop))
            opened.enter_context(taking_requests(bench.station.store, bench.database))
            serials = ask_serials(bench, given, units)
        serials_of.check_all(serials, bench.job.recipe)
        _check_faults(order, serials)
        settings = bench.station.settings
        if not (order.simulate and is_rehearsal(settings)):  # beside a rehearsal, --simulate is for trying things out
            refuse_unless_checked(settings, partial(find_log, bench.database), serials)
        for sentence in bench.notices:
            _output.print_remark(sentence)
        results, fault = _run(bench, serials, face, stop, sealer)
        place = {serial: i for i, serial in enumerate(serials)}
        results.sort(key=lambda r: place[r.seat.serial])
        if face.as_json:
            _output.print_json(run_document(results, bench.job.recipe, simulated=bench.simulated))
        else:
            print_results([run_row(r) for r in results], bench.job.recipe)
            if bench.simulated:
                _output.print_message(Message("simulated-units"))
            _output.print_line(f"log: {bench.database}")
    if fault is not None and (face.as_json or not _is_stated(fault, results)):
        _output.print_remark(f"station: {fault.sentence}")
    return exit_code(results, fault)


def _is_stated(fault: StationError, results: Sequence[UnitResult]) -> bool:
    """Whether the table gives it as the reason of a unit: a person reads it once."""
    return any(reason.sentence == fault.sentence for result in results for reason in result.reasons)


def _check_faults(order: RunOrder, serials: Sequence[str]) -> None:
    """A fault of a unit that is not there would be tried in vain, and its run be taken for a proof."""
    for text in order.faults:
        whose, slash, _ = text.partition("/")
        if slash and whose not in (*serials, "BUS", "GOLD"):
            raise UsageError("fault-of-other-unit", text=text[:60], unit=whose[:40], first=serials[0])


def exit_code(results: Sequence[UnitResult], fault: StationError | None) -> int:
    """The worst that happened: stopped, then the station's fault, then a unit's."""
    outcomes = {r.outcome for r in results}
    if fault is not None:
        return fault.exit_code
    for outcome, code in ((Outcome.ABORTED, 4), (Outcome.ERROR, 3), (Outcome.FAIL, 1)):
        if outcome in outcomes:
            return code
    return 0


def _run(
    bench: Bench, serials: Sequence[str], face: RunOptions, stop: StopRequest, sealer: JournalSealer
) -> tuple[list[UnitResult], StationError | None]:
    settings = bench.station.settings
    head = {"station": settings.station, "operator": settings.operator, "simulated": bench.simulated}
    live = LiveStateWriter(bench.database, bench.job.recipe, head, _output.print_remark, bench.station.bus)
    held = RealTimePacer(face.pace, bench.station.clock.monotonic_s, stop)
    results: list[UnitResult] = []
    loads = assign_nests(bench, serials, face.nests)
    confirm: Callable[[Message], None]
    if face.confirm_at_page:
        confirm = PageConfirmation(bench.database, live, held, stop)
    else:
        _check_person(bench, len(loads))
        confirm = (lambda _: None) if bench.simulated else wait_for_person
    with _output.progress() as bar:
        for number, seats in enumerate(loads):
            if number:
                try:
                    with stop:  # nothing is being written: a signal may end the wait at once
                        confirm(Message("load-units", units=", ".join(f"{s.serial} ({s.nest})" for s in seats)))
                except Aborted as exc:
                    return results, exc
            bench.fixture.place(seats)
            runner = Runner(bench.station, bench.job, stop, confirm)
            show = _ProgressLines(bar, f"load {number + 1} of {len(loads)}" if len(loads) > 1 else "run")
            with closing(runner.run(seats)) as events:
                for event in events:
                    held.keep()
                    live.event(event)
                    show.event(event)
                    sealer.step(bench.station.clock.monotonic_s())
                    if isinstance(event, UnitDone):
                        results.append(event.result)
                    if isinstance(event, LoadDone) and event.fault is not None:
                        return results, event.fault
    return results, None


class _ProgressLines:
    """Events as a bar and as lines for the person; both only where a person watches."""

    def __init__(self, bar: Any, title: str) -> None:
        self._bar, self._title = bar, title
        self._task = bar.add_task(title, total=None)
        self._stated: Counter[tuple[str, str]] = Counter()
        self._rejected: dict[Message, list[str]] = {}

    def event(self, event: Event) -> None:
        """Shows one event. What several nests have against them at one stop stands once, with their names."""
        if isinstance(event, VisitRejected):
            if self._new(event):
                self._rejected.setdefault(rejection(replace(event, serial="")), []).append(event.serial)
            return
        for message, serials in self._rejected.items():
            self._tell(Message(message.id, **{**message.parameters, "serial": ", ".join(serials)}))
        self._rejected.clear()
        if isinstance(event, LoadStarted):
            self._bar.update(self._task, total=event.visits + len(PHASES))
        elif isinstance(event, PhaseEntered) and event.phase in PHASES:
            self._step(PHASES[event.phase])
        elif isinstance(event, WarmUpStarted):
            text = render(Message("activity-warm-up", number=event.number))
            self._bar.update(
                self._task, description=f"{self._title}: {text}", until_s=time.monotonic() + event.duration_s
            )
        elif isinstance(event, VisitStarted):
            self._bar.update(self._task, description=f"{self._title}: {event.position}", until_s=None)
            self._tell(event.instruction)
        elif isinstance(event, VisitDone):
            self._step(event.position)
        elif isinstance(event, Notice):
            self._tell(with_unit(event.serial, event.message))

    def _new(self, event: VisitRejected) -> bool:
        """Whether this kind of fault of this unit has not been stated often: its reasons come once more at the end."""
        kind = (event.serial, event.reasons[0].check if event.reasons else "")
        self._stated[kind] += 1
        return self._stated[kind] <= MOST_OF_A_KIND

    def _step(self, what: str) -> None:
        self._bar.update(self._task, advance=1, description=f"{self._title}: {what}")

    def _tell(self, message: Message | None) -> None:
        if message is not None:
            _output.print_remark(render(message))


def _check_person(bench: Bench, loads: int) -> None:
    """UsageError before anything moves when somebody will have to do something and nobody is there."""
    if bench.simulated or sys.stdin.isatty():
        return
    if loads > 1:
        nests = len(bench.station.settings.nests)
        raise UsageError("run-loads-need-person", nests=nests)
    runs = bench.job.recipe.runs
    by_hand = any(r.seating != "home" or r.temperature_offset_degC or r.motors == "off" for r in runs)
    by_hand |= any(r.temperature_swing_degC for r in runs)
    if by_hand or bench.job.recipe.turns_base or bench.job.recipe.filters_off:
        raise UsageError("run-recipe-needs-person")
