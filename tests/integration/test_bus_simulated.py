"""The simulated bus on simulated time: answers, time-outs, blocks among single frames, and its price."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import SystemClock, VirtualClock
from station.config.documents import Document
from station.config.settings import BusSettings
from station.domain.core.types import ERROR, Frames
from station.errors import ConfigError
from station.ports.bus import Endpoint
from station.wiring.buses import open_bus


class Device:
    """Answers each request on 0x601 after 2 ms and sends 1,000 readings a second, 20 ms at a time."""

    def __init__(self, clock: VirtualClock, endpoint: Endpoint) -> None:
        self._clock, self._endpoint = clock, endpoint
        self._answers: list[float] = []
        self._sent = 0

    def next_due_s(self) -> float:
        return min([*self._answers, (self._sent + 20) / 1000])

    def act(self, now_s: float) -> None:
        self._answers += [now_s + 0.002] * len(self._endpoint.receive(0.0))
        number = np.arange(self._sent, int(now_s * 1000 + 1e-6))
        if len(number):
            time_ns = self._clock.at_ns(0.0) + (number + 1) * 1_000_000
            data = number.astype("<u8").view(np.uint8).reshape(-1, 8)
            n = len(number)
            self._endpoint.send_many(Frames(time_ns, np.full(n, 0x181, np.uint32), np.full(n, 8, np.uint8), data))
            self._sent += n
        for _ in [d for d in self._answers if d <= now_s]:
            self._endpoint.send(0x581, b"\x60")
        self._answers = [d for d in self._answers if d > now_s]


@pytest.fixture
def clock() -> VirtualClock:
    """Time of one rig."""
    return VirtualClock()


@pytest.fixture
def bus(clock: VirtualClock) -> Iterator[SimulatedBus]:
    """One bus with one device on it."""
    bus = SimulatedBus(clock)
    clock.attach(Device(clock, bus.service((0x601,))))
    yield bus
    bus.close()


def test_an_answer_comes_after_the_devices_own_time(bus: SimulatedBus, clock: VirtualClock) -> None:
    service = bus.service((0x581,))
    service.send(0x601, b"\x40")
    answer = service.receive(1.0)
    assert answer.can_id.tolist() == [0x581]
    assert clock.monotonic_s() == 0.002
    assert answer.time_ns.tolist() == [clock.at_ns(0.002)]


def test_a_time_out_takes_exactly_its_time(bus: SimulatedBus, clock: VirtualClock) -> None:
    assert not len(bus.service((0x581,)).receive(0.3))
    assert clock.monotonic_s() == pytest.approx(0.3, abs=1e-12)


def test_receiving_nothing_at_once_moves_no_time(bus: SimulatedBus, clock: VirtualClock) -> None:
    assert not len(bus.stream((0x181,)).receive(0.0))
    assert clock.monotonic_s() == 0.0


def test_blocks_and_single_frames_are_merged_by_time(bus: SimulatedBus, clock: VirtualClock) -> None:
    everything, service = bus.stream(()), bus.service(())
    for _ in range(20):
        service.send(0x601, b"\x40")
        clock.sleep(0.0055)
    frames = everything.receive(0.0)
    assert (np.diff(frames.time_ns) >= 0).all()
    readings = frames[frames.can_id == 0x181]
    numbers = np.ascontiguousarray(readings.data).view("<u8")[:, 0]
    assert numbers.tolist() == list(range(len(numbers)))
    assert len(numbers) == 110
    answers = frames.time_ns[frames.can_id == 0x581] - clock.at_ns(0.0)
    np.testing.assert_allclose(answers, (0.0055 * np.arange(20) + 0.002) * 1e9, atol=2)


def test_a_sent_frame_is_stamped_with_the_present(clock: VirtualClock) -> None:
    bus = SimulatedBus(clock)
    listener, sender = bus.service((0x700,)), bus.service(())
    clock.sleep(86_400.123_456_789)
    sender.send(0x700, b"\x05")
    assert listener.receive(0.0).time_ns.tolist() == [clock.epoch_ns()]
    bus.close()


def test_error_frames_reach_streams_only(clock: VirtualClock) -> None:
    bus = SimulatedBus(clock)
    stream, service, endpoint = bus.stream((0x181,)), bus.service(()), bus.service(())
    one = np.ones(1, np.int64)
    frame = Frames(one, np.array([ERROR | 0x40], np.uint32), np.array([8], np.uint8), np.zeros((1, 8), np.uint8))
    endpoint.send_many(frame)
    assert len(stream.receive(0.0)) == 1
    assert not len(service.receive(0.0))
    bus.close()


def test_two_rigs_of_one_name_do_not_hear_each_other(clock: VirtualClock) -> None:
    here, there = SimulatedBus(clock, "rig"), SimulatedBus(clock, "rig")
    listener = there.stream(())
    here.service(()).send(0x1, b"")
    here.service(()).send_many(Frames(*(a[:1] for a in _one())))
    assert not len(listener.receive(0.1))
    here.close()
    there.close()


def _one() -> tuple[np.ndarray, ...]:
    return np.zeros(1, np.int64), np.ones(1, np.uint32), np.zeros(1, np.uint8), np.zeros((1, 8), np.uint8)


def test_three_minutes_at_one_kilohertz_take_no_time_worth_speaking_of(bus: SimulatedBus, clock: VirtualClock) -> None:
    """180,000 frames; the bound is forty times what it takes, so only a change of kind breaks it."""
    stream = bus.stream((0x181,))
    started_s, received = time.process_time(), 0
    for _ in range(900):
        clock.sleep(0.2)
        received += len(stream.receive(0.0))
    assert received == 180_000
    assert time.process_time() - started_s < 20.0


def test_a_bus_is_opened_by_the_name_of_its_file(clock: VirtualClock) -> None:
    document = Document(Path("config.yaml"), {}, {})
    assert open_bus(BusSettings(interface="simulated", channel="rig-3"), document, clock).name == "rig-3"
    with pytest.raises(ConfigError, match=r"There is no bus `pcam`"):
        open_bus(BusSettings(interface="pcam"), document, SystemClock())
