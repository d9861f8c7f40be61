"""Simulated devices in real time: one process, one channel, any number of devices."""

from collections.abc import Callable, Sequence

from station.domain.core.types import Frames
from station.ports.bus import Endpoint
from station.ports.clock import Actor, Clock

#: How long the loop may wait before it looks whether it is to go on.
POLL_S = 0.05


class Hub:
    """Shares one channel: every endpoint of it gets every frame that came."""

    def __init__(self, channel: Endpoint) -> None:
        self._channel = channel
        self._taps: list[_Tap] = []

    def endpoint(self) -> "_Tap":
        """A device's endpoint; receive() gives what wait() has taken from the bus."""
        self._taps.append(_Tap(self._channel))
        return self._taps[-1]

    def wait(self, timeout_s: float) -> None:
        """Waits up to `timeout_s` for frames and hands them to every endpoint."""
        frames = self._channel.receive(timeout_s)
        if len(frames):
            for tap in self._taps:
                tap.put(frames)


class _Tap:
    def __init__(self, channel: Endpoint) -> None:
        self._channel = channel
        self._frames: list[Frames] = []

    def put(self, frames: Frames) -> None:
        self._frames.append(frames)

    def send(self, can_id: int, data: bytes) -> None:
        self._channel.send(can_id, data)

    def send_many(self, frames: Frames) -> None:
        self._channel.send_many(frames)

    def receive(self, _timeout_s: float) -> Frames:
        received, self._frames = self._frames, []
        return Frames.join(received)

    def drops(self) -> int:
        return self._channel.drops()

    def close(self) -> None:
        self._frames.clear()


def serve(hub: Hub, devices: Sequence[Actor], clock: Clock, go_on: Callable[[], bool]) -> None:
    """Lets the devices live in real time for as long as `go_on()`; it is asked at least every POLL_S seconds."""
    while go_on():
        hub.wait(act_all(devices, clock))


def act_all(devices: Sequence[Actor], clock: Clock) -> float:
    """Lets every device act; for how long none has to again, s, POLL_S at most. Errors: BusFault."""
    now_s = clock.monotonic_s()
    for device in devices:
        device.act(now_s)
    due_s = min((device.next_due_s() for device in devices), default=now_s + POLL_S)
    return min(max(due_s - clock.monotonic_s(), 0.0), POLL_S)
