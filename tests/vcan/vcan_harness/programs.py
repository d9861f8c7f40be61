"""can-utils as fixtures use them: started, waited for, stopped."""

import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vcan_harness.command import run
from vcan_harness.interface import Interface
from vcan_harness.waiting import until

_LINE = re.compile(r"\((\d+)\.(\d{6})\) (\S+) ([0-9A-F]{3,8})#(R\d?|[0-9A-F]*)")
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_ANY_FRAME_AND_ERROR = ",0:0,#FFFFFFFF"


@dataclass(frozen=True)
class Logged:
    """One line of a candump log. time_us: microseconds since the epoch; can_id with the kernel's flag bits."""

    time_us: int
    interface: str
    can_id: int
    data: bytes


def parse(text: str) -> list[Logged]:
    """Classic frames of a candump log; a remote frame has no data."""
    found = []
    for line in text.splitlines():
        match = _LINE.fullmatch(line.strip())
        if match is None:
            raise ValueError(f"not a line of a candump log: {line!r}")
        seconds, micros, interface, can_id, data = match.groups()
        number = int(can_id, 16)
        flag = _EXTENDED if len(can_id) == 8 and not number & _ERROR else 0
        if data.startswith("R"):
            flag, data = flag | _REMOTE, ""
        found.append(Logged(int(seconds) * 1_000_000 + int(micros), interface, number | flag, bytes.fromhex(data)))
    return found


class Candump:
    """A running `candump -L`, error frames included; it listens when the constructor returns."""

    def __init__(self, interface: Interface, log: Path, *options: str) -> None:
        self.log = log
        before = interface.listeners()
        with log.open("w") as file:
            self._process = subprocess.Popen(
                ["candump", "-L", *options, interface.name + _ANY_FRAME_AND_ERROR], stdout=file
            )
        until(lambda: interface.listeners() >= before + 2, "candump listens")

    def frames(self) -> list[Logged]:
        """What it has written so far."""
        return parse("".join(line for line in self.log.read_text().splitlines(True) if line.endswith("\n")))

    def wait_for(self, count: int, timeout_s: float = 20.0) -> list[Logged]:
        """Waits until it has written `count` frames; returns all."""
        until(lambda: len(self.frames()) >= count, f"{count} frames in candump's log", timeout_s)
        return self.frames()

    def stop(self) -> list[Logged]:
        """Ends it; what the log holds."""
        self._process.terminate()
        self._process.wait(timeout=10)
        return self.frames()


def canplayer(log: Path, onto: Mapping[str, str], *options: str, timeout_s: float = 60.0) -> None:
    """Plays a log to its end, frames of the interface `key` on the interface `value`, at the recorded pace."""
    routes = [f"{target}={source}" for source, target in onto.items()]
    run("canplayer", "-I", str(log), *options, *routes, timeout_s=timeout_s)


def cansend(interface: Interface, can_id: int, data: bytes) -> None:
    """Sends one frame; an id with the error flag 0x20000000 makes an error frame, which vcan hands to listeners."""
    width = 8 if can_id > 0x7FF else 3
    run("cansend", interface.name, f"{can_id & 0x3FFFFFFF:0{width}X}#{data.hex()}")


def start_cangen(interface: Interface, *options: str) -> subprocess.Popen[str]:
    """A running `cangen`; without options it sends random frames every 200 ms."""
    return subprocess.Popen(["cangen", *options, interface.name], text=True, stderr=subprocess.PIPE)
