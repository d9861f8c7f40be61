"""Receive and decode: CPU time per frame against python-can and a bare recvmmsg loop; sixteen buses on one core.

python benchmarks/receive.py [--rows 1 2] [--runs 15] [--seconds 5]
"""

import argparse
import importlib.metadata
import os
import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import cantools
import figures
import numpy as np
import wires
from can.interfaces.socketcan.socketcan import SocketcanBus

from station.adapters.bus._recvmmsg import Receiver
from station.adapters.dbc import read_layouts
from station.adapters.malloc_tuning import retain_freed_memory
from station.adapters.store.sqlite import SqliteStore
from station.domain.can.decode import Samples, decode_samples
from station.domain.can.encode import sample_frames
from station.domain.can.sensor_layout import FrameMap, SensorLayout, resolve
from station.domain.core.types import Frames
from station.ports.store import AttemptStart, VisitRecord

DBC = Path(__file__).resolve().parents[1] / "dbc" / "accelerometer.dbc"
ROLES = {
    "dbc": DBC.name,
    "sample": {"message": "ACCELERATION", "x": "X", "y": "Y", "z": "Z", "counter": "COUNTER", "crc": "CRC"},
    "e2e": {"profile": "P01", "data_id": 0x1A00, "data_id_plus_node": True},
}
#: A full classic bus at 1 Mbit/s: 8-byte frames without a stuff bit, 111 bits each.
FULL_BUS_PER_S = 9009
#: How often a dwell looks for frames.
POLL_S = 0.2
BUSES = 16


def main() -> None:
    """Prints each figure with its goal, peer, runs and spread."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=[1, 2], choices=[1, 2])
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--seconds", type=float, default=5.0)
    options = parser.parse_args()
    print(f"{wires.machine()}; over {wires.medium()}")
    retain_freed_memory()  # as a station's process does, and to the good of every contestant
    layout = resolve(FrameMap.model_validate(ROLES), read_layouts(DBC))
    if 1 in options.rows:
        row_1(layout, options.runs)
    if 2 in options.rows:
        row_2(layout, options.seconds)


def row_1(layout: SensorLayout, runs: int) -> None:
    """CPU time per frame: the station, python-can + cantools, and nothing but recvmmsg, by turns."""
    wire = wires.open_wire(0)
    datagrams = _datagrams(_stream(layout, 15 * 600))
    contestants = {"floor": _floor(wire), "station": _station(wire, layout), "peer": _peer(wire)}
    paces = {"a full 1 Mbit/s bus": _paced, "waiting frames": _at_once}
    if wires.is_guest():
        del paces["a full 1 Mbit/s bus"]  # its sender cannot keep the pace
    for pace, give in paces.items():
        cost_us: dict[str, list[float]] = {name: [] for name in contestants}
        for run in range(runs + 1):
            for name, receive in contestants.items():
                sending = give(wire, datagrams)
                started_ns = wires.cpu_ns()
                got = receive(len(datagrams))
                if run:  # the first one has its memory still to come from the kernel, and does not count
                    cost_us[name].append((wires.cpu_ns() - started_ns) / 1000 / len(datagrams))
                assert got == len(datagrams), f"{name} received {got} of {len(datagrams)}"
                sending.wait()
        _print_row_1(pace, cost_us)
    assert wire.drops() == 0
    _print_peer(runs)
    wire.close()


def _paced(wire: wires.Wire, datagrams: list[bytes]) -> "subprocess.Popen[bytes]":
    """Another process sends one frame each 111 µs."""
    return wires.start_sender([wire], b"".join(datagrams), len(datagrams), 1 / FULL_BUS_PER_S)


def _at_once(wire: wires.Wire, datagrams: list[bytes]) -> "subprocess.Popen[bytes]":
    """All frames are in the socket's buffer before the first is read."""
    sending = wires.start_sender([wire], b"".join(datagrams), len(datagrams), 0.0)
    sending.wait()
    return sending


def row_2(layout: SensorLayout, seconds: float) -> None:
    """Sixteen full buses received, decoded and stored by this process alone, held to one core."""
    cores = sorted(os.sched_getaffinity(0))
    open_wires = [wires.open_wire(i) for i in range(BUSES)]
    ticks = round(seconds * 1000)
    per_tick = -(-FULL_BUS_PER_S // 1000)
    one_turn = b"".join(_datagrams(_stream(layout, 15 * 1000)))
    os.sched_setaffinity(0, {cores[-1]})
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as folder:
        store = SqliteStore(Path(folder) / "station.db")
        attempts = [store.begin(_begin(i)) for i in range(BUSES)]
        sending = wires.start_sender(open_wires, one_turn, ticks * per_tick, 0.001, each=per_tick)
        if len(cores) > 1:
            os.sched_setaffinity(sending.pid, {cores[0]})
        used_s, found = _receive_and_store(open_wires, layout, store, attempts, ticks * per_tick)
        sending.wait()
        started_s = time.process_time()
        for attempt in attempts:
            store.finish(attempt, "PASS", time.time_ns())
        store.tidy()
        used_s += time.process_time() - started_s
        store.close()
    total = BUSES * ticks * per_tick
    lost = total - sum(int(np.count_nonzero(s.crc_ok)) for s in found)
    dropped = sum(w.drops() for w in open_wires)
    for wire in open_wires:
        wire.close()
    factor = total / (BUSES * FULL_BUS_PER_S) / used_s
    _print(
        "2  sixteen full buses, decoded and stored", f"{factor:.2f} × real time on one core", factor >= 1 and not lost
    )
    what = f"sixteen full buses decoded and stored on one core, over {wires.medium().split(' (')[0]}"
    lost_reported = f"{lost} of {total} lost"
    good = factor >= 1 and not lost
    figures.keep(2, what, f"{factor:.2f} × real time, {lost_reported}; 1 run", "real time", ">= 1.0 ×, no loss", good)
    print(f"   goal ≥ 1.0 and no loss; {total} frames, {lost} lost or wrong, {dropped} dropped by the kernel")
    print(f"   {used_s / total * 1e6:.2f} µs of CPU a frame, with CRC, counter, hash chain, commits and packing; 1 run")


def _receive_and_store(
    open_wires: list[wires.Wire], layout: SensorLayout, store: SqliteStore, attempts: list[str], count: int
) -> tuple[float, list[Samples]]:
    """CPU seconds, and what each stop of about a second came to; ends when every wire has had `count` frames."""
    receivers = [Receiver(w.sock) for w in open_wires]
    waiting: list[list[Frames]] = [[] for _ in receivers]
    had, found, visit = [0] * BUSES, [], 0
    idle_since_s = time.monotonic()
    started_s, stop_s = time.process_time(), time.monotonic() + 1.0
    while min(had) < count and time.monotonic() - idle_since_s < 5.0:
        time.sleep(0.05)
        for number, receiver in enumerate(receivers):
            while len(frames := receiver.take()):
                waiting[number].append(frames)
                had[number] += len(frames)
                idle_since_s = time.monotonic()
        # A sender that was starved for a second makes the stop a longer one.
        if all(waiting) and (time.monotonic() >= stop_s or min(had) >= count):
            stops = [Frames.join(parts) for parts in waiting]
            read = [decode_samples(frames, layout, 1) for frames in stops]
            store.visit(attempts, [_visit(visit, f, s) for f, s in zip(stops, read, strict=True)])
            found += read
            waiting, visit, stop_s = [[] for _ in receivers], visit + 1, stop_s + 1.0
    return time.process_time() - started_s, found


def _floor(wire: wires.Wire) -> Callable[[int], int]:
    """recvmmsg with time stamps into one buffer, nothing else: one call of the C library for up to 2,048 frames."""
    receiver = Receiver(wire.sock)

    def receive(count: int) -> int:
        got = 0
        while got < count:
            more = receiver.fill()
            got += more
            if not more:
                time.sleep(POLL_S)
        return got

    return receive


def _station(wire: wires.Wire, layout: SensorLayout) -> Callable[[int], int]:
    """What a dwell does: look every now and then and take all, at its end decode, check CRC and counter."""
    receiver = Receiver(wire.sock)

    def receive(count: int) -> int:
        parts, got = [], 0
        while got < count:
            parts.append(receiver.take())
            got += len(parts[-1])
            if not len(parts[-1]):
                time.sleep(POLL_S)
        return int(np.count_nonzero(decode_samples(Frames.join(parts), layout, 1).usable))

    return receive


class _PeerBus(SocketcanBus):
    """python-can's SocketCAN bus on a socket that is open already; receiving is its own code."""

    def __init__(self, wire: wires.Wire) -> None:
        self.socket = wire.sock
        self.channel = str(wire.target[1])
        self._is_filtered = True
        self._task_id = 0
        can.BusABC.__init__(self, channel=self.channel)
        self._is_filtered = True

    def _apply_filters(self, filters: object) -> None:
        """The kernel's filters stay as they are."""

    def shutdown(self) -> None:
        """The socket is not this object's to close."""
        can.BusABC.shutdown(self)


def _peer(wire: wires.Wire) -> Callable[[int], int]:
    """python-can's Notifier and cantools, frame by frame; they check neither counter nor CRC."""
    database: Any = cantools.database.load_file(DBC)

    def receive(count: int) -> int:
        decoded, done = [], threading.Event()

        def listener(message: can.Message) -> None:
            decoded.append(database.decode_message(message.arbitration_id, message.data))
            if len(decoded) >= count:
                done.set()

        bus = _PeerBus(wire)
        notifier = can.Notifier(bus, [listener])
        done.wait(60.0)
        notifier.stop()
        bus.shutdown()
        return len(decoded)

    return receive


def _print_row_1(pace: str, cost_us: dict[str, list[float]]) -> None:
    over_floor = [s / f for s, f in zip(cost_us["station"], cost_us["floor"], strict=True)]
    under_peer = [p / s for p, s in zip(cost_us["peer"], cost_us["station"], strict=True)]
    calmest = min(cost_us["station"]) / min(cost_us["floor"])
    good = statistics.median(over_floor) <= 1.5 and statistics.median(under_peer) >= 20
    _print(f"1  receive + decode, {pace}", f"{_median(cost_us['station'])} µs of CPU a frame", good)
    print(f"   {_median(under_peer)} × less than the peer, goal ≥ 20; {_median(over_floor)} × the floor, goal ≤ 1.5")
    print(f"   least disturbed run against least disturbed run: {calmest:.3g} × the floor")
    over = f"over {wires.medium().split(' (')[0]}"
    figures.keep(
        *(1, f"receive + decode, CPU a frame {over}, {pace}"),
        f"{_median(under_peer)} × less than the peer; {_median(over_floor)} × the floor "
        f"(least disturbed {calmest:.3g} ×); {len(over_floor)} runs",
        f"{_peer_versions()} {_median(cost_us['peer'])} µs; bare recvmmsg {_median(cost_us['floor'])} µs",
        *(">= 20 × less; <= 1.5 × the floor", good),
    )
    limit = statistics.median(cost_us["peer"]) / statistics.median(cost_us["floor"])
    print(
        f"   peer {_median(cost_us['peer'])} µs, floor {_median(cost_us['floor'])} µs, {limit:.3g} × less than the peer"
    )


def _peer_versions() -> str:
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("python-can", "cantools"))


def _print_peer(runs: int) -> None:
    print(f"   peer: {_peer_versions()}: Notifier + decode_message, which check neither counter nor CRC")
    print(
        f"   floor: recvmmsg alone, kernel times kept; {runs} runs by turns, median [quartiles]; numpy {np.__version__}"
    )


def _print(what: str, figure: str, good: bool) -> None:
    print(f"{what}: {figure} — {'reached' if good else 'BEHIND its goal'}")


def _median(values: list[float]) -> str:
    low, middle, high = statistics.quantiles(values, n=4)
    return f"{middle:.3g} [{low:.3g}–{high:.3g}]"


def _stream(layout: SensorLayout, count: int) -> Frames:
    reading = np.random.default_rng(1).normal(0.0, 0.3, (count, 3))
    return sample_frames(layout, 1, np.arange(count) * 111_000, reading)


def _datagrams(frames: Frames) -> list[bytes]:
    return [wires.FRAME.pack(0x181, 8, data.tobytes()) for data in frames.data]


def _begin(nest: int) -> AttemptStart:
    return AttemptStart(
        serial=f"SN{nest:04d}",
        station="bench",
        nest=str(nest),
        node=1,
        recipe_name="bench",
        recipe_version=1,
        recipe_hash="0" * 64,
        recipe_json="{}",
        config_hash="0" * 64,
        software="bench",
        operator="",
        started_ns=time.time_ns(),
    )


def _visit(visit: int, frames: Frames, read: Samples) -> VisitRecord:
    used = read.xyz[read.usable]
    statistics_ = {"mean": used.mean(axis=0).tolist(), "std": used.std(axis=0).tolist(), "count": len(used)}
    first, last = int(frames.time_ns[0]), int(frames.time_ns[-1])
    return VisitRecord(0, visit, "z-up", "home", "tumble", first, last, frames, statistics_)


if __name__ == "__main__":
    main()
