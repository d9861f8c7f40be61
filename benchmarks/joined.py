"""Receive and decode, CPU time a reading: two-message readings and FD frames against one classic frame each.

Twice: as a run does it, which looks every 0.2 s for what four units have sent, lays it out for the log and decodes it;
and as many frames at once as a flooded station would find, decoded only. Two messages are two frames on the wire:
beside each cost stands what its system calls alone take, the floor of any way of decoding.

python benchmarks/joined.py [--runs 15] [--rates 100 1000]
"""

import argparse
import statistics
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import figures
import numpy as np
import wires
from cantools import database

from station.adapters.bus._recvmmsg import CANFD_FRAME, Receiver
from station.adapters.bus.socketcan import _Channel
from station.adapters.dbc.layouts import _frame
from station.adapters.malloc_tuning import retain_freed_memory
from station.domain.can.decode import decode_samples
from station.domain.can.encode import sample_frames
from station.domain.can.sensor_layout import FrameMap, SensorLayout, resolve
from station.domain.core.types import Frames, NestAssignment
from station.service.capture import DWELL_POLL_S, _live_reading
from station.service.station import Job
from station.service.unit import Unit
from station.service.visit_collector import VisitCollector
from station.wiring.jobs import load_job

READINGS, UNITS, LOOKS, GOAL = 6000, 4, 8, 1.3
_AXES = "".join(
    f' SG_ {axis}{i} : {16 * (3 * i + j)}|16@1- (0.001,0) [0|0] "g" A\n'
    for i in range(10)
    for j, axis in enumerate("XYZ")
)
DBC = f"""VERSION ""
NS_ :
BS_:
BU_: A
BO_ 385 ONE: 8 A
 SG_ N : 0|8@1+ (1,0) [0|255] "" A
 SG_ X : 16|16@1- (0.001,0) [0|0] "g" A
 SG_ Y : 32|16@1- (0.001,0) [0|0] "g" A
 SG_ Z : 48|16@1- (0.001,0) [0|0] "g" A
BO_ 641 TWO: 4 A
 SG_ N : 0|8@1+ (1,0) [0|255] "" A
 SG_ Z : 16|16@1- (0.001,0) [0|0] "g" A
BO_ 897 FD: 64 A
{_AXES}"""
ONE = "one classic frame"
FORMS: dict[str, dict[str, Any]] = {
    ONE: {"message": "ONE", "x": "X", "y": "Y", "z": "Z", "counter": "N"},
    "two classic frames": {"message": "ONE", "x": "X", "y": "Y", "z": "TWO.Z", "counter": "N"},
    "one FD frame": {"message": "FD", "x": "X0", "y": "Y0", "z": "Z0"},
    "an FD frame of ten": {"message": "FD", **{a.lower(): [f"{a}{i}" for i in range(10)] for a in "XYZ"}},
}


@dataclass
class Costs:
    """µs a reading: whole, and of that its system calls; one number a look."""

    whole: list[float] = field(default_factory=list)
    calls: list[float] = field(default_factory=list)


def main() -> None:
    """Prints each form's cost a reading, and its share of that of one classic frame."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--rates", type=int, nargs="*", default=[100, 1000])
    options = parser.parse_args()
    retain_freed_memory()
    print(f"{wires.machine()}; over {wires.medium()}; {options.runs} runs by turns")
    read: Any = database.load_string(DBC, "dbc", sort_signals=None)
    parsed = {m.name: _frame(m, None) for m in read.messages}
    layouts = {n: resolve(FrameMap.model_validate({"dbc": "b", "sample": s}), parsed) for n, s in FORMS.items()}
    opened = {fd: wires.open_wire(int(fd), fd=fd) for fd in (False, True)}
    lines = {name: opened[layout.sample.length > 8] for name, layout in layouts.items()}
    job, _ = load_job("six-point")
    for rate in options.rates:
        dwells = {n: _Dwell(lines[n], replace(job, layout=layout), rate) for n, layout in layouts.items()}
        readings = UNITS * round(rate * DWELL_POLL_S)
        _print(f"a run, {UNITS} units at {rate} Hz", _by_turns(dwells, options.runs, LOOKS, readings))
    floods = {n: _Flood(lines[n], layout) for n, layout in layouts.items()}
    _print(f"{READINGS} readings at once", _by_turns(floods, options.runs, 1, READINGS))
    for wire in opened.values():
        wire.close()


def _by_turns(takers: "dict[str, Any]", runs: int, looks: int, readings: int) -> dict[str, Costs]:
    """Costs of each form; the first run has its memory still to come from the kernel, and does not count."""
    costs = {name: Costs() for name in takers}
    for run in range(runs + 1):
        for name, taker in takers.items():
            for _ in range(looks):
                taker.send()
                whole_ns, calls_ns = taker.take()
                if run:
                    costs[name].whole.append(whole_ns / 1000 / readings)
                    costs[name].calls.append(calls_ns / 1000 / readings)
            taker.begin()
    return costs


class _Dwell:
    """Four units on one bus, looked at as a run does it."""

    def __init__(self, wire: wires.Wire, job: Job, rate: int) -> None:
        fd = job.layout.sample.length > 8
        self._job = job
        self._channel = _Channel("bench", wire.sock, fd=fd)
        self._sender = wires.open_sender(wire.target, fd=fd)
        per_frame = job.layout.samples_a_frame
        self._readings = round(rate * DWELL_POLL_S) // per_frame * per_frame
        sent = [_frames(job.layout, node, self._readings, rate) for node in range(1, UNITS + 1)]
        together = Frames.join(sent)
        self._datagrams = _datagrams(together[np.argsort(together.time_ns, kind="stable")], fd=fd)
        self._units = [_unit(node) for node in range(1, UNITS + 1)]
        self.begin()

    def begin(self) -> None:
        """The next visit."""
        self._collector = VisitCollector(self._units, self._job, 0)

    def send(self) -> None:
        """What comes between two looks."""
        for datagram in self._datagrams:
            self._sender.send(datagram)

    def take(self) -> tuple[int, int]:
        """One look; ns of all of it, and of the frames' coming in."""
        time.sleep(0.001)
        started_ns = wires.cpu_ns()
        frames = self._channel.receive(0.0)
        received_ns = wires.cpu_ns() - started_ns
        self._collector.add(frames)
        self._collector.update()
        _live_reading(self._collector)
        took_ns = wires.cpu_ns() - started_ns
        assert len(frames) == len(self._datagrams)
        assert all(len(samples) == self._readings for samples in self._collector.newest().values())
        return took_ns, received_ns


class _Flood:
    """One unit whose frames wait in thousands: taken and decoded, and the system calls alone for the same again."""

    def __init__(self, wire: wires.Wire, layout: SensorLayout) -> None:
        fd = layout.sample.length > 8
        self._layout, self._receiver = layout, Receiver(wire.sock, fd=fd)
        self._sender = wires.open_sender(wire.target, fd=fd)
        self._datagrams = _datagrams(_frames(layout, 1, READINGS, 1000), fd=fd)

    def begin(self) -> None:
        """Nothing is kept."""

    def send(self) -> None:
        """Fills the socket's buffer."""
        for datagram in self._datagrams:
            self._sender.send(datagram)

    def take(self) -> tuple[int, int]:
        """ns of taking and decoding all of it; of the system calls alone, which leave it in the receiver's memory."""
        took_ns = self._timed(self._decode)
        self.send()
        return took_ns, self._timed(self._leave)

    def _timed(self, act: Callable[[], int]) -> int:
        started_ns = wires.cpu_ns()
        count = act()
        took_ns = wires.cpu_ns() - started_ns
        assert count == len(self._datagrams), f"{count} frames of {len(self._datagrams)}"
        return took_ns

    def _decode(self) -> int:
        parts: list[Frames] = []
        while len(frames := self._receiver.take()):
            parts.append(frames)
        joined = Frames.join(parts)
        assert np.count_nonzero(decode_samples(joined, self._layout, 1).usable) == READINGS
        return len(joined)

    def _leave(self) -> int:
        count = 0
        while taken := self._receiver.fill():
            count += taken
        return count


def _print(condition: str, costs: dict[str, Costs]) -> None:
    print(f"{condition}:")
    one, least = statistics.median(costs[ONE].whole), min(costs[ONE].whole)
    for name, cost in costs.items():
        low, middle, high = (q / one for q in statistics.quantiles(cost.whole, n=4))
        calls = statistics.median(cost.calls)
        print(
            f"  {name}: {one * middle:.3g} µs a reading, {middle:.3g} [{low:.3g}–{high:.3g}] × one classic; "
            f"least {min(cost.whole) / least:.3g} × its least; system calls {calls:.3g} µs, {calls / one:.3g} ×"
        )
        if name != ONE:
            figure = f"{middle:.3g} [{low:.3g}–{high:.3g}] × one classic frame, least disturbed "
            figure += f"{min(cost.whole) / least:.3g} ×; {len(cost.whole)} looks"
            figures.keep(1, f"receive + decode, {name}; {condition}", figure, ONE, "<= 1.3 ×", middle <= GOAL)


def _unit(node: int) -> Unit:
    seat = NestAssignment(nest=f"N{node}", node=node, serial=f"SN{node:04}")
    return Unit(seat=seat, attempt="", device=None, began_s=0.0)  # type: ignore[arg-type]


def _frames(layout: SensorLayout, node: int, readings: int, rate: int) -> Frames:
    xyz = np.random.default_rng(node).integers(-1000, 1000, (readings, 3)).astype(np.float64) * 0.001
    times = np.round(np.arange(readings) * (1e9 / rate)).astype(np.int64)
    return sample_frames(layout, node, times, xyz)


def _datagrams(frames: Frames, *, fd: bool) -> list[bytes]:
    form = struct.Struct("=IB3x64s") if fd else wires.FRAME
    assert not fd or form.size == CANFD_FRAME.itemsize
    rows = zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True)
    return [form.pack(can_id, length, data.tobytes()) for can_id, length, data in rows]


if __name__ == "__main__":
    main()
