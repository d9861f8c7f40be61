"""A CAN bus inside this process: python-can's virtual interface, on simulated time."""

import uuid

import numpy as np

from station.adapters.bus._filter import wanted
from station.adapters.bus._messages import to_frames, to_message
from station.adapters.bus._python_can import VirtualBus
from station.domain.types import Frames
from station.errors import BusFault
from station.ports.clock import EventClock

#: Actors look at their channels at every instant, and mostly nothing is there.
_NOTHING = Frames.empty()


class Simulated:
    """One virtual bus of one simulated rig; the channel is unique, so two rigs never hear each other.

    Single frames (SDO, NMT, heartbeat, SYNC) travel through python-can's virtual interface. Blocks of frames
    (`send_many`) are handed from endpoint to endpoint as arrays beside it: same filters, same receivers, and
    merged by time with the single ones when they are received. That order is global as long as every actor,
    when it acts, sends all that was due until then.
    """

    def __init__(self, clock: EventClock, name: str = "simulated") -> None:
        self._clock = clock
        self._name = name
        self._wire = f"{name}-{uuid.uuid4()}"
        self._channels: list[_Channel] = []

    @classmethod
    def open(cls, channel: str, clock: EventClock, _receive_buffer_bytes: int | None) -> "Simulated":
        """A new bus; `channel` is only its name."""
        return cls(clock, channel)

    @property
    def name(self) -> str:
        """What a person calls it."""
        return self._name

    def stream(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel that receives these ids and error frames."""
        return self._open(can_ids, errors=True)

    def service(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel that receives these ids, or all when none is given, and no error frames.

        Devices take theirs from here too."""
        return self._open(can_ids, errors=False)

    def state(self) -> str:
        """Always active: the virtual interface has no controller that could be anything else."""
        return "active"

    def close(self) -> None:
        """Closes every channel opened here."""
        for channel in list(self._channels):
            channel.close()

    def _open(self, can_ids: tuple[int, ...], *, errors: bool) -> "_Channel":
        channel = _Channel(self._clock, self._wire, self._channels, can_ids, errors=errors)
        self._channels.append(channel)
        return channel


class _Channel:
    """One endpoint of the virtual bus. receive(0.0) never moves time, so actors may call it."""

    def __init__(
        self, clock: EventClock, wire: str, peers: "list[_Channel]", can_ids: tuple[int, ...], *, errors: bool
    ) -> None:
        self._clock = clock
        self._peers = peers
        self._can_ids = can_ids
        self._errors = errors
        self._blocks: list[Frames] = []
        self._bus = VirtualBus(wire, preserve_timestamps=True)  # by its class: no .canrc can redirect it

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one frame now."""
        self._check_open()
        if len(data) > 8:
            raise ValueError(f"a classic frame holds 8 bytes, not {len(data)}")
        # Seconds since the clock's start: small enough for a float to hold them to the nanosecond.
        self._bus.send(to_message(can_id, data, self._clock.monotonic_s()))

    def send_many(self, frames: Frames) -> None:
        """Sends a block; the frames keep their time_ns, which may not lie in the future."""
        self._check_open()
        for peer in self._peers:
            if peer is not self:
                peer.take_block(frames)

    def take_block(self, frames: Frames) -> None:
        """Puts what this channel wants of a block among the frames waiting here."""
        mine = wanted(frames, self._can_ids, errors=self._errors)
        if mine.any():
            self._blocks.append(frames if mine.all() else frames[mine])

    def receive(self, timeout_s: float) -> Frames:
        """All frames waiting, in order of time; lets simulated time pass up to `timeout_s` until there are some."""
        self._check_open()
        until_s = self._clock.monotonic_s() + timeout_s
        frames = self._drain()
        if not len(frames) and timeout_s > 0:
            self._clock.settle()
            frames = self._drain()
        while not len(frames) and self._clock.monotonic_s() < until_s:
            self._clock.advance(until_s)
            frames = self._drain()
        return frames

    def drops(self) -> int:
        """None: the virtual interface's queue has no end."""
        return 0

    def close(self) -> None:
        """Leaves the bus; twice is harmless."""
        if self in self._peers:
            self._peers.remove(self)
            self._bus.shutdown()

    def _drain(self) -> Frames:
        singles_wait = not self._bus.queue.empty()
        if not self._blocks and not singles_wait:
            return _NOTHING
        blocks, self._blocks = self._blocks, []
        if singles_wait:
            singles = self._singles()
            blocks.insert(0, singles[wanted(singles, self._can_ids, errors=self._errors)])
        frames = blocks[0] if len(blocks) == 1 else Frames.join(blocks)
        if (np.diff(frames.time_ns) < 0).any():
            frames = frames[np.argsort(frames.time_ns, kind="stable")]
        return frames

    def _singles(self) -> Frames:
        messages = []
        while (message := self._bus.recv(0)) is not None:
            messages.append(message)
        return to_frames(messages, [self._clock.at_ns(m.timestamp) for m in messages])

    def _check_open(self) -> None:
        if self not in self._peers:
            raise BusFault("the channel of the simulated bus is closed; open another one")
