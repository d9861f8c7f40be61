"""A real CAN interface (or vcan) through Linux SocketCAN."""

import errno
import select
import socket
import struct
import time
from typing import Annotated, Final

from pydantic import Field

from station.adapters.bus import _errors, _netlink
from station.adapters.bus._errors import SEND_DEADLINE_S
from station.adapters.bus._recvmmsg import SO_MEMINFO, SO_RCVBUFFORCE, Receiver
from station.domain.core.types import EXTENDED, Frames
from station.domain.recipe.fields import StrictModel
from station.errors import BusFault, ConfigError
from station.messages import system_reason
from station.ports.bus import ErrorCounters
from station.ports.clock import Clock

#: 16 MiB hold about 43,000 frames, nearly 5 s of a full 1 Mbit/s bus; the default holds 31 ms.
STREAM_BUFFER_BYTES: Final = 16 << 20
SERVICE_BUFFER_BYTES: Final = 1 << 20
#: A flood must not keep one call for ever.
MOST_BATCHES: Final = 32
#: Kinds of links that exist in the kernel only.
_VIRTUAL: Final = ("vcan", "vxcan")
_CAN_RAW_ERR_FILTER, _ALL_ERRORS = 2, 0x1FFF_FFFF
_FRAME, _FD_FRAME = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")
#: struct bcm_msg_head of <linux/can/bcm.h>, and what sets up a cyclic frame.
_BCM_HEAD = struct.Struct("@IIIllllII0q")
_TX_SETUP, _SETTIMER, _STARTTIMER = 1, 1, 2
_CAN_RAW_FD_FRAMES, _FD_MTU, _BIT_RATE_SWITCH = 5, 72, 1
#: Lengths that an FD frame can have beyond 8 bytes (ISO 11898-1).
_FD_LENGTHS: Final = (12, 16, 20, 24, 32, 48, 64)


def state_of(name: str) -> tuple[str, ErrorCounters | None]:
    """Controller state and error counters of an interface as the kernel knows them, opened by anybody or nobody."""
    try:
        link = _netlink.query_link(name)
    except OSError:
        return "unknown", None
    if not link.up or link.can_state in ("stopped", "sleeping"):
        return "down", link.counters
    virtual = "active" if link.kind in _VIRTUAL else "unknown"
    return link.can_state or virtual, link.counters


class SocketCan:
    """One CAN interface. Streams see error frames and have a large buffer; services see no error frames.

    Errors: ConfigError when the interface does not exist or the kernel has no CAN.
    """

    interface_of_kernel = True
    without_units = False

    class Settings(StrictModel):
        """bitrate: what the link must run at, bit/s (`ip link` sets it); receive_buffer_bytes: of a stream, in the
        kernel."""

        bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 500_000
        receive_buffer_bytes: Annotated[int, Field(ge=65_536, le=1 << 30)] = STREAM_BUFFER_BYTES

    @classmethod
    def on_a_wire(cls, channel: str) -> bool:
        """Whether a controller stands behind the interface, as far as the kernel can tell."""
        try:
            return _netlink.query_link(channel).kind not in _VIRTUAL
        except OSError:
            return True

    def __init__(self, name: str, stream_buffer_bytes: int = STREAM_BUFFER_BYTES) -> None:
        self._name = name
        self._stream_buffer_bytes = stream_buffer_bytes
        self._channels: list[_Channel] = []
        self._open((), errors=False, buffer_bytes=SERVICE_BUFFER_BYTES).close()  # fails now, not in mid-run

    @classmethod
    def open(cls, channel: str, _clock: Clock, settings: Settings) -> "SocketCan":
        """The interface of that name."""
        return cls(channel, settings.receive_buffer_bytes)

    @property
    def name(self) -> str:
        """can0, vcan0, …"""
        return self._name

    def stream(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel that receives these ids (none: all) and error frames."""
        return self._open(can_ids, errors=True, buffer_bytes=self._stream_buffer_bytes)

    def service(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel that receives these ids (none: all) and no error frames."""
        return self._open(can_ids, errors=False, buffer_bytes=SERVICE_BUFFER_BYTES)

    def repeat(self, can_id: int, data: bytes, period_s: float) -> "_Repeated":
        """Lets the kernel's broadcast manager send a frame every period_s: no thread of ours keeps that time."""
        return _Repeated(self._name, can_id, data, period_s)

    def state(self) -> str:
        """The controller's state as the kernel knows it; a vcan has none that could be anything but active."""
        return state_of(self._name)[0]

    def counters(self) -> ErrorCounters | None:
        """Error counters as the driver tells them; a vcan has none."""
        return state_of(self._name)[1]

    def close(self) -> None:
        """Closes every channel opened here."""
        for channel in self._channels:
            channel.close()
        self._channels.clear()

    def _open(self, can_ids: tuple[int, ...], *, errors: bool, buffer_bytes: int) -> "_Channel":
        sock = _bound(self._name, can_ids, errors=errors, buffer_bytes=buffer_bytes)
        channel = _Channel(self._name, sock, fd=_takes_fd(self._name, sock))
        self._channels.append(channel)
        return channel


class _Repeated:
    """A job of the kernel's broadcast manager (CAN_BCM), which ends with its socket."""

    def __init__(self, name: str, can_id: int, data: bytes, period_s: float) -> None:
        seconds, rest = divmod(round(period_s * 1e6), 1_000_000)
        head = _BCM_HEAD.pack(_TX_SETUP, _SETTIMER | _STARTTIMER, 0, 0, 0, seconds, rest, can_id, 1)
        try:
            self._sock = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_BCM)
            self._sock.connect((name,))
            self._sock.send(head + _FRAME.pack(can_id, len(data), data))
        except OSError as error:
            raise BusFault(_errors.socket_error(name, error.errno or 0)) from None

    def close(self) -> None:
        """Ends it; twice is harmless."""
        self._sock.close()


class _Channel:
    """One raw socket. The same socket works again after the link was down and came up."""

    def __init__(self, name: str, sock: socket.socket, *, fd: bool = False) -> None:
        self._name = name
        self._sock = sock
        self._receiver = Receiver(sock, fd=fd)
        self._readable = select.poll()
        self._readable.register(sock, select.POLLIN)

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one frame; while the queue is full, tries again for up to SEND_DEADLINE_S."""
        if len(data) > 8:
            raise ValueError(f"a classic frame holds 8 bytes, not {len(data)}")
        self._send(_FRAME.pack(can_id, len(data), data))

    def _send(self, frame: bytes) -> None:
        self._check_open()
        deadline_s = time.monotonic() + SEND_DEADLINE_S
        while True:
            try:
                self._sock.send(frame)
            except OSError as error:
                if error.errno not in (errno.ENOBUFS, errno.EAGAIN) or time.monotonic() > deadline_s:
                    raise BusFault(_errors.socket_error(self._name, error.errno or 0)) from None
                time.sleep(0.001)  # poll() calls the socket writable although the queue behind it is full
            else:
                return

    def send_many(self, frames: Frames) -> None:
        """Sends the frames one after the other, now; their times are not kept."""
        for can_id, length, data in zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True):
            if length <= 8:
                self.send(can_id, data[:length].tobytes())
            else:
                whole = next(n for n in _FD_LENGTHS if n >= length)
                self._send(_FD_FRAME.pack(can_id, whole, _BIT_RATE_SWITCH, data[:length].tobytes()))

    def receive(self, timeout_s: float) -> Frames:
        """All frames waiting, in order, with the kernel's time; waits up to `timeout_s` for the first."""
        self._check_open()
        try:
            if timeout_s > 0:
                self._readable.poll(timeout_s * 1000)
            frames = self._receiver.take()
            parts = [frames]
            while len(parts[-1]) == self._receiver.batch and len(parts) < MOST_BATCHES:
                parts.append(self._receiver.take())
        except OSError as error:
            raise BusFault(_errors.socket_error(self._name, error.errno or 0)) from None
        return frames if len(parts) == 1 else Frames.join(parts)

    def drops(self) -> int:
        """Frames the kernel dropped on this socket since it was opened (SO_MEMINFO, SK_MEMINFO_DROPS)."""
        self._check_open()
        return int(struct.unpack("=9I", self._sock.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 36))[8])

    def close(self) -> None:
        """Closes the socket; twice is harmless."""
        self._sock.close()

    def _check_open(self) -> None:
        if self._sock.fileno() < 0:
            raise BusFault("channel-closed", bus=self._name)


def _bound(name: str, can_ids: tuple[int, ...], *, errors: bool, buffer_bytes: int) -> socket.socket:
    """A raw socket on the interface with its filters and buffer set before the first frame can come."""
    try:
        sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        raise ConfigError("kernel-without-can", why=system_reason(error)) from None
    try:
        sock.settimeout(0)
        sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, _filters(can_ids))
        sock.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, struct.pack("=I", _ALL_ERRORS if errors else 0))
        _enlarge(sock, buffer_bytes)
        sock.bind((name,))
    except OSError as error:
        sock.close()
        known = tuple(n for _, n in socket.if_nameindex() if "can" in n)
        raise ConfigError("interface-not-opened", bus=name, why=system_reason(error), known=known) from None
    return sock


def _takes_fd(name: str, sock: socket.socket) -> bool:
    """Whether the link carries FD frames; if so, the socket receives and sends them from now on."""
    try:
        if _netlink.query_link(name).mtu != _FD_MTU:
            return False
        sock.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_FD_FRAMES, 1)
    except OSError:
        return False
    return True


def _filters(can_ids: tuple[int, ...]) -> bytes:
    """struct can_filter for each id: data and remote frames of exactly this id and format; no ids: everything."""
    if not can_ids:
        return struct.pack("=II", 0, 0)
    whole = EXTENDED | 0x1FFF_FFFF
    return b"".join(struct.pack("=II", can_id & whole, whole) for can_id in can_ids)


def _enlarge(sock: socket.socket, size: int) -> None:
    """Sets the receive buffer: past the system's limit where this process may, else up to the limit."""
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, size)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
