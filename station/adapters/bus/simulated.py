"""A CAN bus inside this process, on simulated time."""

import errno
from collections.abc import Sequence

import numpy as np

from station.adapters.bus._errors import SEND_DEADLINE_S, socket_error
from station.adapters.bus._filter import accepted_mask, accepts
from station.adapters.bus._wire import TX_QUEUE_FRAMES, Wire, parse
from station.domain.core.types import REMOTE, Frames
from station.domain.recipe.fields import StrictModel
from station.errors import BusFault
from station.ports.bus import ErrorCounters
from station.ports.clock import EventClock

#: Actors look at their channels at every instant, and mostly nothing is there.
_NO_FRAMES = Frames.empty()


class SimulatedBus:
    """One bus of one simulated rig; two rigs never hear each other.

    Single frames (SDO, NMT, heartbeat, SYNC) are put one by one among those that wait at each endpoint, blocks of
    frames (`send_many`) as arrays: same filters, same receivers, merged by time when they are received. That order is
    global as long as every actor, when it acts, sends all that was due until then.

    `break_wire` puts faults between the station's channels and the devices' endpoints, which never see an error.
    """

    interface_of_kernel = False
    without_units = True

    class Settings(StrictModel):
        """No options."""

    @classmethod
    def on_a_wire(cls, _channel: str) -> bool:
        """There is none."""
        return False

    def __init__(self, clock: EventClock, name: str = "simulated") -> None:
        self._clock = clock
        self._name = name
        self._channels: list[_Channel] = []
        self._wire = Wire()

    @classmethod
    def open(cls, channel: str, clock: EventClock, _settings: Settings) -> "SimulatedBus":
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
        """A channel that receives these ids, or all when none is given, and no error frames."""
        return self._open(can_ids, errors=False)

    def endpoint(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A device's side of the bus."""
        return self._open(can_ids, errors=False, of_station=False)

    def break_wire(self, fault: str) -> None:
        """One more fault, as `KIND` or `KIND:after_s=6,seconds=2`. Errors: UsageError."""
        self._wire.add(parse(fault))

    def repeat(self, can_id: int, data: bytes, period_s: float) -> "_Repeated":
        """Sends a frame every period_s of simulated time."""
        return _Repeated(self._clock, self.service((0x7FF,)), can_id, data, period_s)

    def state(self) -> str:
        """Active, unless something is wrong with the wire."""
        return self._wire.state(self._clock.monotonic_s())

    def counters(self) -> ErrorCounters:
        """Where a controller's counters stand in such a state."""
        return ErrorCounters(*self._wire.counters(self._clock.monotonic_s()))

    def close(self) -> None:
        """Closes every channel opened here."""
        for channel in list(self._channels):
            channel.close()

    def _open(self, can_ids: tuple[int, ...], *, errors: bool, of_station: bool = True) -> "_Channel":
        wire = self._wire if of_station else None
        channel = _Channel(self._clock, self._name, self._channels, can_ids, wire, errors=errors)
        self._channels.append(channel)
        return channel


class _Repeated:
    """An actor that sends one frame at each multiple of its period; it sends before any device acts."""

    def __init__(self, clock: EventClock, channel: "_Channel", can_id: int, data: bytes, period_s: float) -> None:
        self._clock, self._channel, self._can_id, self._data = clock, channel, can_id, data
        self._period_s, self._next_s = period_s, clock.monotonic_s() + period_s
        self._open = True
        clock.attach(self)

    def next_due_s(self) -> float:
        """The next instant."""
        return self._next_s

    def act(self, now_s: float) -> None:
        """Sends when it is time; what fails is missing, as on a wire."""
        while self._next_s <= now_s:
            self._next_s += self._period_s
            self._channel.send_now(self._can_id, self._data)

    def close(self) -> None:
        """Leaves the bus."""
        if self._open:
            self._open = False
            self._clock.detach(self)
            self._channel.close()


class _Channel:
    """One endpoint of the virtual bus. receive(0.0) never moves time, so actors may call it."""

    def __init__(
        self,
        clock: EventClock,
        name: str,
        peers: "list[_Channel]",
        can_ids: tuple[int, ...],
        wire: Wire | None,
        *,
        errors: bool,
    ) -> None:
        self._clock = clock
        self._name = name
        self._wire = wire
        self._held: list[tuple[int, bytes]] = []
        self._looked_s = clock.monotonic_s()
        self._open = True
        self._peers = peers
        self._can_ids = can_ids
        self._errors = errors
        self._blocks: list[Frames] = []
        self._singles: list[tuple[int, int, bytes]] = []

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one frame now."""
        self._check_open()
        if len(data) > 8:
            raise ValueError(f"a classic frame holds 8 bytes, not {len(data)}")
        if self._wire is None or self._transmits_now(self._wire, can_id, data):
            self._put(can_id, data)

    def send_now(self, can_id: int, data: bytes) -> None:
        """Sends one frame, if the wire is whole; no time passes."""
        now_s = self._clock.monotonic_s()
        if self._wire is None or not (self._wire.fails(now_s) or self._wire.holds(now_s)):
            self._put(can_id, data)

    def send_many(self, frames: Frames) -> None:
        """Sends a block; the frames keep their time_ns, which may not lie in the future."""
        self._check_open()
        for peer in self._peers:
            if peer is not self:
                peer.take_block(frames)

    def _put(self, can_id: int, data: bytes) -> None:
        """One frame of this instant to everybody else."""
        single = self._clock.epoch_ns(), can_id, b"" if can_id & REMOTE else bytes(data)
        for peer in self._peers:
            if peer is not self:
                peer.take_single(single)

    def take_single(self, single: tuple[int, int, bytes]) -> None:
        """Puts a frame (time_ns, can_id, data) among those waiting here, where this channel wants it."""
        if accepts(single[1], self._can_ids, errors=self._errors):
            self._singles.append(single)

    def take_block(self, frames: Frames) -> None:
        """Puts what this channel wants of a block among the frames waiting here."""
        mine = accepted_mask(frames, self._can_ids, errors=self._errors)
        if mine.any():
            self._blocks.append(frames if mine.all() else frames[mine])

    def receive(self, timeout_s: float) -> Frames:
        """All frames waiting, in order of time; lets simulated time pass up to `timeout_s` until there are some."""
        self._check_open()
        if self._wire is not None:
            self._pick_up(self._wire)
        frames = self._drain()
        if timeout_s <= 0 or len(frames):
            return frames
        until_s = self._clock.monotonic_s() + timeout_s
        self._clock.settle()
        frames = self._drain()
        while not len(frames) and self._clock.monotonic_s() < until_s:
            self._clock.advance(until_s)
            frames = self._drain()
        return frames

    def drops(self) -> int:
        """None: what waits here has no end."""
        return 0

    def close(self) -> None:
        """Leaves the bus; twice is harmless."""
        if self._open:
            self._open = False
            self._peers.remove(self)

    def _drain(self) -> Frames:
        if not self._blocks and not self._singles:
            return _NO_FRAMES
        blocks, self._blocks = self._blocks, []
        singles, self._singles = self._singles, []
        if not blocks:
            frames = _frames_of(singles)  # of the instants at which they were sent, so in order
        else:
            frames = Frames.join([_frames_of(singles), *blocks] if singles else blocks)
            if (frames.time_ns[1:] < frames.time_ns[:-1]).any():
                frames = frames[np.argsort(frames.time_ns, kind="stable")]
        if self._wire is None:
            return frames
        return self._wire.arriving(frames, self._clock.monotonic_s(), self._clock.epoch_ns())

    def _transmits_now(self, wire: Wire, can_id: int, data: bytes) -> bool:
        """Whether a frame of the station reaches the bus now; else it fails, or waits in the interface's queue."""
        if wire.whole:
            return True
        if wire.fails(self._clock.monotonic_s()) == errno.ENOBUFS or len(self._held) >= TX_QUEUE_FRAMES:
            self._clock.sleep(SEND_DEADLINE_S)
        now_s = self._clock.monotonic_s()
        number = wire.fails(now_s)
        if number or (wire.holds(now_s) and len(self._held) >= TX_QUEUE_FRAMES):
            raise BusFault(socket_error(self._name, number or errno.ENOBUFS))
        if wire.holds(now_s):
            self._held.append((can_id, data))
            return False
        self._send_held()
        return True

    def _pick_up(self, wire: Wire) -> None:
        """Tells once that the link went down; sends what waited, when it can."""
        now_s, before_s = self._clock.monotonic_s(), self._looked_s
        self._looked_s = now_s
        if wire.went_down(before_s, now_s):
            raise BusFault(socket_error(self._name, errno.ENETDOWN))
        if self._held and not wire.holds(now_s):
            self._send_held()

    def _send_held(self) -> None:
        held, self._held = self._held, []
        for can_id, data in held:
            self._put(can_id, data)

    def _check_open(self) -> None:
        if not self._open:
            raise BusFault("channel-closed", bus="simulated")


def _frames_of(singles: Sequence[tuple[int, int, bytes]]) -> Frames:
    """Single frames as arrays, in the order in which they were sent."""
    time_ns, can_id, data = zip(*singles, strict=True)
    payload = b"".join(one.ljust(8, b"\0") for one in data)
    return Frames(
        np.array(time_ns, np.int64),
        np.array(can_id, np.uint32),
        np.array([len(one) for one in data], np.uint8),
        np.frombuffer(payload, np.uint8).reshape(len(data), 8),
    )
