"""One suite over every bus of this process; the kernel's is in tests/vcan/guest/test_bus_conformance.py."""

import os
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from station import plugins
from station.adapters.bus import write_log
from station.adapters.bus._messages import to_message
from station.adapters.bus._python_can import mf4
from station.adapters.bus._several import SeveralBuses
from station.adapters.bus.python_can import PythonCan, interfaces
from station.adapters.bus.replay import ReplayBus
from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import SystemClock, VirtualClock
from station.config.settings import BusSettings
from station.domain.core.types import Frames
from station.errors import ConfigError
from station.messages import render
from tests.conformance.bus_suite import BusSuite, FramesSuite, Rig, rows_of


def test_every_bus_is_under_the_suite() -> None:
    assert set(plugins.names("station.adapters.bus")) == {"python-can", "replay", "simulated", "socketcan"}


class _SimulatedRig(Rig):
    """The first half sent frame by frame as simulated time goes on, the rest as one block."""

    def bus(self, coming: Frames) -> SimulatedBus:
        self._clock = VirtualClock(start_ns=int(coming.time_ns[0]))
        self._bus = SimulatedBus(self._clock)
        self._endpoint, self._frames = self._bus.service(()), coming
        return self._bus

    def play(self) -> None:
        half = min(len(self._frames) // 2, 100)
        rows = rows_of(self._frames)
        for can_id, data in rows[:half]:
            self._endpoint.send(can_id, data)
            self._clock.sleep(0.001)
        self._clock.sleep(0.001 * (len(rows) - half - 1))
        self._endpoint.send_many(self._frames[half:])


class TestSimulated(BusSuite):
    """python-can's virtual interface on simulated time."""

    @pytest.fixture
    def rig(self) -> Rig:
        return _SimulatedRig()


class _PythonCanRig(Rig):
    """Another python-can bus on the same channel sends; the station's takes now and then: no queue overflows."""

    own_times = False

    def __init__(self, driver: str) -> None:
        self.driver, self.opened = driver, list[Any]()

    def bus(self, coming: Frames) -> PythonCan:
        channel = self.channel = f"station-{uuid.uuid4()}" if self.driver == "virtual" else "239.74.163.2"
        settings = PythonCan.Settings(driver=self.driver, options=self._options())
        self._bus, self._frames = PythonCan.open(channel, SystemClock(), settings), coming
        self._peer = can.Bus(
            channel, interface=self.driver, ignore_config=True, **self._options()
        )  # stamps 0: those of arrival count
        self.opened += [self._bus, self._peer]
        return self._bus

    def play(self) -> None:
        everywhere = os.sched_getaffinity(0)
        # The loopback has a queue for each processor: a sender that is moved to another one overtakes itself.
        os.sched_setaffinity(0, {min(everywhere)})
        try:
            self._send()
        finally:
            os.sched_setaffinity(0, everywhere)

    def _send(self) -> None:
        for row, (can_id, data) in enumerate(rows_of(self._frames)):
            self._peer.send(to_message(can_id, data, 0.0, int(self._frames.length[row])))
            if row % 100 == 99:
                self._bus.take(0.0)

    def close(self) -> None:
        """Both sides."""
        for bus in self.opened:
            bus.close() if isinstance(bus, PythonCan) else bus.shutdown()

    def _options(self) -> dict[str, Any]:
        return {} if self.driver == "virtual" else {"port": 44_000 + os.getpid() % 1000, "hop_limit": 0}


class TestPythonCan(BusSuite):
    """Interfaces of python-can that need no hardware."""

    @pytest.fixture(params=["virtual", "udp_multicast"])
    def rig(self, request: pytest.FixtureRequest) -> Iterator[Rig]:
        rig = _PythonCanRig(request.param)
        yield rig
        rig.close()


@pytest.mark.parametrize("driver", ["virtual", "udp_multicast"])
def test_a_frame_is_stamped_when_it_is_sent_not_when_it_is_read(driver: str) -> None:
    rig = _PythonCanRig(driver)
    bus = rig.bus(Frames.empty())
    settings = PythonCan.Settings(driver=driver, options=rig._options())
    other = PythonCan.open(rig.channel, SystemClock(), settings)
    rig.opened.append(other)
    heard, sender = bus.stream((0x191,)), other.service(())
    before_ns = time.time_ns()
    sender.send(0x191, b"1")
    after_ns = time.time_ns()
    (stamp_ns,) = heard.receive(1.0).time_ns.tolist()
    assert before_ns - 1000 <= stamp_ns <= after_ns + 1000  # python-can keeps stamps as floats
    assert "not when it is read" in render(bus.limits)
    rig.close()


@pytest.mark.parametrize(
    ("driver", "channels"),
    [
        ("virtual", (f"station-{uuid.uuid4()}", f"station-{uuid.uuid4()}")),
        ("udp_multicast", ("239.74.163.11", "239.74.163.12")),
        ("udp_multicast", ("ff15:7079:7468:6f6e:6465::11", "ff15:7079:7468:6f6e:6465::12")),
    ],
    ids=["virtual", "udp", "udp6"],
)
def test_several_buses_are_one_fixture(driver: str, channels: tuple[str, str]) -> None:
    """A node is asked on its own bus, the others do not hear it, though one machine has them all; what comes is in the
    order of time."""
    clock, named = SystemClock(), dict(zip(("left", "right"), channels, strict=True))
    settings = PythonCan.Settings(driver=driver, options=_PythonCanRig(driver)._options())
    near = {name: PythonCan.open(channel, clock, settings) for name, channel in named.items()}
    far = {name: PythonCan.open(channel, clock, settings) for name, channel in named.items()}
    fixture = SeveralBuses(near, {17: "left", 18: "right"})
    service, stream = fixture.service(()), fixture.stream((0x191, 0x192))
    heard = {name: bus.service(()) for name, bus in far.items()}
    service.send(0x612, b"for 18")
    service.send(0x000, bytes([1, 17]))
    service.send(0x080, b"")
    assert rows_of(heard["left"].receive(0.2)) == [(0x000, bytes([1, 17])), (0x080, b"")]
    assert rows_of(heard["right"].receive(0.2)) == [(0x612, b"for 18"), (0x080, b"")]
    heard["right"].send(0x192, b"2")
    heard["left"].send(0x191, b"1")
    parts = [stream.receive(0.2), stream.receive(0.05)]
    assert sorted(rows_of(Frames.join(parts))) == [(0x191, b"1"), (0x192, b"2")]
    assert fixture.state() == "active" and stream.drops() == 0
    fixture.close()
    for bus in far.values():
        bus.close()


def test_what_an_interface_cannot_tell_is_said() -> None:
    bus = PythonCan.open(f"station-{uuid.uuid4()}", SystemClock(), PythonCan.Settings(driver="virtual"))
    assert "frames that adapter or driver lose are not counted" in render(bus.limits)
    bus.close()


@pytest.mark.parametrize("driver", [name for name in interfaces() if name != "virtual"])
def test_an_adapter_that_is_not_there_is_one_sentence(driver: str) -> None:
    with pytest.raises(ConfigError, match=f"^{driver} cannot open channel '0'") as refused:
        PythonCan.open("0", SystemClock(), PythonCan.Settings(driver=driver))
    assert len(refused.value.sentence) < 400


@pytest.mark.parametrize(("number", "text"), [(0, "0"), ("PCAN_USBBUS1", "PCAN_USBBUS1")])
def test_a_channel_may_be_a_number(number: int | str, text: str) -> None:
    assert BusSettings.model_validate({"interface": "kvaser", "channel": number}).channel == text


class _ReplayRig(Rig):
    sends = False

    def __init__(self, path: Path) -> None:
        self._path = path
        self.keeps_errors = path.suffix in (".log", ".blf")

    def bus(self, coming: Frames) -> ReplayBus:
        if self._path.suffix in (".log", ".blf"):
            write_log(self._path, coming)
        else:
            self._write_by_python_can(coming)
        return ReplayBus(self._path)

    def play(self) -> None:
        """The frames are in the log already."""

    def _write_by_python_can(self, frames: Frames) -> None:
        mf4()
        with can.Logger(self._path) as logger:
            for row, (can_id, data) in enumerate(rows_of(frames)):
                logger(to_message(can_id, data, frames.time_ns[row] / 1e9, int(frames.length[row])))


class TestReplay(BusSuite):
    """Recordings that are read in this process."""

    @pytest.fixture(params=[".log", ".blf", ".asc"])
    def rig(self, request: pytest.FixtureRequest, tmp_path: Path) -> Rig:
        return _ReplayRig(tmp_path / f"recorded{request.param}")


class TestReplayOfMeasurements(FramesSuite):
    """The same channels on what another process reads: each opening starts one, so the frames alone are tried."""

    @pytest.fixture
    def rig(self, tmp_path: Path) -> Rig:
        return _ReplayRig(tmp_path / "recorded.mf4")
