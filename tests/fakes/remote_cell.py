"""A cell at a simulated remote I/O, with the real hand-over on a log that never lies; the station may be killed."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from station.adapters.cell.remote_io import RemoteIoCell
from station.adapters.clock import VirtualClock
from station.adapters.simulated_plc import MemoryRegisters, SimulatedRemoteIo
from station.domain.cell.handover import Place
from station.domain.cell.packml import State
from station.ports.registers import Table
from station.service.handover import Handover
from station.wiring.rig_machines import wiring_of
from tests.fakes.crashing_cell import Chance, Crash, DurableLog

OUTCOMES = ("PASS", "FAIL", "ERROR", "PASS")
SETTINGS = RemoteIoCell.Settings(host="simulated")


class KillableIo(MemoryRegisters):
    """The station is gone in front of, or right behind, its n-th request."""

    def __init__(self, device: SimulatedRemoteIo, clock: VirtualClock, at: int) -> None:
        super().__init__(device, clock)
        self._time, self._at, self.calls = clock, at, 0

    def read(self, table: Table, address: int, count: int) -> list[int]:
        self._call()
        return super().read(table, address, count)

    def write(self, address: int, words: list[int]) -> None:
        self._call()
        super().write(address, words)
        self._call()

    def _call(self) -> None:
        self._time.sleep(0.005)
        self.calls += 1
        if self.calls == self._at:
            raise Crash


@dataclass
class RemoteBench:
    """A cell at a remote I/O, a hand-over on a log that never lies, and the people at its nests."""

    folder: Path
    fault: str = ""
    loads: Iterator[Sequence[str]] = field(default_factory=lambda: iter([("SN1", "SN2", "SN3", "SN4")]))
    clock: VirtualClock = field(default_factory=VirtualClock)

    def __post_init__(self) -> None:
        self.io = SimulatedRemoteIo(wiring_of(SETTINGS, 4), self.loads, self.fault, change_s=0.2)
        self.log = DurableLog(Chance(random.Random(1), 1e12))
        self.held = 0

    def station(self, killed_at: int = 0) -> Handover:
        """A process that has just started."""
        self.log.close_unfinished()
        given = SETTINGS.model_copy(update={"memory": str(self.folder / "memory.json")})
        self.registers = KillableIo(self.io, self.clock, killed_at)
        self.cell = RemoteIoCell(given, self.clock, self.registers)
        self.cell.show(State.EXECUTE, frozenset({"green"}))

        def identify(present: frozenset[int]) -> list[Place]:
            return [Place(i, "ABCD"[i], self.io.nests[i]) for i in sorted(present)]

        def test(places: Sequence[Place]) -> None:
            running = [(p, self.log.begin(self.io.load, p)) for p in places]
            self.clock.sleep(1.0)
            for place, attempt in running:
                self.log.finish(attempt, OUTCOMES[int(place.serial.removeprefix("SN")) - 1])

        return Handover(self.cell, self.log, identify, test)

    def go(self, station: Handover, seconds: float) -> None:
        """So long, or until it is killed."""
        until_s = self.clock.monotonic_s() + seconds
        while self.clock.monotonic_s() < until_s:
            station.step()
            self.clock.sleep(0.05)

    def left(self) -> dict[str, bool]:
        """Units that left their nests; whether somebody had acknowledged the rejects before."""
        return {taken.serial: taken.acknowledged for taken in self.io.taken}


#: What is to become of the four units: whether somebody had taken note of the rejects when they left.
RIGHT = {"SN1": False, "SN4": False, "SN2": True, "SN3": True}


def requests_of_a_load(folder: Path) -> int:
    """How many there are to be killed at."""
    folder.mkdir()
    bench = RemoteBench(folder)
    bench.go(bench.station(), 8.0)
    return bench.registers.calls


def killed_load(folder: Path, at: int) -> str:
    """What is wrong after a SIGKILL at that request of a load; empty where nothing is."""
    folder.mkdir()
    bench = RemoteBench(folder)
    try:
        bench.go(bench.station(at), 20.0)
        return f"request {at} was never made"
    except Crash:
        bench.clock.sleep(1.0)
    bench.go(bench.station(), 8.0)
    if bench.left() != RIGHT:
        return f"request {at}: units left as {bench.left()}"
    decided = sorted(a.serial for a in bench.log.attempts if a.outcome != "INTERRUPTED")
    return "" if decided == sorted(RIGHT) else f"request {at}: tested {decided}"
