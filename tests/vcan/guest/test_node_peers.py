"""The independent CANopen device and master, against each other and on the wire."""

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
from vcan_harness.interface import Interface
from vcan_harness.node import NodeDevice, NodeMaster, Refused
from vcan_harness.raw import RawSocket
from vcan_harness.waiting import until

Device = Callable[..., NodeDevice]
Master = Callable[[Interface], NodeMaster]

NODE = 5
SAVE, LOAD = b"save", b"load"
KEY = (0x4C414331).to_bytes(4, "little")
BOOT_UP, PRE_OPERATIONAL, OPERATIONAL = 0, 127, 5


def _real32(value: float) -> bytes:
    return struct.pack("<f", value)


def _crc_e2e(data_id: int, frame: bytes) -> int:
    """AUTOSAR E2E profile 1 as a polynomial division by 0x11D, high bit first."""
    remainder = int.from_bytes(data_id.to_bytes(2, "little") + frame[1:] + b"\0", "big")
    for bit in range(remainder.bit_length() - 1, 7, -1):
        if remainder >> bit & 1:
            remainder ^= 0x11D << (bit - 8)
    return remainder


def test_the_device_names_itself(vcan: Interface, node_device: Device, node_master: Master) -> None:
    node_device(vcan, node=NODE, revision=0x10007, serial=42)
    master = node_master(vcan)
    identity = [int.from_bytes(master.upload(NODE, 0x1018, sub), "little") for sub in (1, 2, 3, 4)]
    assert identity == [0xCA1B0, 0xACC, 0x10007, 42]
    assert master.upload(NODE, 0x1000) == (0x20194).to_bytes(4, "little")
    assert master.upload(NODE, 0x1008) == b"accelerometer"  # 13 bytes: segmented
    assert master.upload(NODE, 0x1009) == b"Node"
    assert master.upload(NODE, 0x100A) == b"canopen 6.2.1"


def test_long_values_come_back_as_written(vcan: Interface, node_device: Device, node_master: Master) -> None:
    node_device(vcan, node=NODE)
    master = node_master(vcan)
    for length in (5, 7, 8, 200):
        for block in (False, True):
            data = bytes((7 * i + 1 + block) % 256 for i in range(length))
            master.download(NODE, 0x2120, 0, data, block=block)
            assert master.upload(NODE, 0x2120, block=block) == data
            assert master.upload(NODE, 0x2120, block=not block) == data


def test_refusals_carry_the_right_abort_code(vcan: Interface, node_device: Device, node_master: Master) -> None:
    node_device(vcan, node=NODE)
    master = node_master(vcan)

    def code_of(index: int, sub: int, data: bytes) -> int | None:
        with pytest.raises(Refused) as refused:
            master.download(NODE, index, sub, data)
        return refused.value.code

    assert code_of(0x2101, 1, _real32(1.0)) == 0x08000022  # locked
    assert code_of(0x2104, 0, (0x4321).to_bytes(4, "little")) == 0x08000020
    master.download(NODE, 0x2104, 0, KEY)
    assert code_of(0x2101, 1, _real32(1.6)) == 0x06090031
    assert code_of(0x2101, 1, _real32(-1.6)) == 0x06090032
    assert code_of(0x2101, 1, _real32(float("nan"))) == 0x06090030
    assert code_of(0x2101, 1, b"\x01\x02") == 0x06070010
    assert code_of(0x2101, 10, _real32(1.0)) == 0x06090011
    assert code_of(0x2100, 0, bytes(37)) == 0x06070012
    assert code_of(0x1018, 4, bytes(4)) == 0x06010002
    assert code_of(0x2999, 0, bytes(4)) == 0x06020000
    assert code_of(0x1010, 1, b"evas") == 0x08000020


def test_only_what_is_saved_outlives_the_power(
    vcan: Interface, node_device: Device, node_master: Master, tmp_path: Path
) -> None:
    flash = tmp_path / "flash.json"
    options = {"node": NODE, "flash": str(flash)}
    device, master = node_device(vcan, **options), node_master(vcan)
    master.download(NODE, 0x2104, 0, KEY)
    master.download(NODE, 0x2102, 1, _real32(0.125))
    master.download(NODE, 0x1010, 1, SAVE)
    assert json.loads(flash.read_text())["objects"]["2102:01"] == 0.125
    master.download(NODE, 0x2102, 2, _real32(0.25))
    device.kill()
    device = node_device(vcan, **options)
    assert [master.upload(NODE, 0x2102, sub) for sub in (1, 2)] == [_real32(0.125), _real32(0.0)]
    objects = [(index, sub) for index, count in ((0x2101, 9), (0x2102, 3)) for sub in range(1, count + 1)]
    stored = b"".join(master.upload(NODE, index, sub) for index, sub in objects)
    assert int.from_bytes(master.upload(NODE, 0x2105), "little") == zlib.crc32(stored)
    master.download(NODE, 0x1011, 1, LOAD)
    assert master.upload(NODE, 0x2102, 1) == _real32(0.125)
    master.nmt(NODE, "reset-node")
    device.wait_for("boot-up")
    assert master.upload(NODE, 0x2102, 1) == _real32(0.0)


def test_boot_up_heartbeat_and_states_are_on_the_wire(
    vcan: Interface, raw_socket: Callable[..., RawSocket], node_device: Device, node_master: Master
) -> None:
    wire = raw_socket(vcan)
    node_device(vcan, node=NODE, heartbeat_ms=100)
    master = node_master(vcan)

    def next_state() -> int:
        while True:
            can_id, data = wire.receive()
            if can_id == 0x700 + NODE:
                return data[0]

    assert [next_state(), next_state()] == [BOOT_UP, PRE_OPERATIONAL]
    master.nmt(NODE, "start")
    until(lambda: next_state() == OPERATIONAL, "operational")
    master.nmt(NODE, "reset-node")
    until(lambda: next_state() == BOOT_UP, "boot-up")
    assert next_state() == PRE_OPERATIONAL


def test_the_stream_is_protected_and_corrected(
    vcan: Interface, raw_socket: Callable[..., RawSocket], node_device: Device, node_master: Master
) -> None:
    wire = raw_socket(vcan)
    # A quarter too much gain on z, and x sees half of it: measured = A · true + b.
    matrix, offset = [1.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 1.25], [0.0625, -0.125, 0.25]
    device, master = node_device(vcan, node=NODE, noise_g=0.0, matrix=matrix, offset_g=offset), node_master(vcan)
    device.turn([0.0, 0.0, -1.0])
    device.warm(31.25)

    def frames(can_id: int, count: int) -> list[bytes]:
        found: list[bytes] = []
        while len(found) < count:
            received, data = wire.receive()
            found += [data] if received == can_id else []
        return found

    master.nmt(NODE, "start")
    raw = frames(0x180 + NODE, 20)
    assert [_crc_e2e(0x1A00 + NODE, frame) for frame in raw] == [frame[0] for frame in raw]
    assert [frame[1] & 0x0F for frame in raw] == [i % 15 for i in range(20)]
    assert {frame[1] >> 4 for frame in raw} == {0}
    assert {struct.unpack("<3h", frame[2:]) for frame in raw} == {(-7000, -2000, -16000)}
    master.download(NODE, 0x2104, 0, KEY)
    for index, values in ((0x2101, matrix), (0x2102, offset)):
        for sub, value in enumerate(values, 1):
            master.download(NODE, index, sub, _real32(value))
    master.download(NODE, 0x2107, 0, b"\x01")
    wire.waiting()
    corrected = frames(0x180 + NODE, 2)[-1]
    assert struct.unpack("<3h", corrected[2:]) == (0, 0, -16000)
    assert corrected[1] >> 4 == 4
    master.download(NODE, 0x2106, 0, b"\x00")
    wire.waiting()
    assert frames(0x180 + NODE, 2)[-1][1] >> 4 == 0
    master.download(NODE, 0x1800, 5, (0).to_bytes(2, "little"))
    wire.waiting()
    assert {can_id for can_id, _ in [wire.receive() for _ in range(3)]} <= {0x280 + NODE, 0x700 + NODE}
    assert frames(0x280 + NODE, 1) == [struct.pack("<h", 3125)]


def test_faults_on_demand(
    vcan: Interface, raw_socket: Callable[..., RawSocket], node_device: Device, node_master: Master
) -> None:
    wire = raw_socket(vcan)
    device, master = node_device(vcan, node=NODE, heartbeat_ms=0), node_master(vcan)
    device.fault(refuse={0x2102: 0x06090030})
    with pytest.raises(Refused) as refused:
        master.download(NODE, 0x2102, 1, _real32(0.1))
    assert refused.value.code == 0x06090030
    wire.waiting()
    device.fault(twice=True)
    wire.send(0x600 + NODE, bytes.fromhex("4018100400000000"))
    assert wire.receive() == wire.receive()
    device.fault(silent=True)
    wire.send(0x600 + NODE, bytes.fromhex("4018100400000000"))
    device.reboot()
    assert wire.receive() == (0x700 + NODE, b"\x00")
