"""GRBL over a serial port: `ok` is not arrival, an alarm is never unlocked, whatever ends a move holds the feed."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from station.adapters.clock import SystemClock, VirtualClock
from station.adapters.positioner._twin import TwinPort
from station.adapters.positioner.gcode import GcodePositioner
from station.adapters.simulated_device.grbl import FAULTS, GrblStub
from station.adapters.simulated_device.grbl_port import GrblPort
from station.errors import Aborted, PositionerFault, StationError
from tests.fakes.driven_rig import visit

OUTCOMES = {
    "": None,
    "alarm-before": "gcode-alarm",
    "limit": "gcode-alarm",
    "door": "gcode-state",
    "reset": "gcode-alarm",
    "jammed": "positioner-timed-out",
    "refuses": "gcode-refused",
    "silent": "gcode-silent",
    "stands-aside": "drive-outside-window",
}


class Noted(TwinPort):
    """A port that remembers what was written, and may be interrupted by the operator."""

    def __init__(self, stub: GrblStub, clock: VirtualClock) -> None:
        super().__init__(stub, clock)
        self.written = b""
        self.stop_at_s = float("inf")
        self.time_s = clock.monotonic_s

    def write(self, data: bytes) -> None:
        self.written += data
        super().write(data)

    def read(self, size: int) -> bytes:
        if self.time_s() >= self.stop_at_s:
            self.stop_at_s = float("inf")
            raise Aborted("stopped-by-operator")
        return super().read(size)


def bench(fault: str = "") -> tuple[GcodePositioner, Noted, VirtualClock]:
    """A positioner with a controller of that fault."""
    clock = VirtualClock()
    port = Noted(GrblStub(180.0, fault), clock)
    return GcodePositioner(GcodePositioner.Settings(port="/dev/simulated"), clock, port), port, clock


def test_every_fault_has_an_outcome() -> None:
    assert {k for k in OUTCOMES if k} == set(FAULTS)


@pytest.mark.parametrize("fault", OUTCOMES)
def test_a_fault_has_its_outcome_and_nothing_is_unlocked(fault: str) -> None:
    positioner, port, clock = bench(fault)
    ended: StationError | None = None
    try:
        positioner.move(visit("+x"), 30.0)
    except PositionerFault as exc:
        ended = exc
    assert (ended.message.id if ended else None) == OUTCOMES[fault]
    assert b"$X" not in port.written
    assert b"$H" not in port.written
    if ended is not None:
        with pytest.raises(PositionerFault, match="stays where it is"):
            positioner.park(30.0)
    clock.sleep(1.0)
    assert not port.stub.moving(clock.monotonic_s())


def test_ok_is_not_arrival() -> None:
    positioner, port, clock = bench()
    positioner.move(visit("+x"), 30.0)
    assert port.stub.place(clock.monotonic_s()) == pytest.approx((0.0, -90.0))
    assert clock.monotonic_s() >= 1.5


def test_a_stop_holds_the_feed_at_once_and_the_rig_parks_without_losing_its_place() -> None:
    positioner, port, clock = bench()
    port.stop_at_s = 0.6
    with pytest.raises(Aborted):
        positioner.move(visit("+x"), 30.0)
    assert port.written.endswith(b"!")
    _, y = port.stub.place(clock.monotonic_s())
    assert not port.stub.moving(clock.monotonic_s())
    assert -89.0 < y < -1.0
    positioner.park(30.0)
    assert port.stub.place(clock.monotonic_s()) == pytest.approx((0.0, 0.0))


@contextmanager
def controller_on_a_pty() -> Iterator[tuple[str, GrblStub]]:
    """A controller behind a real pseudo-terminal, served by a thread."""
    stub, over = GrblStub(100_000.0), threading.Event()
    with GrblPort(stub) as port:
        thread = threading.Thread(target=port.serve, args=(lambda: not over.is_set(),))
        thread.start()
        try:
            yield port.name, stub
        finally:
            over.set()
            thread.join()


def test_it_turns_over_a_real_serial_port() -> None:
    with controller_on_a_pty() as (name, stub):
        positioner = GcodePositioner(GcodePositioner.Settings(port=name), SystemClock())
        try:
            positioner.move(visit("+x"), 30.0)
            assert stub.place(time.monotonic()) == pytest.approx((0.0, -90.0))
            positioner.park(30.0)
        finally:
            positioner.close()


def test_a_port_that_is_not_there_gets_a_sentence() -> None:
    positioner = GcodePositioner(GcodePositioner.Settings(port="/dev/no-such-port"), SystemClock())
    with pytest.raises(PositionerFault, match="Serial port /dev/no-such-port cannot be opened"):
        positioner.move(visit("+x"), 1.0)
