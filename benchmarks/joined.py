"""Receive and decode, CPU time a reading: two-message readings and FD frames against one classic frame each.

Two messages are two frames on the wire. Beside the cost a reading stands that of a frame, and the floor: what the
system calls alone take for the same frames, neither copied nor decoded, over the whole cost of one classic frame.

python benchmarks/joined.py [--runs 15]
"""

import argparse
import statistics
import struct
from collections.abc import Callable
from typing import Any

import figures
import numpy as np
import wires
from cantools import database

from station.adapters.bus._recvmmsg import CANFD_FRAME, Receiver
from station.adapters.dbc.layouts import _frame
from station.adapters.malloc_tuning import retain_freed_memory
from station.domain.can.decode import decode_samples
from station.domain.can.encode import sample_frames
from station.domain.can.sensor_layout import FrameMap, SensorLayout, resolve
from station.domain.core.types import Frames

READINGS, GOAL = 6000, 1.3
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
FORMS = {
    "one classic frame": {"message": "ONE", "x": "X", "y": "Y", "z": "Z", "counter": "N"},
    "two classic frames": {"message": "ONE", "x": "X", "y": "Y", "z": "TWO.Z", "counter": "N"},
    "one FD frame": {"message": "FD", "x": "X0", "y": "Y0", "z": "Z0"},
    "an FD frame of ten": {"message": "FD", **{a.lower(): [f"{a}{i}" for i in range(10)] for a in "XYZ"}},
}


def main() -> None:
    """Prints each form's cost a reading, and its share of that of one classic frame."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=15)
    runs = parser.parse_args().runs
    retain_freed_memory()
    print(f"{wires.machine()}; over {wires.medium()}; {READINGS} readings, {runs} runs by turns")
    read: Any = database.load_string(DBC, "dbc", sort_signals=None)
    parsed = {m.name: _frame(m, None) for m in read.messages}
    layouts = {n: resolve(FrameMap.model_validate({"dbc": "b", "sample": s}), parsed) for n, s in FORMS.items()}
    wire = wires.open_wire(0)
    sender = wires.open_sender(wire.target)
    takers = {name: _taker(wire, layout) for name, layout in layouts.items()}
    floors = {name: _floor(wire, layout) for name, layout in layouts.items()}
    sent = {name: _datagrams(layout) for name, layout in layouts.items()}
    cost_us: dict[str, list[float]] = {name: [] for name in layouts}
    floor_us: dict[str, list[float]] = {name: [] for name in layouts}
    for run in range(runs + 1):
        for name in layouts:
            for taker, kept in ((takers[name], cost_us[name]), (floors[name], floor_us[name])):
                for datagram in sent[name]:
                    sender.send(datagram)
                started_ns = wires.cpu_ns()
                frames, usable = taker()
                took_us = (wires.cpu_ns() - started_ns) / 1000
                assert (frames, usable) == (len(sent[name]), READINGS), f"{name}: {frames} frames, {usable} readings"
                if run:
                    kept.append(took_us / READINGS)
    wire.close()
    _print(cost_us, floor_us, {name: len(datagrams) / READINGS for name, datagrams in sent.items()}, runs)


def _print(
    cost_us: dict[str, list[float]], floor_us: dict[str, list[float]], frames_each: dict[str, float], runs: int
) -> None:
    """frames_each: frames of a reading, by form."""
    one = cost_us["one classic frame"]
    for name, costs in cost_us.items():
        low, middle, high = _ratio(costs, one)
        _, floor, _ = _ratio(floor_us[name], one)
        print(
            f"{name}: {statistics.median(costs):.3g} µs a reading; {middle:.3g} [{low:.3g}–{high:.3g}] × one classic; "
            f"a frame {middle / frames_each[name]:.3g} ×; floor, its system calls alone: {floor:.3g} ×"
        )
        if name != "one classic frame":
            figure = f"{middle:.3g} [{low:.3g}–{high:.3g}] × one classic frame; {runs} runs"
            figures.keep(1, f"receive + decode, {name}", figure, "one classic frame", "<= 1.3 ×", middle <= GOAL)


def _ratio(costs: list[float], of: list[float]) -> list[float]:
    """Quartiles of the ratio, run by run."""
    return statistics.quantiles([a / b for a, b in zip(costs, of, strict=True)], n=4)


def _floor(wire: wires.Wire, layout: SensorLayout) -> Callable[[], tuple[int, int]]:
    """Takes what waits into the receiver's own memory, and leaves it there."""
    receiver = Receiver(wire.sock, fd=layout.sample.length > 8)

    def take() -> tuple[int, int]:
        count = 0
        while taken := receiver.fill():
            count += taken
        return count, READINGS

    return take


def _taker(wire: wires.Wire, layout: SensorLayout) -> Callable[[], tuple[int, int]]:
    """Takes what waits and decodes it, as a dwell does; as wide as the form's frames need."""
    receiver = Receiver(wire.sock, fd=layout.sample.length > 8)

    def take() -> tuple[int, int]:
        parts: list[Frames] = []
        while len(frames := receiver.take()):
            parts.append(frames)
        joined = Frames.join(parts)
        return len(joined), int(np.count_nonzero(decode_samples(joined, layout, 1).usable))

    return take


def _datagrams(layout: SensorLayout) -> list[bytes]:
    xyz = np.random.default_rng(1).integers(-1000, 1000, (READINGS, 3)).astype(np.float64) * 0.001
    frames = sample_frames(layout, 1, np.arange(READINGS) * 1_000_000, xyz)
    if layout.sample.length > 8:
        form = struct.Struct("=IB3x64s")
        assert form.size == CANFD_FRAME.itemsize
    else:
        form = wires.FRAME
    rows = zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True)
    return [form.pack(can_id, length, data.tobytes()) for can_id, length, data in rows]


if __name__ == "__main__":
    main()
