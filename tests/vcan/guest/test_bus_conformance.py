"""The kernel's bus keeps every promise of tests/conformance/bus_suite.py."""

from collections.abc import Callable, Iterator

import pytest
from vcan_harness.interface import Interface
from vcan_harness.raw import RawSocket

from station.adapters.bus.socketcan import SocketCan
from station.domain.core.types import REMOTE, Frames
from tests.conformance.bus_suite import BusSuite, Rig


class _KernelRig(Rig):
    """Frames come from a bare socket on the same interface."""

    own_times = False

    def __init__(self, interface: Interface, sender: RawSocket) -> None:
        self._interface, self._sender = interface, sender
        self.buses: list[SocketCan] = []

    def bus(self, coming: Frames) -> SocketCan:
        self._frames = coming
        self.buses.append(SocketCan(self._interface.name))
        return self.buses[-1]

    def play(self) -> None:
        for can_id, length, data in zip(self._frames.can_id, self._frames.length, self._frames.data, strict=True):
            self._sender.send(int(can_id), bytes(length) if can_id & REMOTE else data[:length].tobytes())


class TestSocketCan(BusSuite):
    """SocketCAN on a vcan."""

    @pytest.fixture
    def rig(self, vcan: Interface, raw_socket: Callable[..., RawSocket]) -> Iterator[Rig]:
        rig = _KernelRig(vcan, raw_socket(vcan))
        yield rig
        for bus in rig.buses:
            bus.close()
