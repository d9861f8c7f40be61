"""Any interface that python-can knows (pcan, kvaser, slcan, gs_usb, udp_multicast, virtual …), through one adapter.

What such an interface cannot tell is said when it is opened: whose clock its time stamps are, and that nobody counts
the frames that its driver loses.
"""

import os
import socket
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field

from station.adapters.bus._errors import SEND_DEADLINE_S
from station.adapters.bus._filter import accepted_mask
from station.adapters.bus._messages import packed_id, to_frames, to_message
from station.adapters.bus._python_can import can
from station.adapters.bus._recvmmsg import SO_RCVBUFFORCE
from station.domain.core.types import Frames
from station.domain.recipe.fields import StrictModel
from station.errors import BusFault, ConfigError
from station.messages import Message, system_reason
from station.ports.clock import Clock

#: Whose clock stamps a frame: the adapter's own, that of this machine when the frame is sent or arrives, or that of the
#: process that reads it. Others are not known.
_STAMPED_BY_ADAPTER: Final = ("kvaser", "pcan", "ixxat", "vector", "neovi", "gs_usb", "nican", "systec", "usb2can")
_STAMPED_ON_ARRIVAL: Final = ("virtual", "udp_multicast")
_STAMPED_ON_READING: Final = ("slcan", "serial", "socketcand", "robotell", "seeedstudio")
_WITHOUT_UNITS: Final = ("virtual", "udp_multicast")
_STATES: Final = {"ACTIVE": "active", "PASSIVE": "passive", "ERROR": "bus-off"}
#: Drivers whose `state` is the controller's own; of others it is a constant.
_STATE_KNOWN: Final = ("pcan", "ixxat", "virtual", "udp_multicast")
#: Interfaces that hear their own frames.
_ECHOING: Final = ("udp_multicast",)
#: Frames that wait for one channel at most; what comes beyond is counted as dropped.
MOST_WAITING: Final = 1_000_000
#: One call takes no more than this, however fast they come.
_MOST_AT_ONCE: Final = 20_000
#: Stamps further from the machine's clock than this are of a clock of their own.
_SAME_CLOCK_S: Final = 3600.0
#: What the drivers raise where hardware, library or options are not as they need them.
_OPENING_FAILS: Final = (
    *(can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError),
    *(NameError, AttributeError, LookupError, RuntimeError),
)
_BUFFER_BYTES: Final = 16 << 20
#: IP_MULTICAST_ALL and IPV6_MULTICAST_ALL of <linux/in.h> and <linux/in6.h>; Python names neither.
_MULTICAST_ALL: Final = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}


def interfaces() -> tuple[str, ...]:
    """Names of the interfaces that python-can knows on this machine."""
    return tuple(sorted(can.VALID_INTERFACES))


class PythonCan:
    """One python-can bus, shared by all channels opened here: whoever receives takes for all of them.

    Errors: ConfigError when python-can has no such interface, lacks its driver, or cannot open it.
    """

    interface_of_kernel = False
    without_units = False

    class Settings(StrictModel):
        """driver: python-can's name of the interface; bitrate, data_bitrate: bit/s; fd: opens it for FD frames;
        options: what else this interface wants, by python-can's own names."""

        driver: str = "virtual"
        bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 500_000
        data_bitrate: Annotated[int, Field(ge=10_000, le=10_000_000)] | None = None
        fd: bool = False
        options: dict[str, Any] = Field(default_factory=dict)

    @classmethod
    def on_a_wire(cls, _channel: str) -> bool:
        """It may be."""
        return True

    def __init__(self, bus: can.BusABC, name: str, driver: str) -> None:
        self._bus, self._name, self._driver = bus, name, driver
        self._channels: list[_Channel] = []
        self._taking = threading.Lock()
        self._echoes: deque[tuple[int, bytes]] = deque(maxlen=1000)
        _tune(bus)

    @classmethod
    def open(cls, channel: str, _clock: Clock, settings: Settings) -> "PythonCan":
        """The channel of that name."""
        given: dict[str, Any] = {"bitrate": settings.bitrate, **settings.options}
        if settings.fd:
            given |= {"fd": True} | ({"data_bitrate": settings.data_bitrate} if settings.data_bitrate else {})
        if settings.driver in _WITHOUT_UNITS:
            given.pop("bitrate")
        if settings.driver == "virtual":
            given.setdefault("preserve_timestamps", True)  # a simulated device says when it sends
        try:
            bus = can.Bus(channel=channel, interface=settings.driver, ignore_config=True, **given)
        except _OPENING_FAILS as error:
            about = {"driver": settings.driver, "channel": channel[:40], "why": _why(error)}
            raise ConfigError("python-can-not-opened", **about) from None
        return cls(bus, channel, settings.driver)

    @property
    def name(self) -> str:
        """Interface and channel."""
        return f"{self._driver} {self._name}"

    @property
    def limits(self) -> Message:
        """What this interface cannot tell."""
        stamps = "time-stamps-unknown"
        if self._driver in _STAMPED_BY_ADAPTER:
            stamps = "time-stamps-of-adapter"
        elif self._driver in _STAMPED_ON_ARRIVAL:
            stamps = "time-stamps-on-arrival"
        elif self._driver in _STAMPED_ON_READING:
            stamps = "time-stamps-on-reading"
        silent = (*_STAMPED_ON_ARRIVAL, *_STAMPED_ON_READING)
        errors = "errors-not-reported" if self._driver in silent else "errors-as-driver-reports"
        return Message("python-can-limits", bus=self.name, stamps=Message(stamps), errors=Message(errors))

    def stream(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel that receives these ids (none: all) and error frames."""
        return self._open(can_ids, errors=True)

    def service(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel that receives these ids (none: all) and no error frames."""
        return self._open(can_ids, errors=False)

    def repeat(self, can_id: int, data: bytes, period_s: float) -> "_Repeated":
        """Sends a frame every period_s by the driver's own timer, or python-can's thread where it has none."""
        try:
            return _Repeated(self._bus.send_periodic(to_message(can_id, data, 0.0), period_s))
        except can.CanError as error:
            raise self._fault(error) from None

    def state(self) -> str:
        """The controller's state where the driver tells it, else unknown."""
        if self._driver not in _STATE_KNOWN:
            return "unknown"
        try:
            return _STATES.get(self._bus.state.name, "unknown")
        except (can.CanError, NotImplementedError):
            return "unknown"

    def counters(self) -> None:
        """None: python-can does not tell them."""
        return

    def close(self) -> None:
        """Closes every channel and the interface."""
        for channel in list(self._channels):
            channel.close()
        with suppress(can.CanError, OSError):
            self._bus.shutdown()

    def take(self, timeout_s: float) -> None:
        """Hands what has come to every channel that wants it; waits up to timeout_s for the first."""
        if not self._taking.acquire(timeout=max(timeout_s, 0.001)):
            return  # another thread takes for all
        try:
            messages, times_ns = [], []
            message = self._bus.recv(timeout_s)
            while message is not None:
                if not self._is_echo(message):
                    messages.append(message)
                    times_ns.append(_stamp_ns(message))
                message = self._bus.recv(0) if len(messages) < _MOST_AT_ONCE else None
        except (can.CanError, OSError) as error:
            raise self._fault(error) from None
        finally:
            self._taking.release()
        if messages:
            self._hand_out(to_frames(messages, times_ns), None)

    def send(self, sender: "_Channel", can_id: int, data: bytes, time_ns: int | None = None) -> None:
        """Sends a frame; the other channels of this bus hear it too, as they would on a wire."""
        time_ns = time.time_ns() if time_ns is None else time_ns
        message = to_message(can_id, data, time_ns / 1e9)
        if self._driver in _ECHOING:
            self._echoes.append((can_id, data))
        try:
            self._bus.send(message, timeout=SEND_DEADLINE_S)
        except (can.CanError, OSError) as error:
            raise self._fault(error) from None
        self._hand_out(to_frames([message], [time_ns]), sender)

    def _is_echo(self, message: can.Message) -> bool:
        """Whether this is what was sent here; each frame comes back once."""
        own = (packed_id(message), bytes(message.data))
        if own not in self._echoes:
            return False
        self._echoes.remove(own)
        return True

    def leave(self, channel: "_Channel") -> None:
        """The channel hears no more."""
        if channel in self._channels:
            self._channels.remove(channel)

    def _hand_out(self, frames: Frames, but: "_Channel | None") -> None:
        for channel in self._channels:
            if channel is not but:
                channel.put(frames)

    def _open(self, can_ids: tuple[int, ...], *, errors: bool) -> "_Channel":
        channel = _Channel(self, can_ids, errors=errors)
        self._channels.append(channel)
        return channel

    def _fault(self, error: Exception) -> BusFault:
        return BusFault("python-can-failed", bus=self.name, why=" ".join(str(error).split())[:200])


class _Repeated:
    """A periodic job of python-can."""

    def __init__(self, task: Any) -> None:
        self._task = task

    def close(self) -> None:
        """Ends it; twice is harmless."""
        self._task.stop()


class _Channel:
    """What one user of the bus wants of it."""

    def __init__(self, bus: PythonCan, can_ids: tuple[int, ...], *, errors: bool) -> None:
        self._bus, self._can_ids, self._errors = bus, can_ids, errors
        self._waiting: deque[Frames] = deque()
        self._count = self._dropped = 0
        self._closed = False

    def put(self, frames: Frames) -> None:
        """Keeps what this channel wants until it is received."""
        mine = accepted_mask(frames, self._can_ids, errors=self._errors)
        if not mine.any():
            return
        wanted = frames if mine.all() else frames[mine]
        if self._count + len(wanted) > MOST_WAITING:
            self._dropped += len(wanted)
            return
        self._waiting.append(wanted)
        self._count += len(wanted)

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one classic frame."""
        self._check_open()
        if len(data) > 8:
            raise ValueError(f"a classic frame holds 8 bytes, not {len(data)}")
        self._bus.send(self, can_id, data)

    def send_many(self, frames: Frames) -> None:
        """Sends the frames one after the other, now; FD ones too, where the bus is open for them. Their times reach a
        `virtual` bus only."""
        self._check_open()
        rows = zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, frames.time_ns.tolist(), strict=True)
        for can_id, length, data, time_ns in rows:
            self._bus.send(self, can_id, data[:length].tobytes(), time_ns)

    def receive(self, timeout_s: float) -> Frames:
        """All frames waiting, in order; waits up to timeout_s for the first."""
        self._check_open()
        self._bus.take(0.0)
        until_s = time.monotonic() + timeout_s
        while not self._waiting and (remaining_s := until_s - time.monotonic()) > 0:
            self._bus.take(remaining_s)
        parts = [self._waiting.popleft() for _ in range(len(self._waiting))]
        self._count -= sum(map(len, parts))
        frames = Frames.join(parts)
        if (np.diff(frames.time_ns) < 0).any():
            frames = frames[np.argsort(frames.time_ns, kind="stable")]
        return frames

    def drops(self) -> int:
        """Frames dropped here; what driver and adapter lose nobody counts."""
        self._check_open()
        return self._dropped

    def close(self) -> None:
        """Leaves the bus; twice is harmless."""
        self._closed = True
        self._bus.leave(self)

    def _check_open(self) -> None:
        if self._closed:
            raise BusFault("channel-closed", bus=self._bus.name)


def _why(error: Exception) -> str | Message:
    """What a driver said about why it cannot be opened."""
    if isinstance(error, OSError):
        return system_reason(error)
    if isinstance(error, (NameError, AttributeError)):  # python-can goes on where the maker's library was not found
        return Message("driver-library-missing")
    return " ".join(str(error).split())[:200]


def _stamp_ns(message: can.Message) -> int:
    """The frame's own time where it is of the machine's clock, else the present."""
    now_ns = time.time_ns()
    stamp_s = message.timestamp or 0.0
    return round(stamp_s * 1e9) if abs(stamp_s - now_ns / 1e9) < _SAME_CLOCK_S else now_ns


def _tune(bus: can.BusABC) -> None:
    """The socket, where the interface is one: its default buffer holds a few hundred frames; and of the local network
    it hears every group that any program of this machine has joined, while a channel is one group."""
    try:
        number = os.dup(bus.fileno())
    except (NotImplementedError, OSError):
        return
    with socket.socket(fileno=number) as own:
        try:
            own.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, _BUFFER_BYTES)
        except OSError:
            with suppress(OSError):
                own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        if own.family in _MULTICAST_ALL and own.type == socket.SOCK_DGRAM:
            with suppress(OSError):  # an older kernel
                own.setsockopt(*_MULTICAST_ALL[own.family], 0)
