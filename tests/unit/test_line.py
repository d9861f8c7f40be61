"""The station for a shift, with a cell, a log and units in numbers: states, holds, aborts, and who starts what."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from station.adapters.clock import VirtualClock
from station.adapters.positioner.simulated import SimulatedPositioner
from station.adapters.store.sqlite import SqliteStore
from station.config.line import LineSettings
from station.domain.cell.adjustment import LineAdjustment, UnitMode
from station.domain.cell.handover import Bin, CellView, Close, Place
from station.domain.cell.packml import Command, State
from station.errors import PlcFault, PositionerFault, StationError, StationFault
from station.ports.cell import UnitLabel
from station.ports.store import AttemptStart
from station.service.line import Adjusted, Line, LinePorts, LoadStep, StateEntered
from station.service.stop_request import StopRequest


@dataclass(slots=True)
class CellInNumbers:
    """Loads come until there are no more; `silent` from that look on; `present`: instead of what lies there."""

    loads: int
    silent: bool = False
    load: int = 0
    taken: int = 0
    bins: Mapping[int, int] = field(default_factory=dict)
    present: frozenset[int] = frozenset({0, 1})
    shown: list[State] = field(default_factory=list)
    handed: list[Mapping[int, int]] = field(default_factory=list)

    def view(self) -> CellView:
        if self.silent:
            raise PlcFault("plc-not-reached", host="cell", port=502)
        if self.taken == self.load and self.load < self.loads:
            self.load += 1
        ready = self.taken != self.load
        return CellView(self.load, ready, self.present if ready else frozenset(), self.taken, self.bins)

    def accept(self, load: int) -> None:
        assert load == self.load

    def give(self, load: int, bins: Mapping[int, int]) -> None:
        assert load == self.load
        self.taken, self.bins = load, bins
        self.handed.append(bins)

    def show(self, state: State, lamps: frozenset[str]) -> None:
        assert lamps
        self.shown.append(state)

    def close(self) -> None:
        pass


class Rig:
    """A line with everything around it in numbers, on a real log."""

    def __init__(self, folder: Path, loads: int = 2, **settings: Any) -> None:
        self.store = SqliteStore(folder / "station.db")
        self.clock, self.cell = VirtualClock(), CellInNumbers(loads)
        self.settings = LineSettings(**{"starved_s": 1.0, **settings})
        self.outcome, self.fault = "PASS", None
        self.stop = StopRequest()
        self.wanted: list[Command] = []
        self.adjusted: list[LineAdjustment] = []
        self.printed: list[UnitLabel] = []
        self.paper = True
        self.measured = 0

    fault: StationError | None

    def line(self, most_loads: int | None = None, *, unattended: bool = True) -> Line:
        ports = LinePorts(
            cell=self.cell,
            store=self.store,
            positioner=SimulatedPositioner(SimulatedPositioner.Settings(), self.clock),
            clock=self.clock,
            identify=lambda present: [Place(i, "AB"[i], f"SN{self.cell.load}{i}") for i in sorted(present)],
            test=self._test,
            commands=lambda: self.wanted.pop(0) if self.wanted else None,
            printer=self,
            adjustments=lambda: self.adjusted.pop(0) if self.adjusted else None,
        )
        return Line(ports, self.settings, self.stop, 20.0, most_loads, unattended=unattended)

    def print(self, label: UnitLabel) -> None:
        if not self.paper:
            raise StationFault("printer-paper")
        self.printed.append(label)

    def _test(self, places: Sequence[Place]) -> StationError | None:
        for place in places:
            self.measured += 1
            start = AttemptStart(place.serial, "s", place.nest, 17, "r", 1, "h", "{}", "c", "v", "", 1)
            self.store.finish(self.store.begin(start), self.outcome, 2)
        fault, self.fault = self.fault, None
        return fault


def states(events: Sequence[Any]) -> list[str]:
    return [e.state.label for e in events if isinstance(e, StateEntered)]


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_two_loads_and_it_is_complete(rig: Rig) -> None:
    events = list(rig.line(2).run())
    assert states(events) == ["stopped", "resetting", "idle", "starting", "execute", "completing", "complete"]
    assert [e.step.load for e in events if isinstance(e, LoadStep) and isinstance(e.step, Close)] == [1, 2]
    assert rig.cell.handed == [{0: 1, 1: 1}] * 2
    assert [(p.serial, p.outcome) for p in rig.printed[:2]] == [("SN10", "PASS"), ("SN11", "PASS")]
    changes = [detail["name"] for _, _, detail in rig.store.station_events("packml", 20)]
    assert changes == states(events)[1:]


def test_a_fail_is_handed_back_as_one(rig: Rig) -> None:
    rig.outcome = "FAIL"
    list(rig.line(1).run())
    assert rig.cell.handed == [{0: 2, 1: 2}]


def test_without_units_it_is_suspended_and_goes_on_when_they_come(rig: Rig) -> None:
    rig.cell.loads = 0
    seen = []
    for event in (line := rig.line(1)).run():
        seen.append(event)
        if line.state is State.SUSPENDED:
            rig.cell.loads = 1
    assert "suspended" in states(seen)
    assert states(seen)[-1] == "complete"


def test_a_load_that_vanishes_holds_it_until_a_person_has_looked(rig: Rig) -> None:
    line, seen = rig.line(1, unattended=False), []
    for event in line.run():
        seen.append(event)
        if isinstance(event, LoadStep) and rig.measured == 0:
            rig.cell.present = frozenset({0})
        if line.state is State.HELD:
            assert line.journal.open is not None
            rig.wanted, rig.cell.taken = [Command.UNHOLD], 1  # the rest was taken out by hand
            rig.cell.present = frozenset({0, 1})
    held = next(e for e in seen if isinstance(e, StateEntered) and e.state is State.HOLDING)
    assert held.why is not None
    assert held.why.id == "cell-parts-changed"
    assert rig.measured == 2, "the units of the second load, and none of the first"


def test_a_printer_without_paper_holds_the_units_back(rig: Rig) -> None:
    rig.paper = False
    line = rig.line(1, unattended=False)
    for _ in line.run():
        if line.state is State.HELD:
            assert rig.cell.handed == []
            rig.paper, rig.wanted = True, [Command.UNHOLD]
    assert rig.cell.handed == [{0: 1, 1: 1}]


def test_a_positioner_that_fails_aborts_and_the_units_still_come_back(rig: Rig) -> None:
    rig.outcome, rig.fault = "ERROR", PositionerFault("plc-door-open")
    line, seen = rig.line(1, unattended=False), []
    for event in line.run():
        seen.append(event)
        if line.state is State.ABORTED:
            assert rig.cell.handed == []
            rig.wanted = [Command.CLEAR]
    assert states(seen).count("aborted") == 1
    assert rig.cell.handed == [{0: 3, 1: 3}]
    assert rig.measured == 2


def test_a_cell_that_is_silent_aborts_after_a_while(rig: Rig) -> None:
    seen = []
    for event in rig.line(2).run():
        seen.append(event)
        rig.cell.silent |= isinstance(event, LoadStep) and isinstance(event.step, Close)
    assert states(seen)[-2:] == ["aborting", "aborted"]
    assert 2.0 <= rig.clock.monotonic_s() < 5.0


def test_a_stop_on_command_stays_until_a_reset(rig: Rig) -> None:
    line, seen = rig.line(1, unattended=False), []
    rig.wanted = [Command.STOP]
    waits = 0
    for event in line.run():
        seen.append(event)
        if line.state is State.STOPPED and states(seen).count("stopped") == 2:
            waits += 1
            rig.wanted = [Command.RESET]
    assert waits
    assert states(seen)[-1] == "complete"


def test_a_command_that_the_state_does_not_take_is_refused_and_kept(rig: Rig) -> None:
    rig.wanted = [Command.UNHOLD]
    seen = list(rig.line(1).run())
    refused = next(e for e in seen if isinstance(e, StateEntered) and e.why is not None)
    assert refused.why is not None
    assert refused.why.id == "packml-command-refused"
    assert rig.store.station_events("packml-refused", 5)


def test_after_a_crash_it_waits_for_a_clear(rig: Rig) -> None:
    for event in (line := rig.line(2)).run():
        if isinstance(event, LoadStep):
            break  # the process is gone in the middle of a load
    assert line.journal.open is not None
    again, seen = rig.line(2, unattended=False), []
    for event in again.run():
        seen.append(event)
        if again.state is State.ABORTED:
            rig.wanted = [Command.CLEAR]
    assert states(seen)[0] == "aborted"
    assert rig.cell.handed == [{0: 1, 1: 1}] * 2


def test_a_cell_that_cannot_be_worked_with_is_refused_before_anything_moves(rig: Rig) -> None:
    rig.cell.silent = True
    seen = list(rig.line(1).run())
    assert states(seen) == ["stopped", "resetting", "aborting", "aborted"]


def test_a_stop_request_ends_it(rig: Rig) -> None:
    rig.cell.loads = 0
    seen = []
    for event in (line := rig.line(unattended=False)).run():
        seen.append(event)
        if line.state is State.SUSPENDED:
            rig.stop.request()
    assert states(seen)[-2:] == ["stopping", "stopped"]


def test_in_maintenance_nothing_starts_until_the_mode_is_produce_again(rig: Rig) -> None:
    line, seen = rig.line(1, unattended=False), []
    rig.adjusted = [LineAdjustment(UnitMode.MAINTENANCE)]
    for event in line.run():
        seen.append(event)
        if len(seen) == 2:  # the line is in maintenance, and would start by itself
            assert event == Adjusted(UnitMode.MAINTENANCE, refused=False)
            rig.wanted = [Command.RESET]
        elif isinstance(event, StateEntered) and event.why is not None:
            assert (event.why.id, line.state) == ("line-in-maintenance", State.STOPPED)
            rig.adjusted = [LineAdjustment(UnitMode.PRODUCE)]
    assert states(seen)[-1] == "complete"
    assert [d["mode"] for _, _, d in rig.store.station_events("line-adjusted", 5)] == ["maintenance", "produce"]


def test_the_mode_does_not_change_while_a_load_is_in_work_but_times_do(rig: Rig) -> None:
    line, seen = rig.line(1), []
    for event in line.run():
        seen.append(event)
        if isinstance(event, StateEntered) and event.state is State.EXECUTE:
            rig.adjusted = [LineAdjustment(UnitMode.MAINTENANCE, {"starved_s": 0.5})]
    assert Adjusted(UnitMode.PRODUCE, refused=True) in seen
    assert (line.mode, line.settings.starved_s) == (UnitMode.PRODUCE, 0.5)
    assert line.state is State.COMPLETE


def test_units_are_counted_by_bin_since_the_start_and_in_the_whole_log(rig: Rig) -> None:
    list(rig.line(1).run())
    rig.outcome = "FAIL"
    list((second := rig.line(1)).run())
    assert second.counts.since_start == {Bin.REJECT: 2}
    assert [second.counts.total(bin_) for bin_ in Bin] == [2, 2, 0]
