"""What the kernel knows of a CAN interface: up or down, its kind, its controller's state. Asked over rtnetlink."""

import os
import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from station.ports.bus import ErrorCounters

_RTM_GETLINK, _NLMSG_ERROR, _NLM_F_REQUEST = 18, 2, 1
_IFLA_LINKINFO, _IFLA_INFO_KIND, _IFLA_INFO_DATA, _IFLA_CAN_STATE, _IFLA_CAN_BERR_COUNTER = 18, 1, 2, 4, 8
_IFLA_MTU, _IFLA_TXQLEN, _IFLA_CAN_BITTIMING = 4, 13, 1
_IFF_UP = 1
#: enum can_state of <linux/can/netlink.h>.
STATES = ("active", "warning", "passive", "bus-off", "stopped", "sleeping")


@dataclass(frozen=True, slots=True)
class Link:
    """A network interface: whether it is set up, its kind (can, vcan, …), and what only a controller has: its state,
    error counters and bit rate; frames that its transmit queue holds; mtu: 16, or 72 where it takes FD frames."""

    up: bool
    kind: str
    can_state: str | None
    counters: ErrorCounters | None = None
    bitrate: int | None = None
    queue: int | None = None
    mtu: int | None = None


def query_link(name: str) -> Link:
    """State of an interface; OSError when it does not exist."""
    index = socket.if_nametoindex(name)
    request = struct.pack("=IHHII BxHiII", 32, _RTM_GETLINK, _NLM_F_REQUEST, 1, 0, socket.AF_UNSPEC, 0, index, 0, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as sock:
        sock.settimeout(1.0)
        sock.send(request)
        return parse_link(sock.recv(1 << 16))


def parse_link(answer: bytes) -> Link:
    """The kernel's RTM_NEWLINK message as a Link; OSError when it is an error message."""
    kind_of_message = struct.unpack_from("=H", answer, 4)[0]
    if kind_of_message == _NLMSG_ERROR:
        number = -struct.unpack_from("=i", answer, 16)[0]
        raise OSError(number, os.strerror(number))
    size = struct.unpack_from("=I", answer)[0]
    flags = struct.unpack_from("=I", answer, 24)[0]
    about = dict(_attributes(answer[32:size]))
    info = dict(_attributes(about.get(_IFLA_LINKINFO, b"")))
    data = dict(_attributes(info.get(_IFLA_INFO_DATA, b"")))
    state, counted = data.get(_IFLA_CAN_STATE), data.get(_IFLA_CAN_BERR_COUNTER)
    timing, queue = data.get(_IFLA_CAN_BITTIMING), about.get(_IFLA_TXQLEN)
    code = None if state is None else struct.unpack("=I", state[:4])[0]
    return Link(
        up=bool(flags & _IFF_UP),
        kind=info.get(_IFLA_INFO_KIND, b"").rstrip(b"\0").decode(),
        can_state=None if code is None else STATES[code] if code < len(STATES) else "unknown",
        # struct can_berr_counter: txerr, rxerr.
        counters=None if counted is None else ErrorCounters(*struct.unpack("=HH", counted[:4])),
        # struct can_bittiming begins with the bit rate; a controller that was never set up says 0.
        bitrate=(struct.unpack("=I", timing[:4])[0] or None) if timing else None,
        queue=struct.unpack("=I", queue)[0] if queue else None,
        mtu=struct.unpack("=I", mtu)[0] if (mtu := about.get(_IFLA_MTU)) else None,
    )


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    """(type, payload) of each rtattr; the two flag bits of the type are cut off."""
    at = 0
    while at + 4 <= len(data):
        size, kind = struct.unpack_from("=HH", data, at)
        if size < 4:
            return
        yield kind & 0x3FFF, data[at + 4 : at + size]
        at += (size + 3) & ~3
