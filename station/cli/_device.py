"""The face of `station device`: its world obeys standard input, its units' truth goes to standard output."""

import os
import select
import sys
import time
from collections.abc import Iterator

from station.cli._output import print_json, print_remark
from station.errors import UsageError
from station.wiring.live_device import LiveDevices, Population, World


def serve_devices(wanted: Population, seconds: float | None) -> int:
    """Serves until the time is over, or Ctrl-C, which is the way to stop it and no failure."""
    devices = LiveDevices.open(wanted)
    bodies = {s: {"offset": b.offset.tolist(), "matrix": b.matrix.tolist()} for s, b in devices.bodies.items()}
    commands = _Commands(devices.world)
    until_s = None if seconds is None else time.monotonic() + seconds

    def go_on() -> bool:
        commands.obey()
        return until_s is None or time.monotonic() < until_s

    try:
        print_json({"schema": "station.device/1", "units": bodies})
        devices.live(go_on)
    except KeyboardInterrupt:
        print_remark("the devices left the bus")
    return 0


def parse_node_id(text: str) -> int:
    """A node id as people write it: 17 or 0x11. Errors: UsageError."""
    try:
        return int(text, 0)
    except ValueError:
        raise UsageError("node-not-id", text=text[:20]) from None


class _Commands:
    """Lines of standard input, taken without ever waiting for them."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._open = True
        self._rest = b""

    def obey(self) -> None:
        """Does what the lines that have come say; a wrong one gets a sentence and changes nothing."""
        for line in self._lines():
            try:
                self._world.obey(line)
            except UsageError as exc:
                print_remark(exc.sentence)

    def _lines(self) -> Iterator[str]:
        while self._open and select.select([sys.stdin], [], [], 0)[0]:
            data = os.read(sys.stdin.fileno(), 4096)
            self._open = bool(data)
            *whole, self._rest = (self._rest + data).split(b"\n")
            yield from (line.decode("utf-8", "replace") for line in whole if line.strip())
