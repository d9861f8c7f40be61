"""Kills station, shipper, network, plant and PostgreSQL at random instants, fills their disks and turns the station's
clock, while records are on their way; then asks whether each record arrived, once, in order, and whole.

    python tests/endurance/torture_plant.py [--kills 500] [--stations 2] [--seed 1] [--json]

Everything runs for real: the station's log is written by one process and shipped by another over TCP, through a relay,
to a plant that keeps it in a PostgreSQL of its own. A kill is SIGKILL. A full disk is a limit on the size of files,
which the kernel enforces on the running processes (EFBIG), lifted after a while. The clock of a station that starts
again is up to an hour off. At the end the writers rest, and the plant must have every log, record for record and in
order, with nothing set apart. Each victim is struck in turn, at a random instant.
"""

import argparse
import json
import os
import random
import resource
import signal
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import psycopg
import uvicorn

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.adapters.clock import SystemClock
from station.adapters.store import keys
from station.adapters.store.sqlite import SqliteStore
from station.config.settings import Nest, ReceiverSettings, Settings
from station.domain.records.tables import COLUMNS
from station.errors import StationError
from station.web.plant import Entrances, PlantFace, create_plant_app
from station.wiring.shipping import Shipping, read_statuses
from tests.fakes import logs
from tests.fakes.plant import FakePlant, FakeStation, Server

VICTIMS = ("writer", "shipper", "relay", "plant", "postgresql", "plant's disk", "PostgreSQL's disk", "station's disk")
#: So small a file takes no record: every write fails as on a full disk.
_FULL_BYTES = 64


@dataclass(slots=True)
class Child:
    """One process, forked from this one, which has loaded everything."""

    work: Callable[[], None]
    pid: int = 0

    def start(self) -> None:
        self.pid = os.fork()
        if self.pid == 0:
            try:
                signal.signal(signal.SIGTERM, signal.SIG_DFL)
                self.work()
            finally:
                os._exit(0)

    def kill(self) -> None:
        if self.pid:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
            self.pid = 0

    def fill_disk(self, *, full: bool) -> None:
        limit = _FULL_BYTES if full else resource.RLIM_INFINITY
        with suppress(ProcessLookupError, PermissionError):
            resource.prlimit(self.pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))


@dataclass(slots=True)
class World:
    """Stations, relay, plant and PostgreSQL in one folder."""

    server: Server
    folder: Path
    stations: list[FakeStation]
    drawn: random.Random
    address: str = ""
    port: int = 0
    relay_port: int = 0
    children: dict[str, list[Child]] = field(default_factory=dict)
    resting: Path = Path()

    def start(self) -> None:
        self.address = self.server.database()
        FakePlant(self.address, self.folder / "objects").connections.close()
        self.port, self.relay_port = free_port(), free_port()
        self.resting = self.folder / "rest"
        for station in self.stations:
            station.store().close()
        self.children = {
            "plant": [Child(self._plant)],
            "relay": [Child(self._relay)],
            "writer": [Child(lambda s=station: self._writer(s)) for station in self.stations],  # type: ignore[misc]
            "shipper": [Child(lambda s=station: self._shipper(s)) for station in self.stations],  # type: ignore[misc]
        }
        for group in self.children.values():
            for child in group:
                child.start()

    def _plant(self) -> None:
        made = self._open_plant()
        tokens = {token_hash(s.name): s.registered for s in self.stations}
        face = PlantFace(made.receiver, made.store, Entrances(tokens, {}), SystemClock(), None, 1 << 27)
        listener = socket.create_server(("127.0.0.1", self.port))
        uvicorn.Server(uvicorn.Config(create_plant_app(face), log_level="critical")).run([listener])

    def _open_plant(self) -> FakePlant:
        """As its service manager: starts it again until its database answers."""
        while True:
            try:
                return FakePlant(self.address, self.folder / "objects")
            except StationError:
                time.sleep(0.05)

    def _relay(self) -> None:
        door = socket.create_server(("127.0.0.1", self.relay_port))
        while True:
            client, _ = door.accept()
            try:
                onward = socket.create_connection(("127.0.0.1", self.port), timeout=5)
            except OSError:
                client.close()
                continue
            for one, other in ((client, onward), (onward, client)):
                threading.Thread(target=pump, args=(one, other), daemon=True).start()

    def _writer(self, station: FakeStation) -> None:
        off_ns = random.randrange(-3600, 3600) * 10**9
        signer = keys.Signer(station.key.sign, station.registered.public_key)
        number = 0
        while True:
            try:
                with SqliteStore(station.path, station.name, lambda: time.time_ns() + off_ns, signer=signer) as store:
                    for one in store.unfinished():
                        store.finish(one.attempt, "INTERRUPTED", 1)
                    while not self.resting.exists():
                        number += 1
                        logs.unit(store, f"SN{os.getpid()}-{number}", station=station.name)
                        time.sleep(0.02)
                return
            except StationError:
                time.sleep(0.05)

    def _shipper(self, station: FakeStation) -> None:
        token = self.folder / f"{station.name}.token"
        token.write_text(station.name)
        receiver = ReceiverSettings(
            url=f"http://127.0.0.1:{self.relay_port}", token_file=str(token), timeout_s=3, portion_bytes=16_384
        )
        settings = Settings.model_validate(
            {"schema": "station.config/1", "station": station.name, "nests": [Nest(name="A", node=1)]}
        ).model_copy(update={"receivers": (receiver,)})
        while True:
            try:
                Shipping(station.path, settings).start()
            except StationError:
                time.sleep(0.05)
            else:
                threading.Event().wait()

    def strike(self, victim: str) -> None:
        """Kills one, or fills one disk for a while, and puts it right again."""
        if victim == "postgresql":
            self.server.kill()
            time.sleep(self.drawn.random() * 0.1)
            self.server.restart()
        elif victim == "PostgreSQL's disk":
            self._fill_postgresql()
        elif victim in ("plant's disk", "station's disk"):
            child = self.drawn.choice(self.children["plant" if victim.startswith("plant") else "writer"])
            child.fill_disk(full=True)
            time.sleep(0.05 + self.drawn.random() * 0.1)
            child.fill_disk(full=False)
        else:
            child = self.drawn.choice(self.children[victim])
            child.kill()
            time.sleep(self.drawn.random() * 0.05)
            child.start()

    def _fill_postgresql(self) -> None:
        process = self.server._process
        assert process is not None
        pids = [process.pid]
        for entry in Path("/proc").iterdir():
            with suppress(OSError, ValueError):
                if int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == process.pid:
                    pids.append(int(entry.name))
        for limit in (_FULL_BYTES, resource.RLIM_INFINITY):
            for pid in pids:
                with suppress(ProcessLookupError, PermissionError):
                    resource.prlimit(pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
            if limit == _FULL_BYTES:
                time.sleep(0.05 + self.drawn.random() * 0.1)
        self.server.restart()

    def settle(self, within_s: float) -> None:
        """The writers rest, and what is on its way arrives. Raises AssertionError where nothing more came within_s."""
        self.resting.touch()
        for child in self.children["writer"]:
            os.waitpid(child.pid, 0)
            child.pid = 0
        wanted = {s.name: len(s.records()) for s in self.stations}
        until = time.monotonic() + within_s
        arrived = dict[str, int]()
        while time.monotonic() < until:
            before = arrived
            with suppress(psycopg.Error), psycopg.connect(self.address) as db:
                arrived = dict(db.execute("SELECT station, number FROM log WHERE current").fetchall())
            if arrived == wanted:
                return
            if arrived != before:
                until = time.monotonic() + within_s
            time.sleep(0.1)
        shown = [s.document() for station in self.stations for s in read_statuses(station.path)]
        raise AssertionError(f"{arrived} of {wanted}: {shown}")

    def stop(self) -> None:
        for group in self.children.values():
            for child in group:
                child.kill()


def pump(one: socket.socket, other: socket.socket) -> None:
    with suppress(OSError):
        while data := one.recv(65_536):
            other.sendall(data)
    for end in (one, other):
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


def token_hash(name: str) -> str:
    import hashlib

    return hashlib.sha256(name.encode()).hexdigest()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as door:
        return int(door.getsockname()[1])


def judge(world: World) -> dict[str, int]:
    """Records lost, twice, out of order, altered, set apart; and how many there were."""
    found = Counter[str]()
    plant = FakePlant(world.address, world.folder / "objects")
    union = " UNION ALL ".join(f'SELECT seq, log, number, hash FROM "{table}"' for table in COLUMNS)
    with plant.connections.one() as db:
        for station in world.stations:
            query = (
                f"SELECT number, hash FROM ({union}) r WHERE log = (SELECT id FROM log WHERE station = %s) ORDER BY seq"
            )
            rows = [(int(n), bytes(h)) for n, h in db.execute(query.encode(), [station.name])]
            own = [(r.number, r.hash) for r in station.records()]
            numbers = [n for n, _ in rows]
            found["records"] += len(own)
            found["lost"] += len(set(own) - set(rows))
            found["twice"] += len(numbers) - len(set(numbers))
            found["out of order"] += sum(b <= a for a, b in pairwise(numbers))
            found["altered"] += len(set(rows) - set(own))
    found["set apart"] = len(plant.store.quarantined(resolved=True))
    with plant.reader() as log:
        found["findings"] = len(list(log.findings()))
    plant.connections.close()
    return {
        name: found[name] for name in ("records", "lost", "twice", "out of order", "altered", "set apart", "findings")
    }


def torture(server: Server, folder: Path, kills: int, stations: int, seed: int) -> dict[str, Any]:
    """So many blows, then what is there."""
    drawn = random.Random(seed)
    world = World(server, folder, [FakeStation(f"bench-{n}", folder) for n in range(stations)], drawn)
    world.start()
    struck = Counter[str]()
    try:
        for number in range(kills):
            time.sleep(drawn.random() * 0.15)
            victim = VICTIMS[number % len(VICTIMS)]
            world.strike(victim)
            struck[victim] += 1
        world.settle(120)
        return {"seed": seed, "struck": dict(struck), **judge(world)}
    finally:
        world.stop()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--stations", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="station-plant-", ignore_cleanup_errors=True) as place:
        server, folder = Server(Path(place) / "pg"), Path(place) / "work"
        server.folder.mkdir()
        folder.mkdir()
        server.start()
        try:
            done = torture(server, folder, options.kills, options.stations, options.seed)
        finally:
            server.stop()
    print(json.dumps(done) if options.json else "\n".join(f"{name}: {value}" for name, value in done.items()))
    return int(any(done[name] for name in ("lost", "twice", "out of order", "altered", "set apart", "findings")))


if __name__ == "__main__":
    sys.exit(main())
