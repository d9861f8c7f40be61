"""Stop means stop: asked for at any moment, the fixture is parked, the record is true, no device is half written."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from station.domain.core.types import Outcome
from station.domain.run.progress import (
    Event,
    Judged,
    ObjectWritten,
    Phase,
    PhaseEntered,
    UnitDone,
    VisitDone,
    VisitStarted,
)
from station.errors import Aborted, BusFault, PositionerFault, StoreFault
from station.messages import Message
from station.service.runner import Runner
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench, open_bench
from station.wiring.run_order import RunOrder
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """The same run without a stop, to know how many events there are."""
    return fixture_run.run(tmp_path_factory.mktemp("whole"))


def stopped_at(folder: Path, number: int) -> Ran:
    observed = 0

    def hook(_event: Event, stop: StopRequest, _bench: Bench) -> None:
        nonlocal observed
        if observed == number:
            stop.request()
        observed += 1

    return fixture_run.run(folder, hook=hook)


def check_truth(ran: Ran) -> None:
    """Record, flash and outcome agree; nothing is half written; the fixture is parked."""
    assert ran.parked
    for serial, r in ran.results.items():
        life = ran.life(serial)
        assert life["outcome"] == str(r.outcome)
        held = ran.coefficients(serial)
        assert len(held) == (12 if r.written else 0)
        if r.written:
            assert r.fit is not None
            assert r.fit.calibration is not None
            wanted = [*r.fit.calibration.matrix.ravel(), *r.fit.calibration.offset]
            assert held == pytest.approx(wanted, abs=1e-6)


def test_a_stop_at_any_event_leaves_a_true_record(whole: Ran, tmp_path: Path) -> None:
    interesting = [
        i
        for i, e in enumerate(whole.events)
        if isinstance(e, PhaseEntered | Judged | UnitDone)
        or (isinstance(e, VisitStarted | VisitDone) and e.number in (1, 6))
        or (isinstance(e, ObjectWritten) and e.number in (1, e.total))
    ]
    aborted = 0
    for number in interesting:
        folder = tmp_path / str(number)
        folder.mkdir()
        ran = stopped_at(folder, number)
        check_truth(ran)
        outcomes = {r.outcome for r in ran.results.values()}
        assert len(ran.results) == 1
        assert outcomes <= {Outcome.PASS, Outcome.ABORTED}
        if Outcome.ABORTED in outcomes:
            aborted += 1
            assert isinstance(ran.fault, Aborted)
    assert aborted > len(interesting) * 2 // 3


def test_while_it_writes_a_stop_waits_until_every_unit_is_whole(tmp_path: Path) -> None:
    def hook(event: Event, stop: StopRequest, _bench: Bench) -> None:
        if isinstance(event, ObjectWritten) and event.number == 5:
            stop.request()

    ran = fixture_run.run(tmp_path, units=2, hook=hook)
    check_truth(ran)
    assert [r.outcome for r in ran.results.values()] == [Outcome.ABORTED] * 2
    assert all(r.written and not r.verified for r in ran.results.values())
    assert [ran.stored(s, "device-state") for s in ran.results] == [{"state": "new"}] * 2


def test_a_signal_may_end_the_wait_for_a_person_at_once(tmp_path: Path) -> None:
    held: list[StopRequest] = []
    interruptible: list[bool] = []

    def confirm(_: Message) -> None:
        """Somebody presses Ctrl-C instead: the signal's handler raises out of the wait where it may."""
        interruptible.append(held[-1].waiting)
        held[-1].request()
        raise Aborted(held[-1].why)

    runs = [{"seating": "home"}, {"seating": "home", "motors": "off"}]
    name = fixture_run.recipe(tmp_path, runs=runs, method="n-point")
    ran = fixture_run.run(tmp_path, recipe=name, confirm=confirm, hook=lambda _, stop, __: held.append(stop))
    assert interruptible == [True]
    assert [r.outcome for r in ran.results.values()] == [Outcome.ABORTED]
    assert ran.parked
    check_truth(ran)


def test_a_stop_before_the_first_unit_touches_nothing(tmp_path: Path) -> None:
    stop = StopRequest()
    stop.request(Message.text("cover opened"))
    with open_bench(RunOrder(simulate=True, database=tmp_path / "station.db")) as bench:
        (seats,) = bench.loads(["SN0001"])
        bench.fixture.place(seats)
        events = list(Runner(bench.station, bench.job, stop).run(seats))
    assert [e.phase for e in events if isinstance(e, PhaseEntered)] == [Phase.CLOSE, Phase.PARK, Phase.DONE]
    assert Ran(tmp_path).lives("SN0001") == []


def test_whoever_stops_listening_leaves_a_finished_record_and_a_parked_fixture(whole: Ran, tmp_path: Path) -> None:
    for number in (0, 4, len(whole.events) // 2, len(whole.events) - 4):
        folder = tmp_path / str(number)
        folder.mkdir()
        order = RunOrder(simulate=True, database=folder / "station.db", device_state=folder / "devices")
        with open_bench(order) as bench:
            (seats,) = bench.loads(["SN0001"])
            bench.fixture.place(seats)
            running = Runner(bench.station, bench.job).run(seats)
            for _ in range(number + 1):
                next(running)
            running.close()
            where = bench.station.positioner.where()
            assert where is not None
            assert abs(where.attitude.trace() - 3.0) < 1e-9
        ran = Ran(folder)
        assert ran.life("SN0001")["outcome"] in ("ABORTED", "PASS")
        assert len(ran.coefficients("SN0001")) in (0, 12)
        assert not ran.memory("SN0001") or ran.stored("SN0001", "device-state") == {"state": "new"}


class _Broken:
    """A port that works until its n-th call of one method, and then fails; what else it is asked it hands on."""

    def __init__(self, port: object, method: str, number: int, error: Exception) -> None:
        self._port, self._method, self._left, self._error = port, method, number, error

    def __getattr__(self, name: str) -> object:
        found = getattr(self._port, name)
        if name != self._method:
            return found

        def call(*args: object, **kwargs: object) -> object:
            self._left -= 1
            if self._left < 0:
                raise self._error
            return found(*args, **kwargs)

        return call


def broken(name: str, method: str, number: int, error: Exception) -> Callable[[Bench], Bench]:
    from dataclasses import replace

    def wrap(bench: Bench) -> Bench:
        port: dict[str, Any] = {name: _Broken(getattr(bench.station, name), method, number, error)}
        return replace(bench, station=replace(bench.station, **port))

    return wrap


@pytest.mark.parametrize("method", ["visit", "result", "write", "event", "finish"])
@pytest.mark.parametrize("number", [0, 3])
def test_what_cannot_be_recorded_is_never_passed(tmp_path: Path, method: str, number: int) -> None:
    full = StoreFault("the log cannot be written: no space left on device; make room and start again")
    ran = fixture_run.run(tmp_path, units=2, wrap=broken("store", method, number, full))
    late = method == "finish" and number >= 2
    assert all(r.outcome is Outcome.ERROR for r in ran.results.values()) or late
    assert ran.parked
    if not late:
        assert isinstance(ran.fault, StoreFault)
        assert any("no space left" in x.sentence for r in ran.results.values() for x in r.reasons)


def test_an_attempt_that_cannot_begin_touches_no_device(tmp_path: Path) -> None:
    full = StoreFault("the log cannot be written: read-only file system; mount it writable")
    ran = fixture_run.run(tmp_path, units=2, wrap=broken("store", "begin", 1, full))
    assert isinstance(ran.fault, StoreFault)
    assert {r.outcome for r in ran.results.values()} == {Outcome.ERROR}
    assert not ran.of(VisitStarted)


def test_a_fixture_that_does_not_park_is_said_and_changes_no_verdict(tmp_path: Path) -> None:
    stuck = PositionerFault("the positioner did not reach its parking place within 20 s")
    ran = fixture_run.run(tmp_path, wrap=broken("positioner", "park", 0, stuck))
    assert ran.results["SN0001"].outcome is Outcome.PASS
    assert ran.fault is stuck


def test_a_bus_that_fails_ends_every_unit_with_its_name(tmp_path: Path) -> None:
    down = BusFault("can0 is down; bring it up: ip link set can0 up")
    ran = fixture_run.run(tmp_path, units=2, wrap=broken("bus", "stream", 0, down))
    assert {r.outcome for r in ran.results.values()} == {Outcome.ERROR}
    assert all(r.reasons[0].sentence == down.sentence for r in ran.results.values())
    assert [ran.memory(s) for s in ran.results] == [{}, {}]
