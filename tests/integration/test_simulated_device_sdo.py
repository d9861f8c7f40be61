"""The simulated device as an SDO server, frame by frame, and seen by a client that is not ours."""

import struct
from collections.abc import Callable

import canopen
import pytest

from tests.fakes.device_rig import DBC, DeviceRig

Rig = Callable[..., DeviceRig]


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("40 00 10 00 00 00 00 00", "43 00 10 00 94 01 02 00"),
        ("40 18 10 04 00 00 00 00", "43 18 10 04 2a 00 00 00"),
        ("40 06 21 00 00 00 00 00", "4f 06 21 00 01 00 00 00"),
        ("2b 17 10 00 e8 03 00 00", "60 17 10 00 00 00 00 00"),
        ("22 17 10 00 e8 03 00 00", "60 17 10 00 00 00 00 00"),  # size not said: as many bytes as the object has
    ],
)
def test_what_is_right_is_answered(rig: Rig, request_: str, answer: str) -> None:
    assert rig().query(request_) == [answer]


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("40 34 12 00 00 00 00 00", 0x06020000),  # no such object
        ("23 34 12 00 00 00 00 00", 0x06020000),
        ("40 18 10 05 00 00 00 00", 0x06090011),  # no such sub-index
        ("23 00 10 00 00 00 00 00", 0x06010002),  # read only
        ("23 18 10 04 00 00 00 00", 0x06010002),
        ("40 04 21 00 00 00 00 00", 0x06010001),  # write only
        ("23 17 10 00 e8 03 00 00", 0x06070012),  # four bytes for two
        ("2f 17 10 00 e8 00 00 00", 0x06070013),  # one byte for two
        ("21 00 21 00 25 00 00 00", 0x08000022),  # locked
        ("23 01 21 01 00 00 80 3f", 0x08000022),
        ("2f 07 21 00 01 00 00 00", 0x08000022),
        ("2f 06 21 00 02 00 00 00", 0x06090031),  # too high
        ("23 10 10 01 73 61 76 66", 0x08000020),  # not the signature
        ("23 11 10 01 73 61 76 65", 0x08000020),  # the other one's
        ("23 00 18 01 86 01 00 00", 0x06090030),  # a COB-ID keeps its identifier
        ("2f 00 18 02 f5 00 00 00", 0x06090030),  # reserved transmission type
        ("60 00 00 00 00 00 00 00", 0x05040001),  # a segment of no transfer
        ("e0 00 10 00 00 00 00 00", 0x05040001),  # no such command
        ("a0 21 10 00 80 00 00 00", 0x05040002),  # block of 128
        ("a0 21 10 00 00 00 00 00", 0x05040002),
    ],
)
def test_what_is_wrong_is_refused_with_its_code(rig: Rig, request_: str, code: int) -> None:
    (answer,) = rig().query(request_)
    assert answer.startswith("80 ")
    assert int.from_bytes(bytes.fromhex(answer)[4:], "little") == code


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (struct.pack("<f", 1.51), 0x06090031),
        (struct.pack("<f", -1.51), 0x06090032),
        (struct.pack("<f", float("nan")), 0x06090030),
        (struct.pack("<f", float("inf")), 0x06090030),
    ],
)
def test_coefficients_beyond_their_limits_are_refused(rig: Rig, value: bytes, code: int) -> None:
    device = rig()
    device.unlock()
    (answer,) = device.query("23 01 21 01 " + value.hex(" "))
    assert int.from_bytes(bytes.fromhex(answer)[4:], "little") == code
    assert device.station.upload(0x2101, 1) == struct.pack("<f", 1.0)


def test_a_wrong_key_locks_again(rig: Rig) -> None:
    device = rig()
    device.unlock()
    assert device.query("23 01 21 01 00 00 80 3f") == ["60 01 21 01 00 00 00 00"]
    device.query("23 04 21 00 00 00 00 00")
    assert device.query("23 01 21 01 00 00 80 3f") == ["80 01 21 01 22 00 00 08"]


def test_toggle_and_length_of_segments_are_checked(rig: Rig) -> None:
    device = rig()
    device.unlock()
    device.query("21 00 21 00 09 00 00 00")
    assert device.query("10 61 62 63 64 65 66 67") == ["80 00 21 00 00 00 03 05"]  # toggle
    device.query("21 00 21 00 09 00 00 00")
    device.query("00 61 62 63 64 65 66 67")
    assert device.query("10 61 62 63 64 65 66 67") == ["80 00 21 00 12 00 07 06"]  # more than announced
    device.query("21 00 21 00 09 00 00 00")
    assert device.query("01 61 62 63 64 65 66 67") == ["80 00 21 00 13 00 07 06"]  # less than announced
    assert device.query("21 00 21 00 25 00 00 00") == ["80 00 21 00 12 00 07 06"]  # longer than the object
    device.query("40 08 10 00 00 00 00 00")
    assert device.query("70 00 00 00 00 00 00 00") == ["80 08 10 00 00 00 03 05"]
    device.query("40 08 10 00 00 00 00 00")
    assert device.query("00 00 00 00 00 00 00 00") == ["80 08 10 00 01 00 04 05"]


def test_an_abort_ends_a_transfer_and_a_new_one_replaces_it(rig: Rig) -> None:
    device = rig()
    device.query("40 08 10 00 00 00 00 00")
    assert device.query("80 08 10 00 00 00 04 05") == []
    assert device.query("60 00 00 00 00 00 00 00") == ["80 08 10 00 01 00 04 05"]
    device.query("40 08 10 00 00 00 00 00")
    assert device.query("40 00 10 00 00 00 00 00") == ["43 00 10 00 94 01 02 00"]


def test_blocks_are_sent_again_and_checked(rig: Rig) -> None:
    device = rig()
    assert device.query("a4 08 10 00 01 00 00 00") == ["c6 08 10 00 0d 00 00 00"]  # blocks of one segment
    assert device.query("a3 00 00 00 00 00 00 00") == ["01 61 63 63 65 6c 65 72"]
    assert device.query("a2 00 02 00 00 00 00 00") == ["01 61 63 63 65 6c 65 72", "82 6f 6d 65 74 65 72 00"]
    (end,) = device.query("a2 02 02 00 00 00 00 00")
    assert end.startswith("c5 ")
    assert device.query("a1 00 00 00 00 00 00 00") == []
    device.query("c6 20 21 00 07 00 00 00")
    assert device.query("81 61 62 63 64 65 66 67") == ["a2 01 7f 00 00 00 00 00"]
    assert device.query("c1 00 00 00 00 00 00 00") == ["80 20 21 00 04 00 04 05"]  # CRC
    assert device.query("40 20 21 00 00 00 00 00") == ["41 20 21 00 00 00 00 00"]  # nothing was taken
    device.query("a4 08 10 00 7f 00 00 00")
    device.query("a3 00 00 00 00 00 00 00")
    assert device.query("a2 03 7f 00 00 00 00 00") == ["80 08 10 00 03 00 04 05"]  # more than were sent


def test_what_is_too_short_for_a_request_is_not_answered(rig: Rig) -> None:
    assert rig().query("40 00 10 00") == []


def test_a_stopped_device_does_not_answer(rig: Rig) -> None:
    device = rig()
    device.station.nmt("stop")
    assert device.query("40 00 10 00 00 00 00 00") == []
    device.station.nmt("pre-operational")
    assert device.query("40 00 10 00 00 00 00 00") != []


# ---- python canopen as a second opinion ----


class _PumpedBus:
    """What `canopen` takes for a bus: after each frame sent, simulated time runs until nothing more comes."""

    channel_info = "pumped"

    def __init__(self, rig: DeviceRig) -> None:
        self._rig = rig
        self.network: canopen.Network | None = None

    def send(self, message: object, timeout: float | None = None) -> None:
        self._rig.raw.receive(0.0)
        self._rig.raw.send(message.arbitration_id, bytes(message.data))  # type: ignore[attr-defined]
        self._rig.clock.sleep(0.01)
        assert self.network is not None
        for can_id, data in self._rig.heard():
            self.network.notify(can_id, bytearray.fromhex(data), 0.0)


@pytest.fixture
def node(rig: Rig) -> canopen.RemoteNode:
    pumped = _PumpedBus(rig())
    pumped.network = canopen.Network(pumped)  # type: ignore[arg-type]
    remote = canopen.RemoteNode(5, str(DBC / "accelerometer.eds"))
    pumped.network.add_node(remote)
    return remote


def test_canopen_reads_and_writes_our_device(node: canopen.RemoteNode) -> None:
    assert node.sdo[0x1000].raw == 0x20194
    assert node.sdo["Identity object"]["Serial number"].raw == 42
    assert node.sdo[0x1008].raw == "accelerometer"
    node.sdo[0x2104].raw = 0x4C414331
    for sub, value in enumerate([1.01, 0.002, 0, 0.001, 0.99, -0.001, 0, 0.003, 1.0], 1):
        node.sdo[0x2101][sub].raw = value
        assert node.sdo[0x2101][sub].raw == struct.unpack("<f", struct.pack("<f", value))[0]
    node.sdo[0x2100].raw = "3f2c9a52-7a3e-4f0e-8a35-5f2c1a9f0b11"  # 36 characters: segmented
    assert node.sdo[0x2100].raw == "3f2c9a52-7a3e-4f0e-8a35-5f2c1a9f0b11"


@pytest.mark.parametrize("size", [1, 7, 8, 890, 4096])
def test_canopen_transfers_blocks_with_our_device(node: canopen.RemoteNode, size: int) -> None:
    data = bytes(i * 7 % 256 for i in range(size))
    with node.sdo[0x2120].open("wb", size=size, block_transfer=True, buffering=0) as stream:
        for at in range(0, size, 7):
            stream.write(data[at : at + 7])
    with node.sdo[0x2120].open("rb", block_transfer=True) as stream:
        assert stream.read() == data
    assert node.sdo.upload(0x2120, 0) == data


def test_canopen_finds_the_eds_in_the_device(node: canopen.RemoteNode) -> None:
    with node.sdo.open(0x1021, 0, "rb", block_transfer=True) as stream:
        assert stream.read() == (DBC / "accelerometer.eds").read_bytes()


@pytest.mark.parametrize(
    ("index", "sub", "data", "code"),
    [
        (0x2106, 0, b"\x02", 0x06090031),
        (0x1018, 1, bytes(4), 0x06010002),
        (0x1234, 0, bytes(4), 0x06020000),
        (0x2101, 10, bytes(4), 0x06090011),
        (0x1017, 0, bytes(4), 0x06070012),
    ],
)
def test_canopen_sees_the_abort_codes(node: canopen.RemoteNode, index: int, sub: int, data: bytes, code: int) -> None:
    with pytest.raises(canopen.SdoAbortedError) as caught:
        node.sdo.download(index, sub, data)
    assert caught.value.code == code
