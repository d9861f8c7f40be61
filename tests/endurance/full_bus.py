"""Frames lost at a full 1 Mbit/s while the run, a second calibration, the page and the store work beside the receiver.

    python tests/endurance/full_bus.py [--seconds 60] [--buffer BYTES] [--dwell 1.0] [--idle] [--json]

Four simulated devices in a process of their own send 9,008 readings a second (a classic bus at 1 Mbit/s carries 9,009
frames of 8 bytes), each at its device's own clock. The station takes load after load of them through six positions:
the same socket code, buffers, checks, fits, write-back and log as on a bench. Beside it, in the same process, a thread
calibrates without end; in others a `station panel` on the same log, and somebody who loads its pages without end.
--idle leaves these out; --buffer makes the sockets' buffers too small, to see what then happens. The wire is UDP on
the loopback, through the channels that a bench has on its raw sockets.

Goal: no frame lost in any visit that was kept; a visit that lost one must stand in the log as rejected.
"""

import argparse
import json
import multiprocessing
import os
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import yaml

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

import panel as pages
import wires

from station.adapters.bus.socketcan import STREAM_BUFFER_BYTES, _Channel, _enlarge
from station.adapters.store.reader import SqliteLogReader
from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.domain.core.types import Frames
from station.domain.evaluation import pipeline
from station.domain.run.progress import VisitStarted
from station.model.simulate import SimulationJob, simulate
from station.ports.log_reader import Query
from station.service.itinerary import tumble_visits, verification_visits
from station.service.runner import Runner
from station.wiring import bench
from station.wiring.bench import Bench, open_bench
from station.wiring.live_device import LiveDevices, Population
from station.wiring.run_order import RunOrder

NODES, SERIALS = (0x11, 0x12, 0x13, 0x14), ("SN0001", "SN0002", "SN0003", "SN0004")
RATE_HZ, BLOCK_S = 2252, 0.005
#: Bases of the identifiers of readings and temperature: they go to the stream's socket, as its filter would have it.
STREAMED = (0x180, 0x280)
#: Base of the identifiers of a device's SDO answers (CiA 301, 7.3.5).
SDO_ANSWER = 0x580
Address = tuple[str, int]


class UdpBus:
    """The station's side: its real channels, on UDP sockets that stand for filtered raw ones."""

    name = "full bus"

    def __init__(self, service: int, stream: int, devices: int, buffer: int) -> None:
        self._ports, self._devices, self._buffer = {"service": service, "stream": stream}, devices, buffer
        self._open: list[_Channel] = []

    def stream(self, _can_ids: tuple[int, ...]) -> _Channel:
        """Readings."""
        return self._channel("stream")

    def service(self, can_ids: tuple[int, ...]) -> _Channel:
        """Everything else; who does not listen to the devices' answers hears nobody on this bus."""
        return self._channel("service" if any(can_id & ~0x7F == SDO_ANSWER for can_id in can_ids) else "watch")

    def state(self) -> str:
        """Nobody can tell."""
        return "unknown"

    def repeat(self, can_id: int, data: bytes, period_s: float) -> None:
        """No device on this bus asks for a SYNC."""
        raise NotImplementedError(f"{can_id:#x} {data.hex()} every {period_s:g} s")

    def close(self) -> None:
        """Closes the sockets."""
        for channel in self._open:
            channel.close()

    def _channel(self, kind: str) -> _Channel:
        sock = bound(self._ports.get(kind, 0), self._buffer)
        sock.connect(("127.0.0.1", self._devices))
        self._open.append(_Channel(self.name, sock))
        return self._open[-1]


class Devices:
    """The devices' side: one socket; each frame goes where the station's filters would let it through."""

    def __init__(self, port: int, service: int, stream: int) -> None:
        self._sock = bound(port)
        self._channel = _Channel("devices", self._sock)
        self._to: dict[bool, Address] = {False: ("127.0.0.1", service), True: ("127.0.0.1", stream)}

    def send(self, can_id: int, data: bytes) -> None:
        """One frame."""
        streamed = can_id & ~0x7F in STREAMED
        self._sock.sendto(wires.FRAME.pack(can_id, len(data), data), self._to[streamed])

    def send_many(self, frames: Frames) -> None:
        """A block."""
        for can_id, length, data in zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True):
            self.send(can_id, data[:length].tobytes())

    def receive(self, timeout_s: float) -> Frames:
        """Requests."""
        return self._channel.receive(timeout_s)

    def drops(self) -> int:
        """Requests lost."""
        return self._channel.drops()

    def close(self) -> None:
        """Off the bus."""
        self._channel.close()


def bound(port: int, buffer: int = STREAM_BUFFER_BYTES) -> socket.socket:
    """A socket as the station makes its own."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.settimeout(0)
    _enlarge(sock, buffer)
    sock.bind(("127.0.0.1", port))
    return sock


def free_ports(count: int) -> list[int]:
    """Ports that nobody has."""
    with ExitStack() as opened:
        socks = [opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
        for sock in socks:
            sock.bind(("127.0.0.1", 0))
        return [sock.getsockname()[1] for sock in socks]


def live(ports: tuple[int, int, int], orders: Connection) -> None:
    """The devices' process: turned by what comes through the pipe. Hardware does not wait for a turn on a busy PC, so
    it goes before everything else where it may."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    port, service, stream = ports
    wanted = Population("accelerometer", "full bus", NODES, SERIALS, rate_hz=RATE_HZ, flash_s=0.05, block_s=BLOCK_S)
    devices = LiveDevices(wanted, Devices(port, service, stream))

    def obey() -> bool:
        while orders.poll():
            devices.world.obey(orders.recv())
        return True

    devices.live(obey)


@contextmanager
def extra(database: Path, folder: Path) -> Iterator[Counter[str]]:
    """A calibrating thread, a panel and somebody who loads its pages; how often each did it."""
    done: Counter[str] = Counter()
    over = threading.Event()
    with pages.panel(database, folder) as (client, _):

        def diagnosis_of() -> None:
            while not over.is_set():
                for at in ("/", "/audit", "/charts", "/metrics"):
                    client.get(at, headers={"accept": "text/html"})
                    done["pages"] += 1

        threads = [threading.Thread(target=diagnosis_of), threading.Thread(target=calibrate, args=(over, done))]
        for thread in threads:
            thread.start()
        try:
            yield done
        finally:
            over.set()
            for thread in threads:
                thread.join()


def calibrate(over: threading.Event, done: Counter[str]) -> None:
    """Fits the same samples again and again."""
    recipe = load_recipe("six-point")
    table = simulate(SimulationJob(recipe, SERIALS, seed=1)).table
    while not over.is_set():
        done["calibrations"] += sum(1 for _ in pipeline.calibrate(recipe, table, "2026-01-01"))


def order(folder: Path, dwell_s: float) -> RunOrder:
    """The station: six short stops, a drive that is there at once."""
    recipe, config = (
        yaml.safe_load((shipped_folder() / f).read_text()) for f in ("recipes/six-point.yaml", "config.yaml")
    )
    sheet = {**recipe["device"], "rate_hz": RATE_HZ, "clock_tolerance_ppm": 1000}
    limits = {"rule": "simple", "offset": 0.2, "residual": 0.05}
    (folder / "recipe.yaml").write_text(
        yaml.safe_dump({**recipe, "device": sheet, "limits": limits, "dwell": {"time_s": dwell_s}})
    )
    drive = {"kind": "simulated", "speed_deg_s": 3600, "acceleration_deg_s2": 36000}
    bus = {"interface": "socketcan", "channel": "full-bus"}  # whose place the UDP sockets take
    (folder / "config.yaml").write_text(yaml.safe_dump({**config, "bus": bus, "positioner": drive}))
    return RunOrder(str(folder / "recipe.yaml"), folder / "config.yaml", folder / "station.db")


def measure(seconds: float, buffer: int, dwell_s: float, *, idle: bool) -> dict[str, Any]:
    """The figures."""
    ports = free_ports(3)
    here, there = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=live, args=(tuple(ports), here), daemon=True)
    process.start()
    bus = UdpBus(ports[1], ports[2], ports[0], buffer)
    wiring: Any = bench
    wiring.open_buses = lambda *_args, **_options: bus
    wiring.refuse_numbers_for_real_units = lambda _settings, _built: None  # behind this bus stands nobody
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name, ExitStack() as opened:
        folder = Path(name)
        station = opened.enter_context(open_bench(order(folder, dwell_s)))
        done = Counter[str]() if idle else opened.enter_context(extra(folder / "station.db", folder))
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            outcomes.update(one_load(station, there.send))
        found = visits(folder / "station.db")
    process.kill()
    process.join()
    return {**found, "outcomes": dict(outcomes), "beside": dict(done), "rate_per_s": RATE_HZ * len(NODES)}


def one_load(station: Bench, turn: Callable[[str], None]) -> list[str]:
    """Outcomes of a fixture load; the devices feel what the stop says."""
    recipe = station.job.recipe
    true = {s.position: s.true for s in [*tumble_visits(recipe, 0), *verification_visits(recipe)]}
    (seats,) = station.loads(SERIALS)
    with closing(Runner(station.station, station.job).run(seats)) as events:
        for event in events:
            if isinstance(event, VisitStarted):
                turn("true " + " ".join(f"{float(v):.9f}" for v in np.asarray(true[event.position])))
            last = event
    return [str(r.outcome) for r in last.results]  # type: ignore[attr-defined]


def visits(database: Path) -> dict[str, Any]:
    """What the log says of every visit: frames received, lost by the counter, dropped by the kernel, why rejected."""
    stored: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    with SqliteLogReader(database) as log:
        for attempt in log.attempts(Query()):
            for visit in log.attempt(attempt)["visits"]:
                shown, whole = visit["statistics"], visit["kind"] != "rejected"
                stored["kept" if whole else "rejected"] += 1
                stored["frames"] += shown["frames"]
                stored["lost_in_kept" if whole else "lost_in_rejected"] += shown["lost"] + shown["kernel_drops"]
                reasons.update(shown["reasons"])
    return {**{k: stored[k] for k in ("kept", "rejected", "frames", "lost_in_kept", "lost_in_rejected")},
            "reasons": dict(reasons.most_common(6))}  # fmt: skip


def main() -> int:
    """Prints the figures; 1 when a kept visit lost a frame."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--buffer", type=int, default=STREAM_BUFFER_BYTES)
    parser.add_argument("--dwell", type=float, default=1.0)
    parser.add_argument("--idle", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    shown = measure(given.seconds, given.buffer, given.dwell, idle=given.idle)
    alone = not given.idle and not all(shown["beside"].get(what) for what in ("pages", "calibrations"))
    bad = shown["lost_in_kept"] > 0 or alone
    if given.json:
        print(json.dumps(shown))
        return int(bad)
    print(f"{wires.machine()}; over {wires.medium()}")
    print(
        f"frames lost at {shown['rate_per_s']} frames/s: {shown['lost_in_kept']} of {shown['frames']} in "
        f"{shown['kept']} kept visits (goal 0); {shown['rejected']} visits rejected, "
        f"with {shown['lost_in_rejected']} frames lost"
    )
    print(f"  outcomes {shown['outcomes']}; beside it {shown['beside']}; why rejected {shown['reasons']}")
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
