"""Whole runs on the simulated fixture, for tests: one call, then everything that can be asked about it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from station.adapters.store.reader import SqliteLogReader
from station.config.search_path import shipped_folder
from station.domain.records.stored_attempt import result
from station.domain.run.progress import Event, LoadDone, UnitResult
from station.errors import StationError
from station.messages import Message
from station.ports.log_reader import Query
from station.service.runner import Runner
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench, open_bench
from station.wiring.run_order import RunOrder

Hook = Callable[[Event, StopRequest, Bench], None]


@dataclass(slots=True)
class Ran:
    """What a run came to. folder: where its log and its devices' memory are."""

    folder: Path
    events: list[Event] = field(default_factory=list)
    results: dict[str, UnitResult] = field(default_factory=dict)
    fault: StationError | None = None
    parked: bool = False
    notices: tuple[str, ...] = ()

    def of(self, kind: type[Event]) -> list[Any]:
        """Events of one kind."""
        return [e for e in self.events if isinstance(e, kind)]

    def lives(self, serial: str) -> list[dict[str, Any]]:
        """Every attempt of a serial, as the log tells it."""
        with SqliteLogReader(self.folder / "station.db") as log:
            return log.life(Query(serial=serial))

    def life(self, serial: str) -> dict[str, Any]:
        """The last attempt of a serial."""
        return self.lives(serial)[-1]

    def stored(self, serial: str, name: str) -> Any:
        """The newest result of that name of the last attempt."""
        return result(self.life(serial), name)

    def memory(self, serial: str) -> dict[str, Any]:
        """What the device's flash holds: address → value; nothing saved is {}."""
        path = self.folder / "devices" / f"{serial}.json"
        return json.loads(path.read_text())["objects"] if path.exists() else {}

    def coefficients(self, serial: str) -> list[float]:
        """Matrix row by row and offset in the device's flash; empty where none were saved."""
        held = self.memory(serial)
        wanted = [f"2101:{i:02X}" for i in range(1, 10)] + [f"2102:{i:02X}" for i in range(1, 4)]
        return [held[k] for k in wanted] if all(k in held for k in wanted) else []


def serials(units: int) -> list[str]:
    """SN0001, SN0002, …"""
    return [f"SN{i + 1:04d}" for i in range(units)]


def run(
    folder: Path,
    names: Sequence[str] | None = None,
    *,
    units: int = 1,
    hook: Hook | None = None,
    confirm: Callable[[Message], None] = lambda _: None,
    wrap: Callable[[Bench], Bench] = lambda bench: bench,
    **order: Any,
) -> Ran:
    """Takes units through a simulated run in `folder`; hook sees every event and may ask for a stop."""
    order = {"simulate": True, "database": folder / "station.db", "device_state": folder / "devices", **order}
    ran = Ran(folder)
    stop = StopRequest()
    with open_bench(RunOrder(**order)) as opened:
        bench = wrap(opened)
        ran.notices = bench.notices
        for seats in bench.loads(names or serials(units)):
            bench.fixture.place(seats)
            for event in Runner(bench.station, bench.job, stop, confirm).run(seats):
                ran.events.append(event)
                if hook is not None:
                    hook(event, stop, bench)
                if isinstance(event, LoadDone):
                    ran.fault = ran.fault or event.fault
                    ran.results |= {r.seat.serial: r for r in event.results}
            where = bench.station.positioner.where()
            ran.parked = where is None or bool(abs(where.attitude.trace() - 3.0) < 1e-9)
            if ran.fault is not None:
                break
    return ran


@cache
def _shipped(name: str) -> dict[str, Any]:
    return dict(yaml.safe_load((shipped_folder() / name).read_text()))


def recipe(folder: Path, name: str = "six-point", **changes: Any) -> str:
    """A shipped recipe with top-level blocks changed, as a file in `folder`; a block None is taken out."""
    document = {**_shipped(f"recipes/{name}.yaml"), **changes}
    path = folder / f"{name}-changed.yaml"
    path.write_text(json.dumps({k: v for k, v in document.items() if v is not None}))
    return str(path)


def brief_recipe(folder: Path) -> str:
    """Six-point with a tenth of the samples: as many instants of device and log, in a third of the time."""
    return recipe(folder, settle={"time_s": 0.1}, dwell={"time_s": 0.1})


def config(folder: Path, **changes: Any) -> Path:
    """The shipped config.yaml with blocks changed."""
    document = {**_shipped("config.yaml"), **changes}
    path = folder / "config.yaml"
    path.write_text(json.dumps({k: v for k, v in document.items() if v is not None}))
    return path
