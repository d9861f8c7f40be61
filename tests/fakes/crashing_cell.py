"""Crashes of station and PLC at random instants: the real hand-over and the real PLC program, a log that never lies.

A crash of the station is an exception at a random call of a port, before or after it took effect; what was in memory is
gone, and a new station begins with the log alone. A crash of the PLC empties its working memory.
"""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from station.adapters.cell.plc import PlcCell
from station.adapters.clock import VirtualClock
from station.adapters.modbus import PlcLink
from station.adapters.simulated_plc import CellLoads, MemoryRegisters, SimulatedPlc
from station.domain.cell.handover import MOST_INTERRUPTED, Bin, Entry, Hold, Place
from station.domain.cell.register_map import RegisterMap
from station.errors import PlcFault
from station.ports.registers import Table
from station.service.handover import Handover

NESTS = ("A", "B", "C", "D")
OUTCOMES = ("PASS", "PASS", "PASS", "FAIL", "ERROR")


class Crash(BaseException):
    """The station's process is gone."""


@dataclass(slots=True)
class Attempt:
    """One attempt in the log; load: which presentation of the unit it belongs to, for the judge alone."""

    number: int
    load: int
    serial: str
    nest: str
    outcome: str | None = None


@dataclass(slots=True)
class Chance:
    """Where the station and the PLC die. between: mean number of calls from one crash to the next."""

    rng: random.Random
    between: float
    crashes: int = 0
    restarts: int = 0

    def strikes(self) -> bool:
        """Whether the station dies here."""
        if self.rng.random() < 1 / self.between:
            self.crashes += 1
            return True
        return False


@dataclass(slots=True)
class DurableLog:
    """Implements the journal. What is appended stays."""

    chance: Chance
    lines: list[Entry] = field(default_factory=list)
    attempts: list[Attempt] = field(default_factory=list)
    number: int = 0

    def entries(self) -> Sequence[Entry]:
        """Every line of late."""
        return self.lines[-8:]

    def add(self, entry: Entry) -> None:
        """Appends, and may die before or after it."""
        self._maybe()
        self.number += 1
        self.lines.append(replace(entry, number=self.number))
        self._maybe()

    def outcomes(self, serial: str, nest: str, beyond: int) -> list[str]:
        """Finished ones of that unit in that nest."""
        return [
            a.outcome
            for a in self.attempts[-40:]
            if (a.serial, a.nest) == (serial, nest) and a.number > beyond and a.outcome
        ]

    def begin(self, load: int, place: Place) -> Attempt:
        """An attempt begins."""
        self._maybe()
        self.number += 1
        self.attempts.append(Attempt(self.number, load, place.serial, place.nest))
        self._maybe()
        return self.attempts[-1]

    def finish(self, attempt: Attempt, outcome: str) -> None:
        """An attempt ends."""
        self._maybe()
        attempt.outcome = outcome
        self._maybe()

    def close_unfinished(self) -> None:
        """What a start-up does with attempts that never ended."""
        for attempt in self.attempts[-8:]:
            if attempt.outcome is None:
                attempt.outcome = "INTERRUPTED"

    def _maybe(self) -> None:
        if self.chance.strikes():
            raise Crash


class CrashingRegisters(MemoryRegisters):
    """The PLC's registers; the station may die before or after each request, and the PLC restart."""

    def __init__(self, plc: SimulatedPlc, clock: VirtualClock, chance: Chance) -> None:
        super().__init__(plc, clock)
        self._plc, self._chance, self._time = plc, chance, clock

    def read(self, table: Table, address: int, count: int) -> list[int]:
        """As the PLC answers."""
        self._maybe()
        return super().read(table, address, count)

    def write(self, address: int, words: list[int]) -> None:
        """As the PLC takes it."""
        self._maybe()
        super().write(address, words)
        self._maybe()

    def _maybe(self) -> None:
        self._time.sleep(0.005)
        if self._chance.rng.random() < 0.3 / self._chance.between:
            self._chance.restarts += 1
            self._plc.restart(self._time.monotonic_s())
        if self._chance.strikes():
            raise Crash


@dataclass(frozen=True, slots=True)
class Judged:
    """What went wrong, in units: nothing may."""

    crashes: int
    restarts: int
    units: int
    twice: int
    skipped: int
    lost: int
    wrong: int
    held: int

    @property
    def faults(self) -> int:
        """All of it."""
        return self.twice + self.skipped + self.lost + self.wrong + self.held


def endure(crashes: int, seed: int, between: float = 12.0) -> Judged:
    """Loads until so many crashes of station and PLC have happened."""
    rng = random.Random(seed)
    chance, clock = Chance(rng, between), VirtualClock()
    log, loads = DurableLog(chance), CellLoads(_coming(rng), change_s=0.05)
    brought: dict[int, tuple[str, ...]] = {}
    plc_map = RegisterMap()
    plc = SimulatedPlc(plc_map, loads=loads)
    held = 0
    while chance.crashes + chance.restarts < crashes:
        station = _station(plc, plc_map, clock, log, chance)
        try:
            log.close_unfinished()
            while True:
                try:
                    step = station.step()
                except PlcFault:  # it restarted between a write and its reading back: the same again
                    continue
                brought.setdefault(loads.load, loads.nests)
                held += isinstance(step, Hold)
                clock.sleep(0.02)
                if chance.crashes + chance.restarts >= crashes:
                    break
        except Crash:
            clock.sleep(rng.choice([0.0, 0.1, 3.0]))  # nobody is there for a while
    chance.between = 1e12
    station = _station(plc, plc_map, clock, log, chance)
    log.close_unfinished()
    for _ in range(60):
        station.step()
        clock.sleep(0.02)
    return _judge(loads, log, chance, held)


def _station(plc: SimulatedPlc, plc_map: RegisterMap, clock: VirtualClock, log: DurableLog, chance: Chance) -> Handover:
    """A process that has just started."""
    link = PlcLink(CrashingRegisters(plc, clock, chance), plc_map, clock)
    cell = PlcCell(PlcCell.Settings(host="simulated"), clock, link)
    rng = chance.rng

    def identify(present: frozenset[int]) -> list[Place]:
        assert plc.loads is not None
        return [Place(i, NESTS[i], plc.loads.nests[i]) for i in sorted(present)]

    def test(places: Sequence[Place]) -> None:
        assert plc.loads is not None
        running = [log.begin(plc.loads.load, place) for place in places]
        for attempt in running:
            log.finish(attempt, rng.choice(OUTCOMES))

    return Handover(cell, log, identify, test)


def _coming(rng: random.Random) -> Iterator[tuple[str, ...]]:
    """Loads of one to four units; some units come again, in another nest or the same."""
    number = 0
    while True:
        found: list[str] = []
        for _ in range(4):
            if rng.random() < 0.2 and found:
                found.append("")
            elif rng.random() < 0.15 and number > 8:
                again = f"SN{number - rng.randint(5, 8):05d}"
                found.append("" if again in found else again)
            else:
                number += 1
                found.append(f"SN{number:05d}")
        yield tuple(found)


def _judge(loads: CellLoads, log: DurableLog, chance: Chance, held: int) -> Judged:
    twice = skipped = wrong = 0
    numbers = [h.load for h in loads.handed]
    lost = len(set(range(1, loads.load + 1)) - set(numbers) - {loads.load}) + len(numbers) - len(set(numbers))
    by_unit: dict[tuple[int, str], list[str]] = {}
    for attempt in log.attempts:
        by_unit.setdefault((attempt.load, attempt.serial), []).append(str(attempt.outcome))
    units = 0
    for handed in loads.handed:
        for place, serial in enumerate(handed.serials):
            if not serial:
                continue
            units += 1
            outcomes = by_unit.get((handed.load, serial), [])
            decided = [o for o in outcomes if o not in ("INTERRUPTED", "None")]
            twice += len(decided) > 1
            skipped += not decided and len(outcomes) < MOST_INTERRUPTED
            best = decided[0] if decided else "INTERRUPTED"
            right = {"PASS": Bin.GOOD, "FAIL": Bin.REJECT}.get(best, Bin.AGAIN)
            wrong += handed.bins >> 2 * place & 3 != right
    return Judged(chance.crashes, chance.restarts, units, twice, skipped, lost, wrong, held)
