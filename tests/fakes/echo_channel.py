"""A channel whose devices answer at once in real time, from any thread: value of an object = its own address."""

import queue
import time
from collections.abc import Iterable

import numpy as np

from station.adapters.simulated_device.sdo_server import SdoServer
from station.domain.core.types import Frames


class AddressObjects:
    """Every object reads as its own address: four bytes, or twelve from 0x3000 on."""

    def read(self, index: int, sub: int) -> bytes:
        """The object's address."""
        word = index.to_bytes(2, "little") + bytes([sub, 0])
        return word * 3 if index >= 0x3000 else word

    def check(self, index: int, sub: int, size: int | None) -> None:
        """Anything goes."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Anything goes."""


class EchoChannel:
    """Implements ports.bus.Channel and ports.clock.Clock in real time, with an SDO server for each node."""

    def __init__(self, nodes: Iterable[int]) -> None:
        self._servers = {node: SdoServer(AddressObjects()) for node in nodes}
        self._answers: queue.Queue[tuple[int, bytes]] = queue.Queue()

    def send(self, can_id: int, data: bytes) -> None:
        """A request; the answer waits at once."""
        node = can_id - 0x600
        for answer in self._servers[node].handle(data):
            self._answers.put((0x580 + node, answer))

    def receive(self, timeout_s: float) -> Frames:
        """One answer, waited for."""
        try:
            can_id, data = self._answers.get(timeout=timeout_s) if timeout_s else self._answers.get_nowait()
        except queue.Empty:
            return Frames.empty()
        return Frames(
            np.zeros(1, np.int64),
            np.array([can_id], np.uint32),
            np.array([len(data)], np.uint8),
            np.frombuffer(data, np.uint8).reshape(1, 8),
        )

    def drops(self) -> int:
        """None."""
        return 0

    def close(self) -> None:
        """Nothing to close."""

    def monotonic_s(self) -> float:
        """Real time."""
        return time.monotonic()

    def epoch_ns(self) -> int:
        """Real time."""
        return time.time_ns()

    def sleep(self, duration_s: float) -> None:
        """Real time."""
        time.sleep(duration_s)
