"""Write-back of 12 REAL32 with read-back at 125 kbit/s: time against wire time plus the device's own turnaround.

python benchmarks/writeback.py [--runs 15] [--bitrate 125000]            here: vcan, or UDP where there is no CAN
python benchmarks/on_vcan.py writeback.py                                in the guest of the vcan tests

Three processes: the station's client, a simulated device, and between them a wire that lets one frame pass at a time
and holds it for as long as its bits, stuff bits included, take. The wire also measures the device's turnaround, from
the request's delivery to the answer's coming. Beside it a bare client sends and receives the same frames without a
check: what it needs beyond wire and turnaround is the machine's, not the station's.
"""

import argparse
import multiprocessing
import select
import socket
import statistics
import struct
import subprocess
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import figures
import wires

from station.adapters.bus.socketcan import _Channel
from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork
from station.adapters.clock import SystemClock
from station.wiring.live_device import LiveDevices, Population

NODE, KEY = 5, bytes.fromhex("3143414c")
REQUEST, ANSWER = 0x600 + NODE, 0x580 + NODE
GOAL = 1.15
SO_TIMESTAMPNS = 35
#: CAN 2.0: polynomial of the frame's CRC; bits after it, interframe space included, that are never stuffed.
CRC_POLYNOMIAL, UNSTUFFED_TAIL = 0x4599, 13
VALUES = [struct.pack("<f", v) for v in (1.01, 0.002, 0, 0.001, 0.99, -0.001, 0, 0.003, 1.0, 0.012, -0.003, 0.021)]
OBJECTS = [(0x2101, sub) for sub in range(1, 10)] + [(0x2102, sub) for sub in range(1, 4)]


def main() -> None:
    """Prints the ratio with its goal, the bare client's as the floor, runs and spread."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--bitrate", type=int, default=125_000)
    options = parser.parse_args()
    print(f"{wires.machine()}; over {wires.medium()}")
    own, near = pair("benchnear", ANSWER, REQUEST)
    devices_end, far = pair("benchfar", REQUEST, ANSWER)
    fork = multiprocessing.get_context("fork")
    shown, tells = fork.Pipe(duplex=False)
    devices = LiveDevices(Population("accelerometer", "", (NODE,), ("SN0042",)), _Channel("far", devices_end))
    processes = [
        fork.Process(target=devices.live, args=(lambda: True,)),
        fork.Process(target=carry, args=(near, far, options.bitrate, tells)),
    ]
    for process in processes:
        process.start()
    try:
        report(own, options.runs, shown)
    finally:
        for process in processes:
            process.kill()
            process.join()


def pair(interface: str, first_hears: int, second_hears: int) -> tuple[socket.socket, socket.socket]:
    """Two ends of one bus: bare CAN sockets on a new vcan, else connected UDP sockets."""
    if wires.medium() == "vcan":
        subprocess.run(["ip", "link", "add", "dev", interface, "type", "vcan"], check=True)
        subprocess.run(["ip", "link", "set", interface, "up"], check=True)
        return hearing(interface, first_hears), hearing(interface, second_hears)
    one, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for end in (one, other):
        end.bind(("127.0.0.1", 0))
    one.connect(other.getsockname())
    other.connect(one.getsockname())
    return one, other


def hearing(interface: str, can_id: int) -> socket.socket:
    """A bare CAN socket that hears one identifier."""
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    # Not all bits of the mask: the error flag in it would ask for error frames instead.
    sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", can_id, 0xC000_07FF))
    sock.bind((interface,))
    return sock


def report(own: socket.socket, runs: int, shown: Connection) -> None:
    """Measures station and bare client by turns."""
    channel = _Channel("near", own)
    station = CanopenDevice(ServiceNetwork(channel, SystemClock()), NODE, answer_s=10.0)
    station.download(0x2104, 0, KEY)
    contestants = {"station": lambda: write_back(station), "bare": lambda: bare_write_back(own)}
    ratios: dict[str, list[float]] = {name: [] for name in contestants}
    parts: list[tuple[float, float, float, float]] = []
    so_far(shown)
    for _ in range(runs):
        for name, job in contestants.items():
            began_cpu_ns = wires.cpu_ns()
            took_s = timed(job)
            own_s = (wires.cpu_ns() - began_cpu_ns) / 1e9
            wire_s, turnaround_s = so_far(shown)
            ratios[name].append(took_s / (wire_s + turnaround_s))
            if name == "station":
                parts.append((took_s, wire_s, turnaround_s, own_s))
    took, wire, turnaround, cpu = (statistics.median(column) * 1000 for column in zip(*parts, strict=True))
    good = statistics.median(ratios["station"]) <= GOAL
    over_bare = [s / b for s, b in zip(ratios["station"], ratios["bare"], strict=True)]
    print(f"5  write-back of 12 REAL32 + read-back: {spread(ratios['station'])} × (wire + turnaround), goal ≤ {GOAL}")
    print(
        f"   {'reached' if good else 'BEHIND its goal'}: {took:.1f} ms, of it wire {wire:.1f}, device {turnaround:.1f}"
    )
    print(
        f"   floor: a bare client {spread(ratios['bare'])} ×; the station takes {spread(over_bare)} × as long as that"
    )
    figures.keep(
        *(5, f"write-back of 12 REAL32 + read-back, over {wires.medium().split(' (')[0]}"),
        f"{spread(ratios['station'])} ×, {runs} runs; least disturbed {min(ratios['station']):.3f} ×",
        f"wire {wire:.1f} ms + device {turnaround:.1f} ms; a bare client {spread(ratios['bare'])} ×",
        *(f"<= {GOAL} ×", good),
    )
    if not wires.is_guest():
        print(
            f"   the station's own processor time: {cpu:.2f} ms, {cpu / (wire + turnaround):.1%} of wire and turnaround"
        )
    print(f"   {runs} runs by turns, median [quartiles]; least disturbed run {min(ratios['station']):.3f} ×")


def write_back(station: CanopenDevice) -> None:
    """What the station does with each coefficient."""
    for (index, sub), value in zip(OBJECTS, VALUES, strict=True):
        station.download(index, sub, value)
        assert station.upload(index, sub) == value


def bare_write_back(sock: socket.socket) -> None:
    """The same frames without any check."""
    sock.settimeout(None)
    for (index, sub), value in zip(OBJECTS, VALUES, strict=True):
        for command, data in ((0x23, value), (0x40, bytes(4))):
            sock.send(wires.FRAME.pack(REQUEST, 8, struct.pack("<BHB", command, index, sub) + data))
            sock.recv(16)


def timed(job: Callable[[], None]) -> float:
    """Seconds that a job took."""
    began_s = time.perf_counter()
    job()
    return time.perf_counter() - began_s


def so_far(shown: Connection) -> tuple[float, float]:
    """(wire time, turnaround) of all frames since the last call, s."""
    wire_s = turnaround_s = 0.0
    while shown.poll(0.2):
        wire, turnaround = shown.recv()
        wire_s, turnaround_s = wire_s + wire, turnaround_s + turnaround
    return wire_s, turnaround_s


def carry(near: socket.socket, far: socket.socket, bitrate: int, tells: Connection) -> None:
    """The wire: one frame at a time, each for as long as its bits take; says how long after every answer.

    A frame's time runs from when the kernel took it, so that this process's own waking costs nothing.
    """
    waiting, wire_ns, delivered_ns = select.poll(), 0, 0
    for end in (near, far):
        waiting.register(end, select.POLLIN)
        end.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    while True:
        for descriptor, _ in waiting.poll():
            request = descriptor == near.fileno()
            frame, notes, _, _ = (near if request else far).recvmsg(16, 128)
            can_id, length, data = wires.FRAME.unpack(frame)
            if can_id not in (REQUEST, ANSWER):
                continue  # boot-up, heartbeat: UDP has no filters
            seconds, nanoseconds = struct.unpack("=qq", notes[0][2])
            came_ns, frame_ns = seconds * 10**9 + nanoseconds, bits(can_id, data[:length]) * 10**9 // bitrate
            while time.time_ns() - came_ns < frame_ns:
                pass  # sleeping is too coarse for one frame, and nobody else has anything to do meanwhile
            if request:
                delivered_ns = time.time_ns()  # before the call: the answer may be here when it returns
            (far if request else near).send(frame)
            wire_ns += frame_ns
            if not request:
                tells.send((wire_ns / 1e9, (came_ns - delivered_ns) / 1e9))
                wire_ns = 0


def bits(can_id: int, data: bytes) -> int:
    """Bits of a classic frame with an 11-bit identifier on the wire: stuff bits counted, three of interframe space."""
    body = f"0{can_id:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    crc = 0
    for bit in body:
        crc = (crc << 1 ^ (CRC_POLYNOMIAL if int(bit) ^ crc >> 14 else 0)) & 0x7FFF
    stuffed = run = 0
    last = ""
    for bit in body + f"{crc:015b}":
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:  # a stuff bit of the other value follows, and starts the next run
            stuffed, run, last = stuffed + 1, 1, "1" if bit == "0" else "0"
    return len(body) + 15 + stuffed + UNSTUFFED_TAIL


def spread(values: list[float]) -> str:
    """Median and quartiles."""
    low, middle, high = statistics.quantiles(values, n=4)
    return f"{middle:.3f} [{low:.3f}–{high:.3f}]"


if __name__ == "__main__":
    main()
