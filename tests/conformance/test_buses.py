"""One suite over every bus of this process; the kernel's is in tests/vcan/guest/test_bus_conformance.py."""

from pathlib import Path

import can
import pytest

from station import plugins
from station.adapters.bus import write_log
from station.adapters.bus._messages import to_message
from station.adapters.bus._python_can import mf4
from station.adapters.bus.replay import ReplayBus
from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import VirtualClock
from station.domain.core.types import Frames
from tests.conformance.bus_suite import BusSuite, Rig, rows_of


def test_every_bus_is_under_the_suite() -> None:
    assert set(plugins.names("station.adapters.bus")) == {"replay", "simulated", "socketcan"}


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
    """Recordings of every kind that can be read."""

    @pytest.fixture(params=[".log", ".blf", ".asc", ".mf4"])
    def rig(self, request: pytest.FixtureRequest, tmp_path: Path) -> Rig:
        return _ReplayRig(tmp_path / f"recorded{request.param}")
