"""CANopen's service traffic of all nodes of one bus: one channel, one router, pumped by whoever waits."""

import logging
import threading
from collections.abc import Callable
from typing import cast

import can
import canopen

from station.domain.core.types import ERROR, REMOTE
from station.ports.bus import Channel
from station.ports.clock import Clock

#: It would write to standard error; what matters is said in our own errors.
logging.getLogger("canopen").addHandler(logging.NullHandler())

Listener = Callable[[int, bytearray, float], None]
#: Told of each frame before it leaves.
SentListener = Callable[[int, bytes], None]

#: How long one thread may keep the channel while others wait for their own frames.
_SLICE_S = 0.05
_TURN_S = 0.002


def service_ids(nodes: tuple[int, ...]) -> tuple[int, ...]:
    """What a service channel must receive of these nodes: EMCY, SDO answers, boot-up and heartbeat."""
    return tuple(base + node for node in nodes for base in (0x080, 0x580, 0x700))


class ServiceNetwork:
    """Frames in by pump(), out by send(); routed by a canopen.Network that has no thread and no socket of its own.

    Nothing runs behind it: frames are taken while somebody waits, so it works in simulated time as it does in
    real time. Several threads may wait at once, each for its own node. Errors: BusFault of the channel.
    """

    def __init__(self, channel: Channel, clock: Clock, sent: SentListener = lambda _id, _data: None) -> None:
        self.clock = clock
        self._channel = channel
        self._router = canopen.Network(cast(can.BusABC, _CanopenBus(channel, sent)))
        self._pumping = threading.Lock()

    def subscribe(self, can_id: int, listener: Listener) -> None:
        """Hands frames of this identifier to `listener(can_id, data, time_s)`."""
        self._router.subscribe(can_id, listener)

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one frame."""
        self._router.send_message(can_id, data)

    def pump(self, timeout_s: float) -> None:
        """Hands out the frames that are waiting; waits up to `timeout_s` for the first."""
        frames = self._channel.receive(timeout_s)
        for time_ns, can_id, length, data in zip(
            frames.time_ns.tolist(), frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True
        ):
            if not can_id & (ERROR | REMOTE):
                self._router.notify(can_id, bytearray(data[:length].tobytes()), time_ns / 1e9)

    def wait(self, arrived: Callable[[], bool], deadline_s: float) -> bool:
        """Pumps until `arrived()`, at most until the clock shows `deadline_s`; whether it arrived."""
        while not arrived():
            remaining_s = deadline_s - self.clock.monotonic_s()
            if remaining_s <= 0:
                return False
            if self._pumping.acquire(timeout=_TURN_S):
                try:
                    if not arrived():
                        self.pump(min(remaining_s, _SLICE_S))
                finally:
                    self._pumping.release()
        return True

    def catch_up(self) -> None:
        """Hands out what is waiting now, without waiting."""
        with self._pumping:
            self.pump(0.0)


class _CanopenBus:
    """What canopen takes for a bus: sends through the channel, receives nothing."""

    channel_info = "station service channel"

    def __init__(self, channel: Channel, sent: SentListener) -> None:
        self._channel, self._sent = channel, sent

    def send(self, message: can.Message) -> None:
        data = bytes(message.data)
        self._sent(message.arbitration_id, data)
        self._channel.send(message.arbitration_id, data)
