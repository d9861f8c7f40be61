"""What goes wrong on the simulated wire does to sender and receiver what a real interface does."""

from collections.abc import Iterator

import numpy as np
import pytest

from station.adapters.bus._wire import TX_QUEUE_FRAMES
from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import VirtualClock
from station.domain.core.types import Frames
from station.errors import BusFault, UsageError
from station.ports.bus import ErrorCounters


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def bus(clock: VirtualClock) -> Iterator[SimulatedBus]:
    bus = SimulatedBus(clock)
    yield bus
    bus.close()


def readings(clock: VirtualClock, *times_s: float) -> Frames:
    n = len(times_s)
    time_ns = np.array([clock.at_ns(t) for t in times_s])
    return Frames(time_ns, np.full(n, 0x181, np.uint32), np.full(n, 8, np.uint8), np.zeros((n, 8), np.uint8))


def test_with_the_cable_out_requests_wait_in_the_queue_and_readings_are_lost(
    bus: SimulatedBus, clock: VirtualClock
) -> None:
    bus.break_wire("cable-out:after_s=1,seconds=2")
    station, stream, device = bus.service((0x581,)), bus.stream((0x181,)), bus.endpoint((0x601,))
    clock.sleep(1.5)
    station.send(0x601, b"\1")
    assert bus.state() == "passive"
    assert not len(device.receive(0.0))
    clock.sleep(2.0)
    device.send_many(readings(clock, 0.5, 0.999, 1.0, 2.999, 3.0, 3.4))
    accepted = stream.receive(0.0).time_ns.tolist()
    assert accepted == [clock.at_ns(t) for t in (0.5, 0.999, 3.0, 3.4)]
    station.receive(0.0)
    assert device.receive(0.0).data[:, 0].tolist() == [1]
    assert bus.state() == "active"


def test_more_than_the_queue_holds_is_refused_after_a_second_of_waiting(bus: SimulatedBus, clock: VirtualClock) -> None:
    bus.break_wire("cable-out")
    station = bus.service(())
    for _ in range(TX_QUEUE_FRAMES):
        station.send(0x601, b"")
    assert clock.monotonic_s() == 0.0
    with pytest.raises(BusFault, match="could not send for 1 s because its queue is full"):
        station.send(0x601, b"")
    assert clock.monotonic_s() == 1.0


def test_a_link_that_went_down_is_told_once_by_each_channel_and_by_every_send(
    bus: SimulatedBus, clock: VirtualClock
) -> None:
    bus.break_wire("link-down:after_s=1,seconds=1")
    station, stream, device = bus.service(()), bus.stream(()), bus.endpoint(())
    clock.sleep(1.0)
    for channel in (station, stream):
        with pytest.raises(BusFault, match="went down: bring it up with"):
            channel.receive(0.0)
        assert not len(channel.receive(0.0))
    for _ in range(2):
        with pytest.raises(BusFault, match="went down"):
            station.send(0x601, b"")
    assert not len(device.receive(0.0)), "a device sees no error of the station's interface"
    clock.sleep(1.0)
    station.send(0x601, b"\2")
    assert device.receive(0.0).data[:, 0].tolist() == [2]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("melted", "There is no fault BUS/'melted'; the bus knows link-down, cable-out"),
        ("cable-out:since=3", "'since' is not after_s=NUMBER or seconds=NUMBER"),
        ("cable-out:after_s=soon", "'after_s' is not after_s=NUMBER or seconds=NUMBER"),
        ("cable-out:seconds=-1", "'seconds' is not after_s=NUMBER or seconds=NUMBER"),
        ("cable-out:after_s=nan", "'after_s' is not"),
    ],
)
def test_a_wire_fault_that_cannot_be_is_refused(bus: SimulatedBus, text: str, says: str) -> None:
    with pytest.raises(UsageError) as refused:
        bus.break_wire(text)
    assert says in refused.value.sentence


@pytest.mark.parametrize(
    ("fault", "state", "counters"),
    [
        ("cable-out", "passive", ErrorCounters(sending=128, receiving=0)),
        ("wrong-bit-rate", "bus-off", ErrorCounters(sending=256, receiving=0)),
        ("jammed", "active", ErrorCounters(sending=0, receiving=0)),
    ],
)
def test_the_error_counters_stand_where_the_state_says(
    bus: SimulatedBus, clock: VirtualClock, fault: str, state: str, counters: ErrorCounters
) -> None:
    bus.break_wire(f"{fault}:after_s=1")
    assert bus.counters() == ErrorCounters(0, 0)
    clock.sleep(2.0)
    assert (bus.state(), bus.counters()) == (state, counters)
