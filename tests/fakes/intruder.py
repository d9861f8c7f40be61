"""Somebody else at the bench, at a chosen instant of a simulated run: writes, switches, resets, or swaps the unit."""

import contextlib
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import Any

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.store.sqlite import SqliteStore
from station.domain.core.types import NestAssignment
from station.ports.bus import Bus
from station.wiring.bench import Bench
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran

SERIAL, OTHER = "SN0001", "SN0099"
#: Every call of these is an instant at which somebody may come.
INSTANTS: tuple[tuple[type, tuple[str, ...]], ...] = (
    (CanopenDevice, ("upload", "download", "nmt", "wait_boot_up", "emergencies")),
    (SqliteStore, ("event", "visit", "write", "result")),
)
Deed = Callable[[Bench, NestAssignment], None]


def send(bench: Bench, can_id: int, data: bytes) -> None:
    """One frame of another node on the same bus."""
    bus: Bus = bench.station.bus
    channel = bus.service((0x7E5,))
    channel.send(can_id, data)
    channel.close()


def write(index: int, sub: int, raw: bytes) -> Deed:
    """An expedited SDO write by another master."""
    command = 0x23 | (4 - len(raw)) << 2
    data = bytes([command, *index.to_bytes(2, "little"), sub]) + raw.ljust(4, b"\0")
    return lambda bench, seat: send(bench, 0x600 + seat.node, data)


def nmt(command: int, *, everybody: bool = False) -> Deed:
    """An NMT command by another master."""
    return lambda bench, seat: send(bench, 0x000, bytes([command, 0 if everybody else seat.node]))


def swap(bench: Bench, seat: NestAssignment) -> None:
    """Another unit into the same nest."""
    bench.fixture.place([NestAssignment(OTHER, seat.nest, seat.node)])


ACTIONS: dict[str, Deed] = {
    "writes a coefficient": write(0x2101, 5, b"\x00\x00\xc0\x3f"),
    "writes the valid flag": write(0x2107, 0, b"\x00"),
    "resets the device": nmt(129),
    "stops all devices": nmt(2, everybody=True),
    "swaps the unit": swap,
}


class Intruder:
    """Does the deed before call number `at`, if no verdict is in the record by then; calls: how many there were."""

    def __init__(self, deed: Deed, at: int) -> None:
        self._deed, self._at = deed, at
        self.calls, self.over, self.came = 0, False, False

    def run(self, folder: Path, **order: Any) -> Ran:
        """A run of one unit that he disturbs; order: what is special about it."""
        with self._patched():
            return fixture_run.run(folder, [SERIAL], wrap=self._enter, **order)

    def _enter(self, bench: Bench) -> Bench:
        self._bench = bench
        ((self._seat,),) = bench.loads([SERIAL])
        return bench

    def _instant(self) -> None:
        if self.calls == self._at and not self.over and not self.came:
            self.came = True
            self._deed(self._bench, self._seat)
        self.calls += not self.over

    @contextlib.contextmanager
    def _patched(self) -> Iterator[None]:
        before = [(owner, name, getattr(owner, name)) for owner, names in INSTANTS for name in names]
        for owner, name, call in before:
            setattr(owner, name, self._counted(call, name))
        try:
            yield
        finally:
            for owner, name, call in before:
                setattr(owner, name, call)

    def _counted(self, call: Callable[..., Any], name: str) -> Callable[..., Any]:
        @wraps(call)
        def counted(*args: Any, **kwargs: Any) -> Any:
            self.over = self.over or (name == "result" and args[2] == "verdict")
            self._instant()
            return call(*args, **kwargs)

        return counted
