"""Sockets for the receive benchmark: a vcan where the kernel has CAN, else UDP on the loopback as its stand-in.

Both are datagram sockets of the same kernel with the same calls, buffers and time stamps; what differs is the
protocol's own work for a datagram, which the floor pays too.
"""

import os
import platform
import socket
import struct
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from station.adapters.bus._recvmmsg import SO_MEMINFO, SO_RCVBUFFORCE

#: ("vcan", interface) or ("udp", port).
Target = tuple[str, str | int]
FRAME = struct.Struct("=IB3x8s")
CLASSIC_MTU, FD_MTU = 16, 72
#: What the sender's process runs.
_SENDER = """
import sys
sys.path[:0] = {path!r}
import wires
wires.send_paced({targets!r}, {each}, {period_s}, {count}, {frames!r})
"""


@dataclass
class Wire:
    """A receiving socket and where to send so that it hears."""

    sock: socket.socket
    target: Target

    def drops(self) -> int:
        """Datagrams the kernel has dropped on this socket."""
        return int(struct.unpack("=9I", self.sock.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 36))[8])

    def close(self) -> None:
        """Closes the socket and takes the vcan away."""
        self.sock.close()
        if self.target[0] == "vcan":
            subprocess.run(["ip", "link", "delete", str(self.target[1])], check=True)


def medium() -> str:
    """What the frames travel over, for the report."""
    return "vcan" if _has_can() else "UDP on the loopback (stand-in: this kernel has no AF_CAN)"


def machine() -> str:
    """Where it ran."""
    guest = ", user-mode-linux: system calls cost about ten times as much" if is_guest() else ""
    return f"Linux {platform.release()}, Python {platform.python_version()}, {os.cpu_count()} cores{guest}"


def cpu_ns() -> int:
    """CPU time of this process; in the guest, which counts it in ticks of 10 ms, the time of its one processor."""
    return time.perf_counter_ns() if is_guest() else time.process_time_ns()


def open_wire(number: int, *, fd: bool = False) -> Wire:
    """A receiving socket with a large buffer; fd: it carries FD frames too."""
    if _has_can():
        name = f"bench{number}"
        subprocess.run(["ip", "link", "add", "dev", name, "type", "vcan"], check=True)
        subprocess.run(["ip", "link", "set", name, "mtu", str(FD_MTU if fd else CLASSIC_MTU), "up"], check=True)
        sock = _can_socket(name, fd=fd)
        wire = Wire(sock, ("vcan", name))
    else:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(("127.0.0.1", 0))
        wire = Wire(sock, ("udp", sock.getsockname()[1]))
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, 16 << 20)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16 << 20)
    return wire


def open_sender(target: Target, *, fd: bool = False) -> socket.socket:
    """A socket whose datagrams arrive at the wire."""
    if target[0] == "vcan":
        sock = _can_socket(str(target[1]), fd=fd)
    else:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.connect(("127.0.0.1", target[1]))
    return sock


def start_sender(
    wires: list[Wire], frames: bytes, count: int, period_s: float, each: int = 1
) -> "subprocess.Popen[bytes]":
    """A process that sends `count` frames to every wire, `each` at a time, `period_s` apart; frames: 16 B each."""
    path = [str(Path(__file__).parent), *sys.path]
    targets = [w.target for w in wires]
    code = _SENDER.format(path=path, targets=targets, each=each, period_s=period_s, count=count, frames=frames)
    process = subprocess.Popen([sys.executable, "-"], stdin=subprocess.PIPE)
    assert process.stdin is not None
    process.stdin.write(code.encode())
    process.stdin.close()
    return process


def send_paced(targets: list[Target], each: int, period_s: float, count: int, frames: bytes) -> None:
    """Runs in the sender's process; what comes late is made up for."""
    datagrams = [frames[i : i + FRAME.size] for i in range(0, len(frames), FRAME.size)]
    senders = [open_sender(target) for target in targets]
    start_s = time.monotonic()
    for at in range(0, count, each):
        time.sleep(max(0.0, start_s + at / each * period_s - time.monotonic()))
        chosen = [datagrams[i % len(datagrams)] for i in range(at, min(at + each, count))]
        for sender in senders:
            for datagram in chosen:
                sender.send(datagram)


def _can_socket(name: str, *, fd: bool) -> socket.socket:
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    sock.bind((name,))
    if fd:
        sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    return sock


def _has_can() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def is_guest() -> bool:
    """Whether this is the user-mode-linux guest of the vcan tests."""
    return "User Mode Linux" in Path("/proc/cpuinfo").read_text()
