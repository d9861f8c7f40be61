"""CAN interfaces of the kernel that the tests run on."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vcan_harness.command import run
from vcan_harness.links import add_link, delete_link

#: One frame counts 16 bytes in a queue; the longest classic frame with 8 bytes of payload has 135 bits on the wire.
_QUEUED_BITS, _WIRE_BITS = 128, 135
#: Bytes of a CAN FD frame (struct canfd_frame): both kinds go through.
_FD_MTU = 72


@dataclass(frozen=True)
class Interface:
    """A vcan (or one end of a vxcan pair) by name."""

    name: str

    def up(self) -> None:
        """Link up."""
        run("ip", "link", "set", self.name, "up")

    def down(self) -> None:
        """Link down: sockets bound to it get ENETDOWN."""
        run("ip", "link", "set", self.name, "down")

    def delete(self) -> None:
        """Takes the interface away, also from under those who use it."""
        delete_link(self.name)

    def details(self) -> dict[str, Any]:
        """What `ip -details -json link show` says."""
        return dict(json.loads(run("ip", "-details", "-json", "link", "show", self.name))[0])

    def listeners(self) -> int:
        """Receive filters that open sockets have on this interface."""
        lists = Path("/proc/net/can").glob("rcvlist_*")
        return sum(line.split()[:1] == [self.name] for file in lists for line in file.read_text().splitlines())


@dataclass(frozen=True)
class Link:
    """Two ends of a bus with a bit rate: the station on `near`, devices on `far`. Each direction is shaped alike."""

    near: Interface
    far: Interface


def create_vcan(name: str) -> Interface:
    """A vcan, up, for classic and FD frames."""
    add_link(name, "vcan", _FD_MTU)
    return Interface(name)


def create_link(near: str, far: str, bitrate: int) -> Link:
    """A vxcan pair in which frames leave at the pace of `bitrate`, every one taken as the longest there is.

    A vcan cannot do it: without the driver's own echo the kernel hands a frame to local sockets before the
    queue sees it.
    """
    run("ip", "link", "add", near, "type", "vxcan", "peer", "name", far)
    rate = f"{round(bitrate / _WIRE_BITS * _QUEUED_BITS)}bit"
    for end in (near, far):
        run("ip", "link", "set", end, "up")
        run("tc", "qdisc", "add", "dev", end, "root", "tbf", "rate", rate, "burst", "32", "limit", "200000")
    return Link(Interface(near), Interface(far))
