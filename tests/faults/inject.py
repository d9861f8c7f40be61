"""Puts one fault into a simulated run: the text in the table's `inject` column is all that says how.

device KIND[:key=value,…]     the unit SN0001 has a fault of station/adapters/simulated_device/device_fault.py
wire KIND[:after_s=S,seconds=S]         the bus of station/adapters/bus/_wire.py between station and devices
gold KIND[:…] | gold due=DATE           the truth comes from a gold reference at node 5, with that fault or due date
bus KIND at S s               an error frame of the CAN driver after S simulated seconds
positioner KEY=VALUE,…        the simulated positioner's options in config.yaml
recipe KEY=JSON               a block of the recipe is another one
log full|read-only|locked at stop N     the log's file refuses from that stop on
log garbage|newer|nowhere|in use        the log's file as the station finds it
clock steps back S s at stop N          the computer's clock
seats swapped                 two units sit in each other's nest
stop at PHASE                 the operator asks for a stop there
"""

import json
import re
import sqlite3
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from station.adapters.store.sqlite import SqliteStore
from station.domain.core.types import NestAssignment
from station.domain.run.progress import Event, LiveReading, PhaseEntered, VisitStarted
from station.files.owner import OwnerLock
from station.messages import Message
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench
from tests.fakes import fixture_run
from tests.fakes.bus_trouble import troubled
from tests.fakes.fixture_run import Ran

#: The clock of the record in the row about a stepping clock and of the lock's owner.
_STARTED_NS = 1_767_225_600_000_000_000


@dataclass
class Injected:
    """Arguments of a run, and what must be let go of after it."""

    units: int = 1
    order: dict[str, Any] = field(default_factory=dict)
    opened: ExitStack = field(default_factory=ExitStack)

    def run(self, folder: Path) -> Ran:
        """The run with its fault. Errors: those of opening a station."""
        with self.opened:
            return fixture_run.run(folder, units=self.units, **self.order)


def injected(text: str, folder: Path) -> Injected:
    """The fault that `text` describes, for a run in `folder`."""
    where, _, how = text.partition(" ")
    made = Injected()
    _WHERE[where](made, how, folder)
    return made


def _device(made: Injected, how: str, _folder: Path) -> None:
    made.order["faults"] = tuple(f"SN0001/{one}" for one in how.split(" and "))


def _wire(made: Injected, how: str, _folder: Path) -> None:
    made.order["faults"] = (f"BUS/{how}",)


def _gold(made: Injected, how: str, folder: Path) -> None:
    due = how.removeprefix("due=") if how.startswith("due=") else "2099-01-31"
    if not how.startswith("due="):
        made.order["faults"] = (f"GOLD/{how}",)
    gold = {"serial": "G1", "due": due, "node": 5, "seat_std_deg": 0.01}
    reference = {"source": "gold", "magnitude": 1.0, "gold": gold}
    made.order["recipe"] = fixture_run.recipe(folder, reference=reference)


def _bus(made: Injected, how: str, _folder: Path) -> None:
    kind, at_s = _match(r"(\S+) at ([\d.]+) s", how)
    made.order["wrap"] = troubled((float(at_s), kind))


def _positioner(made: Injected, how: str, folder: Path) -> None:
    options = dict(part.split("=") for part in how.split(","))
    made.order["config"] = fixture_run.config(folder, positioner={"kind": "simulated", **options})


def _recipe(made: Injected, how: str, folder: Path) -> None:
    key, value = _match(r"(\w+)=(.*)", how)
    made.order["recipe"] = fixture_run.recipe(folder, **{key: json.loads(value)})


def _log(made: Injected, how: str, folder: Path) -> None:
    path = folder / "station.db"
    if how == "garbage":
        path.write_bytes(b"not a database, whatever its name says" * 200)
    elif how == "newer":
        SqliteStore(path).close()
        with sqlite3.connect(path) as db:
            db.execute("UPDATE meta SET value = 'station.log/99' WHERE key = 'schema'")
        db.close()
    elif how == "nowhere":
        made.order["database"] = folder / "no such folder" / "station.db"
    elif how == "in use":
        owned = Message("owned-log", path=str(path))
        made.opened.callback(OwnerLock(folder / "station.db.lock", owned, "bench-7", _STARTED_NS).release)
    else:
        trouble, number = _match(r"(\S+) at stop (\d+)", how)
        made.order["hook"] = _at_stop(int(number), lambda bench: _STORE[trouble](made, bench, path))


def _full(_made: Injected, bench: Bench, _path: Path) -> None:
    db = bench.station.store._db  # type: ignore[attr-defined]
    (pages,) = db.execute("PRAGMA page_count").fetchone()
    db.execute(f"PRAGMA max_page_count = {pages}")


def _read_only(_made: Injected, bench: Bench, _path: Path) -> None:
    bench.station.store._db.execute("PRAGMA query_only = ON")  # type: ignore[attr-defined]


def _locked(made: Injected, bench: Bench, path: Path) -> None:
    bench.station.store._db.execute("PRAGMA busy_timeout = 20")  # type: ignore[attr-defined]
    other = sqlite3.connect(path, isolation_level=None)
    made.opened.callback(other.close)
    other.execute("BEGIN IMMEDIATE")


def _clock(made: Injected, how: str, _folder: Path) -> None:
    by_s, number = _match(r"steps back (\d+) s at stop (\d+)", how)
    waiting = [int(number)]

    def hook(event: Event, _stop: StopRequest, bench: Bench) -> None:
        if isinstance(event, VisitStarted) and event.number == int(number) and event.total > event.number:
            waiting.append(0)
        if isinstance(event, LiveReading) and len(waiting) == 2:
            waiting.append(0)
            bench.station.clock._start_ns -= int(by_s) * 10**9  # type: ignore[attr-defined]

    made.order["hook"] = hook


def _seats(made: Injected, how: str, _folder: Path) -> None:
    _match("swapped", how)
    made.units = 2
    made.order["wrap"] = lambda bench: replace(bench, fixture=_Swapped(bench.fixture))


class _Swapped:
    """Puts each unit into the next one's nest."""

    def __init__(self, fixture: Any) -> None:
        self._fixture = fixture

    def place(self, seats: Sequence[NestAssignment]) -> None:
        """Places them, each label with another unit."""
        units = [seat.serial for seat in seats]
        moved = [replace(s, serial=unit) for s, unit in zip(seats, units[1:] + units[:1], strict=True)]
        self._fixture.place(moved)


def _stop(made: Injected, how: str, _folder: Path) -> None:
    (phase,) = _match(r"at (\w+)", how)

    def hook(event: Event, stop: StopRequest, _bench: Bench) -> None:
        if isinstance(event, PhaseEntered) and event.phase == phase:
            stop.request()

    made.order["hook"] = hook


def _at_stop(number: int, deed: Callable[[Bench], None]) -> Callable[[Event, StopRequest, Bench], None]:
    def hook(event: Event, _stop: StopRequest, bench: Bench) -> None:
        if isinstance(event, VisitStarted) and event.number == number and event.total > number:
            deed(bench)

    return hook


def _match(pattern: str, how: str) -> tuple[str, ...]:
    found = re.fullmatch(pattern, how)
    if found is None:
        raise ValueError(f"{how!r} does not match {pattern}")
    return found.groups()


_STORE = {"full": _full, "read-only": _read_only, "locked": _locked}
_WHERE: dict[str, Callable[[Injected, str, Path], None]] = {
    "device": _device,
    "wire": _wire,
    "gold": _gold,
    "bus": _bus,
    "positioner": _positioner,
    "recipe": _recipe,
    "log": _log,
    "clock": _clock,
    "seats": _seats,
    "stop": _stop,
}
