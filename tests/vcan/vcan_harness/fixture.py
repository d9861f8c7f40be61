"""`station run` on a real interface inside the test's process: a small recipe, and somebody who turns the fixture."""

import json
import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

import numpy as np
import yaml
from vcan_harness.interface import Interface

from station.adapters.store.reader import SqliteLogReader
from station.config.search_path import shipped_folder
from station.domain.core.types import Floats, Frames
from station.domain.run.progress import Event, LoadDone, UnitResult, VisitStarted
from station.errors import StationError
from station.ports.log_reader import Attempt, Query
from station.service.itinerary import tumble_visits, verification_visits
from station.service.runner import Runner
from station.wiring.bench import Bench, open_bench
from station.wiring.live_device import LiveDevices, Population
from station.wiring.run_order import RunOrder

#: Small enough for a guest that does everything ten times slower, large enough for a verdict. A guest that stands
#: still for a moment spoils a stop, so stops may be repeated more often than on a bench.
RATE_HZ = 40
SMALL: Mapping[str, Any] = {
    "device": {"rate_hz": RATE_HZ, "lsb": 6.25e-5, "full_scale": 2.0, "noise_density": 0.0001, "counter_bits": 4},
    "settle": {"time_s": 0.1},
    "dwell": {"time_s": 0.6},
    "visit_repeats": 4,
}
#: A drive that is there in a tenth of a second, where the hand that turns it is not what is tested.
DRIVEN: Mapping[str, Any] = {"kind": "simulated", "speed_deg_s": 3600, "acceleration_deg_s2": 36000}
Turn = Callable[[Floats], None]
Hook = Callable[[Event, Bench], None]


@cache
def _six_point() -> dict[str, Any]:
    """The shipped recipe; YAML takes a guest a second to read."""
    return dict(yaml.safe_load((shipped_folder() / "recipes" / "six-point.yaml").read_text()))


def recipe(folder: Path, **changes: Any) -> str:
    """The shipped six-point recipe with short stops, as a file in `folder`."""
    path = folder / "small.yaml"
    path.write_text(json.dumps({**_six_point(), **SMALL, **changes}))
    return str(path)


def config(folder: Path, interface: Interface, nodes: Sequence[int], **changes: Any) -> Path:
    """A station with one nest for each node, turned by hand unless `positioner` says otherwise."""
    nests = [{"name": chr(ord("A") + i), "node": node} for i, node in enumerate(nodes)]
    bus = {"interface": "socketcan", "channel": interface.name, **changes.pop("bus", {})}
    base = {"schema": "station.config/1", "bus": bus, "nests": nests, "positioner": {"kind": "manual"}}
    path = folder / "config.yaml"
    path.write_text(json.dumps({**base, **changes}))
    return path


class Served:
    """Our simulated devices in a process of their own; a fork, because Python takes seconds to start in a guest.

    bodies: serial → true errors.
    """

    def __init__(self, interface: Interface, nodes: Sequence[int], serials: Sequence[str], **options: Any) -> None:
        wanted = Population("accelerometer", interface.name, tuple(nodes), tuple(serials), rate_hz=RATE_HZ, **options)
        theirs, self._orders = multiprocessing.Pipe(duplex=False)
        devices = LiveDevices.open(wanted)  # listening before this returns
        self.bodies = devices.bodies
        self._process = multiprocessing.get_context("fork").Process(target=_live, args=(devices, theirs), daemon=True)
        self._process.start()
        devices.live(lambda: False)  # this process leaves the bus to the other
        theirs.close()

    def turn(self, true: Floats) -> None:
        """Turns them: the vector that each feels, in its own frame."""
        self._orders.send("true " + " ".join(f"{float(v):.9f}" for v in true))

    def close(self) -> None:
        """Power off."""
        self._process.kill()
        self._process.join()
        self._process.close()
        self._orders.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _live(devices: LiveDevices, orders: Connection) -> None:
    def obey() -> bool:
        while orders.poll():
            devices.world.obey(orders.recv())
        return True

    devices.live(obey)


@dataclass(slots=True)
class Ran:
    """What a fixture load came to."""

    results: dict[str, UnitResult] = field(default_factory=dict)
    fault: StationError | None = None
    events: list[Event] = field(default_factory=list)


def run(bench: Bench, serials: Sequence[str], turn: Turn, hook: Hook = lambda _event, _bench: None) -> Ran:
    """One fixture load; `turn` does what the station asks the operator to, `hook` sees every event after that."""
    todo = _true_of_stops(bench)
    ran = Ran()
    (seats,) = bench.loads(serials)
    with closing(Runner(bench.station, bench.job).run(seats)) as events:
        for event in events:
            ran.events.append(event)
            if isinstance(event, VisitStarted):
                turn(todo[event.position])
            if isinstance(event, LoadDone):
                ran.results, ran.fault = {r.seat.serial: r for r in event.results}, event.fault
            hook(event, bench)
    return ran


def opened(folder: Path, interface: Interface, nodes: Sequence[int], **changes: Any) -> Bench:
    """A station of one configuration, its log in `folder`; recipe: what to change in the recipe."""
    shown = changes.pop("recipe", {})
    return open_bench(
        RunOrder(
            recipe=recipe(folder, **shown),
            config=config(folder, interface, nodes, **changes),
            database=folder / "station.db",
        )
    )


@dataclass(frozen=True, slots=True)
class Stored:
    """One visit as the log holds it."""

    kind: str
    position: str
    from_ns: int
    to_ns: int
    statistics: Mapping[str, Any]
    frames: Frames


def visits(folder: Path, serial: str) -> list[Stored]:
    """The visits of the last attempt of a serial, with their raw frames."""
    with SqliteLogReader(folder / "station.db") as log:
        attempt = newest(log, serial)
        shown = log.attempt(attempt)["visits"]
        return [
            Stored(v["kind"], v["position"], v["statistics"]["from_ns"], v["statistics"]["to_ns"], v["statistics"], f)
            for v, f in zip(shown, log.frames(attempt), strict=True)
        ]


def newest(log: SqliteLogReader, serial: str) -> Attempt:
    """The last attempt of a serial."""
    return log.attempts(Query(serial=serial), limit=1)[0]


def life(folder: Path, serial: str) -> list[dict[str, Any]]:
    """Every attempt of a serial, oldest first."""
    with SqliteLogReader(folder / "station.db") as log:
        return log.life(Query(serial=serial))


def rows(frames: Frames) -> list[tuple[int, int, bytes]]:
    """Frames as candump logs them: (time in whole µs, identifier with flags, payload)."""
    columns = zip(frames.time_ns.tolist(), frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True)
    return [(time_ns // 1000, can_id, data[:length].tobytes()) for time_ns, can_id, length, data in columns]


def _true_of_stops(bench: Bench) -> dict[str, Floats]:
    recipe_ = bench.job.recipe
    runs = [stop for number in range(len(recipe_.runs)) for stop in tumble_visits(recipe_, number)]
    return {stop.position: np.asarray(stop.true) for stop in [*runs, *verification_visits(recipe_)]}
