"""Our simulated device under a master that nobody here wrote, and as a process of its own under our station."""

import json
import multiprocessing
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from vcan_harness.interface import Interface
from vcan_harness.node import NodeMaster, Refused
from vcan_harness.raw import RawSocket
from vcan_harness.waiting import until

from station.adapters.bus.socketcan import SocketCan
from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.clock import SystemClock
from station.wiring.live_device import LiveDevices, Population

NODE = 5
KEY = bytes.fromhex("3143414c")
DBC = Path(__file__).parents[3] / "dbc"
Master = Callable[[Interface], NodeMaster]
Live = Callable[..., LiveDevices]


@pytest.fixture
def live() -> Iterator[Live]:
    """Starts our device on an interface, in a thread of this process."""
    with ExitStack() as stack:

        def start(interface: Interface, **options: Any) -> LiveDevices:
            wanted = Population("accelerometer", interface.name, (NODE,), ("SN0042",), **options)
            devices, end = LiveDevices.open(wanted), threading.Event()
            thread = threading.Thread(target=devices.live, args=(lambda: not end.is_set(),))
            stack.callback(thread.join, 30)
            stack.callback(end.set)
            thread.start()
            return devices

        yield start


def real32(value: float) -> bytes:
    return struct.pack("<f", value)


def code_of(do: Callable[[], object]) -> int | None:
    with pytest.raises(Refused) as refused:
        do()
    return refused.value.code


def test_the_foreign_master_reads_writes_saves_and_reads_back(vcan: Interface, live: Live, node_master: Master) -> None:
    live(vcan)
    master = node_master(vcan)
    assert [int.from_bytes(master.upload(NODE, 0x1018, s), "little") for s in (1, 2, 3, 4)] == [
        0xCA1B0,
        0xACC,
        0x10000,
        42,
    ]
    assert master.upload(NODE, 0x1008) == b"accelerometer"
    master.download(NODE, 0x2104, 0, KEY)
    values = [1.01, 0.002, 0.0, 0.001, 0.99, -0.001, 0.0, 0.003, 1.0]
    for sub, value in enumerate(values, 1):
        master.download(NODE, 0x2101, sub, real32(value))
    master.download(NODE, 0x1010, 1, b"save")
    master.nmt(NODE, "reset-node")

    def back() -> bool:
        try:
            return master.upload(NODE, 0x1018, 4) == (42).to_bytes(4, "little")
        except Refused:
            return False

    until(back, "the device after its reset")
    assert [master.upload(NODE, 0x2101, sub) for sub in range(1, 10)] == [real32(value) for value in values]


def test_the_foreign_master_transfers_segments_and_blocks(vcan: Interface, live: Live, node_master: Master) -> None:
    live(vcan)
    master = node_master(vcan)
    for length in (5, 7, 8, 200, 1000):
        for block in (False, True):
            data = bytes((7 * i + 1 + block) % 256 for i in range(length))
            master.download(NODE, 0x2120, 0, data, block=block)
            assert master.upload(NODE, 0x2120, block=block) == data
            assert master.upload(NODE, 0x2120, block=not block) == data
    assert master.upload(NODE, 0x1021, block=True) == (DBC / "accelerometer.eds").read_bytes()


def test_the_foreign_master_is_refused_with_the_right_codes(vcan: Interface, live: Live, node_master: Master) -> None:
    live(vcan)
    master = node_master(vcan)

    def refused(index: int, sub: int, data: bytes) -> int | None:
        return code_of(lambda: master.download(NODE, index, sub, data))

    assert refused(0x2101, 1, real32(1.0)) == 0x08000022
    master.download(NODE, 0x2104, 0, KEY)
    assert refused(0x2101, 1, real32(1.6)) == 0x06090031
    assert refused(0x2101, 1, real32(-1.6)) == 0x06090032
    assert refused(0x2101, 1, real32(float("nan"))) == 0x06090030
    assert refused(0x2101, 1, b"\1\2") == 0x06070013
    assert refused(0x2101, 10, real32(1.0)) == 0x06090011
    assert refused(0x2100, 0, bytes(37)) == 0x06070012
    assert refused(0x1018, 4, bytes(4)) == 0x06010002
    assert refused(0x2999, 0, bytes(4)) == 0x06020000
    assert refused(0x1010, 1, b"evas") == 0x08000020
    assert code_of(lambda: master.upload(NODE, 0x2104)) == 0x06010001


def test_boot_up_states_and_readings_are_on_the_wire(
    vcan: Interface, live: Live, node_master: Master, raw_socket: Callable[..., RawSocket]
) -> None:
    wire = raw_socket(vcan)
    live(vcan, rate_hz=50.0)

    def next_of(wanted: int) -> bytes:
        while True:
            can_id, data = wire.receive()
            if can_id == wanted:
                return data

    assert next_of(0x700 + NODE) == b"\x00"
    assert next_of(0x700 + NODE) == b"\x7f"
    master = node_master(vcan)
    master.nmt(NODE, "start")
    counters = [next_of(0x180 + NODE)[1] & 0xF for _ in range(40)]
    assert np.all(np.diff(counters) % 15 == 1)
    assert len(next_of(0x280 + NODE)) == 2
    until(lambda: next_of(0x700 + NODE) == b"\x05", "operational")


class Process:
    """`station device` as a process; its first line is its truth."""

    def __init__(self, interface: Interface, *options: str) -> None:
        command = [sys.executable, "-m", "station", "device", "--channel", interface.name]
        command += ["--node", str(NODE), "--serial", "SN0042", *options]
        root = Path(__file__).parents[3]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=root
        )
        assert self.process.stdout is not None
        self.truth = json.loads(self.process.stdout.readline())["units"]["SN0042"]

    def say(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()


@pytest.fixture
def process() -> Iterator[Callable[..., Process]]:
    """Starts `station device`; killed at the end."""
    with ExitStack() as stack:

        def start(interface: Interface, *options: str) -> Process:
            running = Process(interface, *options)
            stack.callback(running.process.communicate)
            stack.callback(running.process.kill)
            return running

        yield start


@pytest.mark.timeout(300)
def test_a_killed_process_keeps_what_was_saved_and_obeys_its_world(
    vcan: Interface, process: Callable[..., Process], tmp_path: Path
) -> None:
    wanted = Population("accelerometer", vcan.name, (NODE,), ("SN0042",), memory=tmp_path, flash_s=0.05)
    # A fork costs nothing where starting Python takes ten seconds.
    opened = LiveDevices.open(wanted)
    first = multiprocessing.get_context("fork").Process(target=opened.live, args=(lambda: True,))
    first.start()
    opened.live(lambda: False)  # this process leaves the bus to the other
    bus = SocketCan(vcan.name)
    station = CanopenDevice(ServiceNetwork(bus.service(service_ids((NODE,))), SystemClock()), NODE, answer_s=10.0)
    station.download(0x2104, 0, KEY)
    station.download(0x2102, 1, real32(0.125))
    station.download(0x1010, 1, b"save")
    station.download(0x2102, 2, real32(0.25))
    first.kill()
    first.join()
    second = process(vcan, "--memory", str(tmp_path))
    assert [station.upload(0x2102, sub) for sub in (1, 2)] == [real32(0.125), real32(0.0)]
    second.say("true 0 0 -1")
    second.say("temperature 31.25")
    matrix, offset = np.array(second.truth["matrix"]), np.array(second.truth["offset"])
    expected = (matrix @ [0, 0, -1] + offset) / 6.25e-5

    def reading() -> list[int]:
        return [struct.unpack("<h", station.upload(0x2110, axis))[0] for axis in (1, 2, 3)]

    # Noise is 0.0002 of full scale: 6.6 counts; eight of those and a rounding.
    until(lambda: bool(np.all(np.abs(reading() - expected) < 54)), "the world to turn")
    until(lambda: station.upload(0x2112, 0) == struct.pack("<h", 3125), "the temperature")
    second.process.send_signal(signal.SIGINT)
    assert second.process.wait(30) == 0
    bus.close()
