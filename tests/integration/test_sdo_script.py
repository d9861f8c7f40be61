"""The strict SDO client against scripts of frames: what it sends, what it takes, and what it does not."""

from binascii import crc_hqx
from collections.abc import Callable, Iterator

import pytest

from station.adapters.canopen.network import ServiceNetwork
from station.adapters.canopen.sdo_client import SdoClient
from station.domain.core.types import Frames
from station.domain.product.sdo_codes import ABORT
from station.errors import BusFault, DeviceRefused, DeviceSilent
from station.messages import Message, render
from tests.fakes.scripted_channel import Line, ScriptedChannel

NODE = 5
Start = Callable[..., SdoClient]


@pytest.fixture
def start() -> Iterator[Start]:
    """Makes a client on a script; at the end every line must have been played."""
    channels = []

    def make(*script: Line, **options: float) -> SdoClient:
        channel = ScriptedChannel(NODE, *script)
        channels.append(channel)
        return SdoClient(ServiceNetwork(channel, channel), NODE, options.get("answer_s", 0.3))

    yield make
    for channel in channels:
        channel.close()


# ---- expedited and segmented ----


@pytest.mark.parametrize(
    ("answer", "data"),
    [
        ("4f 00 10 00 07 00 00 00", "07"),
        ("4b 00 10 00 07 08 00 00", "07 08"),
        ("47 00 10 00 07 08 09 00", "07 08 09"),
        ("43 00 10 00 07 08 09 0a", "07 08 09 0a"),
        ("42 00 10 00 07 08 09 0a", "07 08 09 0a"),  # size not said: four bytes
    ],
)
def test_expedited_upload(start: Start, answer: str, data: str) -> None:
    sdo = start(("40 00 10 00 00 00 00 00", [answer]))
    assert sdo.upload(0x1000, 0) == bytes.fromhex(data)


def test_a_value_whose_size_is_not_said_is_as_long_as_its_object() -> None:
    """CiA 301 lets a device leave the size out: what is read must then equal what was written, a byte or two long."""
    unsaid = [
        ("40 06 21 00 00 00 00 00", ["42 06 21 00 01 00 00 00"]),
        ("40 00 18 05 00 00 00 00", ["42 00 18 05 0a 00 00 00"]),
        ("40 01 1a 00 00 00 00 00", ["42 01 1a 00 05 00 00 00"]),
    ]
    channel = ScriptedChannel(NODE, *unsaid)
    sdo = SdoClient(ServiceNetwork(channel, channel), NODE, sizes={(0x2106, 0): 1})
    found = [sdo.upload(index, sub).hex() for index, sub in ((0x2106, 0), (0x1800, 5), (0x1A01, 0))]
    assert found == ["01", "0a00", "05"]
    channel.close()


@pytest.mark.parametrize(
    ("data", "request_"),
    [
        ("07", "2f 01 21 02 07 00 00 00"),
        ("07 08", "2b 01 21 02 07 08 00 00"),
        ("07 08 09", "27 01 21 02 07 08 09 00"),
        ("07 08 09 0a", "23 01 21 02 07 08 09 0a"),
    ],
)
def test_expedited_download(start: Start, data: str, request_: str) -> None:
    sdo = start((request_, ["60 01 21 02 00 00 00 00"]))
    sdo.download(0x2101, 2, bytes.fromhex(data))


def test_segmented_upload(start: Start) -> None:
    sdo = start(
        ("40 08 10 00 00 00 00 00", ["41 08 10 00 09 00 00 00"]),
        ("60 00 00 00 00 00 00 00", ["00 61 62 63 64 65 66 67"]),
        ("70 00 00 00 00 00 00 00", ["1b 68 69 00 00 00 00 00"]),
    )
    assert sdo.upload(0x1008, 0) == b"abcdefghi"


def test_segmented_upload_of_unsaid_size_and_of_nothing(start: Start) -> None:
    sdo = start(
        ("40 08 10 00 00 00 00 00", ["40 08 10 00 00 00 00 00"]),
        ("60 00 00 00 00 00 00 00", ["01 61 62 63 64 65 66 67"]),
        ("40 09 10 00 00 00 00 00", ["41 09 10 00 00 00 00 00"]),
        ("60 00 00 00 00 00 00 00", ["0f 00 00 00 00 00 00 00"]),
    )
    assert sdo.upload(0x1008, 0) == b"abcdefg"
    assert sdo.upload(0x1009, 0) == b""


def test_segmented_download(start: Start) -> None:
    sdo = start(
        ("21 00 21 00 09 00 00 00", ["60 00 21 00 00 00 00 00"]),
        ("00 61 62 63 64 65 66 67", ["20 00 00 00 00 00 00 00"]),
        ("1b 68 69 00 00 00 00 00", ["30 00 00 00 00 00 00 00"]),
    )
    sdo.download(0x2100, 0, b"abcdefghi")


def test_a_value_longer_or_shorter_than_announced_is_no_value(start: Start) -> None:
    sdo = start(
        ("40 08 10 00 00 00 00 00", ["41 08 10 00 05 00 00 00"]),
        ("60 00 00 00 00 00 00 00", ["01 61 62 63 64 65 66 67"]),
        ("80 08 10 00 12 00 07 06", []),
        ("40 08 10 00 00 00 00 00", ["41 08 10 00 09 00 00 00"]),
        ("60 00 00 00 00 00 00 00", ["01 61 62 63 64 65 66 67"]),
        ("80 08 10 00 13 00 07 06", []),
    )
    for code in (0x06070012, 0x06070013):
        with pytest.raises(DeviceRefused) as caught:
            sdo.upload(0x1008, 0)
        assert caught.value.code == code


# ---- block ----


def crc(data: bytes) -> str:
    return crc_hqx(data, 0).to_bytes(2, "little").hex(" ")


def test_the_crc_is_that_of_the_standard() -> None:
    assert crc_hqx(b"123456789", 0) == 0x31C3  # CiA 301, 7.2.4.3.16: check value of CRC-16/XMODEM


def test_segments_of_nothing_for_ever_come_to_an_end(start: Start) -> None:
    sdo = start(
        ("40 08 10 00 00 00 00 00", ["40 08 10 00 00 00 00 00"]),
        ("60 00 00 00 00 00 00 00", ["0e 00 00 00 00 00 00 00"]),
        ("80 08 10 00 13 00 07 06", []),
    )
    with pytest.raises(DeviceRefused):
        sdo.upload(0x1008, 0)


def test_block_download_repairs_what_was_lost_in_the_last_block(start: Start) -> None:
    data = bytes(range(256)) + bytes(145)  # 401 bytes, 58 segments
    segments = [data[i : i + 7].ljust(7, b"\0").hex(" ") for i in range(0, 401, 7)]
    start_line: Line = ("c6 20 21 00 91 01 00 00", ["a4 20 21 00 28 00 00 00"])  # blocks of 40
    first: list[Line] = [(f"{n:02x} {s}", []) for n, s in enumerate(segments[:40], 1)]
    first[-1] = (first[-1][0] or "", ["a2 28 28 00 00 00 00 00"])
    last = [(n, s) for n, s in enumerate(segments[40:], 1)]
    second: list[Line] = [(f"{n | (0x80 if n == 18 else 0):02x} {s}", []) for n, s in last]
    second[-1] = (second[-1][0] or "", ["a2 0f 7f 00 00 00 00 00"])  # only 15 of 18 came
    third: list[Line] = [(f"{n | (0x80 if n == 3 else 0):02x} {s}", []) for n, (_, s) in enumerate(last[15:], 1)]
    third[-1] = (third[-1][0] or "", ["a2 03 7f 00 00 00 00 00"])
    end: Line = (f"d5 {crc(data)} 00 00 00 00 00", ["a1 00 00 00 00 00 00 00"])
    start(start_line, *first, *second, *third, end).download(0x2120, 0, data)


def test_a_server_without_blocks_gets_segments(start: Start) -> None:
    data = bytes(401)
    segments: list[Line] = []
    for n in range(58):
        toggle, unused, last = (n % 2) << 4, (5 if n == 57 else 0) << 1, int(n == 57)
        segments.append((f"{toggle | unused | last:02x} " + " ".join(["00"] * 7), [f"{0x20 | toggle:02x}" + " 00" * 7]))
    initiate: Line = ("21 20 21 00 91 01 00 00", ["60 20 21 00 00 00 00 00"])
    sdo = start(("c6 20 21 00 91 01 00 00", ["80 20 21 00 01 00 04 05"]), initiate, *segments, initiate, *segments)
    sdo.download(0x2120, 0, data)
    sdo.download(0x2120, 0, data)  # it is not asked for blocks again


# ---- answers that do not belong ----

ABORT_A = "80 01 21 01 00 00 04 05"
WRITE_A, WRITE_B = "23 01 21 01 00 00 80 3f", "23 01 21 02 00 00 80 3f"
DONE_A, DONE_B = "60 01 21 01 00 00 00 00", "60 01 21 02 00 00 00 00"
FENCE: Line = ("40 00 10 00 00 00 00 00", ["43 00 10 00 94 01 02 00"])
ONE = bytes.fromhex("00 00 80 3f")


def test_a_late_confirmation_of_another_write_does_not_confirm_a_refused_one(start: Start) -> None:
    """The first failure of the common client: A's confirmation, 0.45 s late, is taken for B's."""
    sdo = start(
        (WRITE_A, [(0.45, DONE_A)]),
        (ABORT_A, []),
        FENCE,
        (WRITE_B, ["80 01 21 02 30 00 09 06"]),
    )
    with pytest.raises(DeviceSilent, match=r"Write to 0x2101:01 of node 5 timed out after 0\.3 s"):
        sdo.download(0x2101, 1, ONE)
    with pytest.raises(DeviceRefused) as caught:
        sdo.download(0x2101, 2, ONE)
    assert caught.value.code == 0x06090030
    assert sdo.dropped == 1


def test_a_confirmation_later_than_the_quarantine_does_not_confirm_either(start: Start) -> None:
    """Even the server that takes longer than the quarantine cannot fool it: it answers the fence after A."""
    sdo = start(
        (WRITE_A, [(0.85, DONE_A)]),
        (ABORT_A, []),
        ("40 00 10 00 00 00 00 00", [(0.28, "43 00 10 00 94 01 02 00")]),
        (WRITE_B, ["80 01 21 02 30 00 09 06"]),
    )
    with pytest.raises(DeviceSilent):
        sdo.download(0x2101, 1, ONE)
    with pytest.raises(DeviceRefused):
        sdo.download(0x2101, 2, ONE)


def test_a_confirmation_of_another_object_is_none(start: Start) -> None:
    """The second failure: a confirmation of 0x9999:09 is taken for that of 0x2000:00."""
    sdo = start(
        ("2f 00 20 00 01 00 00 00", ["60 99 99 09 00 00 00 00"]),
        ("80 00 20 00 00 00 04 05", []),
    )
    with pytest.raises(DeviceSilent, match="1 answer came that does not fit the request"):
        sdo.download(0x2000, 0, b"\1")


@pytest.mark.parametrize(
    "stray",
    [
        "80 01 21 01 30 00 09 06",  # an abort for another object
        "60 01 21 02 00 00 00 00",  # a confirmation of a write
        "43 01 21 01 00 00 80 3f",  # the value of another object
        "00 00 00 80 3f",  # too short
        "c6 01 21 02 00 00 00 00",  # the answer to a block request
    ],
)
def test_strays_before_the_answer_are_dropped_and_counted(start: Start, stray: str) -> None:
    sdo = start(("40 01 21 02 00 00 00 00", [stray, "43 01 21 02 00 00 80 3f"]))
    assert sdo.upload(0x2101, 2) == ONE
    assert sdo.dropped == 1


def test_what_waited_before_the_request_is_dropped(start: Start) -> None:
    channel = ScriptedChannel(NODE, ("40 01 21 02 00 00 00 00", ["43 01 21 02 00 00 80 3f"]))
    sdo = SdoClient(ServiceNetwork(channel, channel), NODE, 0.3)
    channel.come(0.0, 0x580 + NODE, bytes.fromhex("43 01 21 02 00 00 00 00"))
    assert sdo.upload(0x2101, 2) == ONE
    channel.close()


def test_an_abort_for_no_object_in_particular_counts(start: Start) -> None:
    sdo = start((WRITE_A, ["80 00 00 00 22 00 00 08"]))
    with pytest.raises(DeviceRefused, match="the device's present state forbids it"):
        sdo.download(0x2101, 1, ONE)


def test_a_segment_with_the_wrong_toggle_is_dropped(start: Start) -> None:
    sdo = start(
        ("40 08 10 00 00 00 00 00", ["41 08 10 00 09 00 00 00"]),
        ("60 00 00 00 00 00 00 00", ["10 61 62 63 64 65 66 67"]),
        ("80 08 10 00 00 00 04 05", []),
    )
    with pytest.raises(DeviceSilent, match="1 answer came"):
        sdo.upload(0x1008, 0)


@pytest.mark.parametrize("code", ABORT)
def test_every_abort_code_comes_through_in_every_kind_of_transfer(start: Start, code: int) -> None:
    abort = code.to_bytes(4, "little").hex(" ")
    sdo = start(
        (WRITE_A, [f"80 01 21 01 {abort}"]),
        ("40 01 21 01 00 00 00 00", [f"80 01 21 01 {abort}"]),
        ("21 00 21 00 09 00 00 00", ["60 00 21 00 00 00 00 00"]),
        ("00 61 62 63 64 65 66 67", [f"80 00 21 00 {abort}"]),
    )
    for transfer in (
        lambda: sdo.download(0x2101, 1, ONE),
        lambda: sdo.upload(0x2101, 1),
        lambda: sdo.download(0x2100, 0, b"abcdefghi"),
    ):
        with pytest.raises(DeviceRefused) as caught:
            transfer()
        assert caught.value.code == code
        assert render(Message(ABORT[code])) in caught.value.sentence


# ---- after a time-out ----


def test_a_write_that_timed_out_is_not_repeated_and_must_be_read_first(start: Start) -> None:
    sdo = start(
        (WRITE_A, []),
        (ABORT_A, []),
        FENCE,
        ("40 01 21 01 00 00 00 00", ["43 01 21 01 00 00 80 3f"]),
        (WRITE_A, [DONE_A]),
    )
    with pytest.raises(DeviceSilent):
        sdo.download(0x2101, 1, ONE)
    with pytest.raises(DeviceSilent, match="was not answered: read the object before"):
        sdo.download(0x2101, 1, ONE)
    assert sdo.upload(0x2101, 1) == ONE
    sdo.download(0x2101, 1, ONE)


def test_a_save_that_timed_out_is_not_aborted(start: Start) -> None:
    sdo = start(
        ("23 10 10 01 73 61 76 65", [(1.0, "60 10 10 01 00 00 00 00")]),
        FENCE,
        ("40 10 10 01 00 00 00 00", ["43 10 10 01 01 00 00 00"]),
    )
    with pytest.raises(DeviceSilent, match=r"timed out after 0\.5 s"):
        sdo.download(0x1010, 1, b"save", 0.5)
    assert sdo.upload(0x1010, 1) == b"\1\0\0\0"


def test_the_fence_is_another_object_than_the_one_that_timed_out(start: Start) -> None:
    sdo = start(
        ("40 00 10 00 00 00 00 00", []),
        ("80 00 10 00 00 00 04 05", []),
        ("40 01 10 00 00 00 00 00", ["4f 01 10 00 00 00 00 00"]),
        ("40 00 10 00 00 00 00 00", ["43 00 10 00 94 01 02 00"]),
    )
    with pytest.raises(DeviceSilent):
        sdo.upload(0x1000, 0)
    assert len(sdo.upload(0x1000, 0)) == 4


def test_a_device_that_stays_silent_is_silent_again_and_stays_in_quarantine(start: Start) -> None:
    lost: list[Line] = [("40 00 10 00 00 00 00 00", []), ("80 00 10 00 00 00 04 05", [])]
    other: list[Line] = [("40 01 10 00 00 00 00 00", []), ("80 01 10 00 00 00 04 05", [])]
    sdo = start((WRITE_A, []), (ABORT_A, []), *lost, *other)
    with pytest.raises(DeviceSilent):
        sdo.download(0x2101, 1, ONE)
    for _ in range(2):
        with pytest.raises(DeviceSilent):
            sdo.upload(0x2101, 2)


def test_objects_have_time_outs_of_their_own() -> None:
    channel = ScriptedChannel(NODE, ("40 01 21 02 00 00 00 00", []), ("80 01 21 02 00 00 04 05", []))
    sdo = SdoClient(ServiceNetwork(channel, channel), NODE, 0.3, {(0x2101, 2): 2.0})
    began_s = channel.monotonic_s()
    with pytest.raises(DeviceSilent, match="timed out after 2 s"):
        sdo.upload(0x2101, 2)
    assert channel.monotonic_s() - began_s == pytest.approx(2.0)
    channel.close()


# ---- two devices ----


def test_two_devices_with_one_node_id_are_noticed(start: Start) -> None:
    twice = ["4f 00 20 00 07 00 00 00"] * 2
    request = "40 00 20 00 00 00 00 00"
    sdo = start((request, twice), (request, twice))
    assert sdo.upload(0x2000, 0) == b"\7"  # one repeated frame may be the bus's own doing
    assert sdo.upload(0x2000, 0) == b"\7"
    with pytest.raises(BusFault, match="two devices share this node id"):
        sdo.upload(0x2000, 0)


def test_a_second_device_that_is_three_requests_behind_is_noticed(start: Start) -> None:
    def read(sub: int, *late: int) -> Line:
        shown = [f"4f 00 20 {s:02x} 07 00 00 00" for s in (*late, sub)]
        return f"40 00 20 {sub:02x} 00 00 00 00", shown

    sdo = start(read(1), read(2), read(3), read(4, 1), read(5, 2))
    for sub in range(1, 5):
        assert sdo.upload(0x2000, sub) == b"\7"
    with pytest.raises(BusFault, match="two devices share this node id"):
        sdo.upload(0x2000, 5)


def test_one_repeated_frame_is_forgiven(start: Start) -> None:
    request, answer = "40 00 20 00 00 00 00 00", "4f 00 20 00 07 00 00 00"
    sdo = start(
        (request, [answer, answer]), *[(request, [answer])] * 2, (request, [answer, answer]), (request, [answer])
    )
    for _ in range(5):
        assert sdo.upload(0x2000, 0) == b"\7"


def test_a_flood_of_strays_does_not_outlast_the_deadline() -> None:
    channel = Flood(NODE)
    sdo = SdoClient(ServiceNetwork(channel, channel), NODE, 0.3)
    with pytest.raises(DeviceSilent, match="to another one, or have a wrong toggle bit"):
        sdo.upload(0x2000, 0)
    assert 0.3 <= channel.monotonic_s() - 100.0 < 0.4


class Flood(ScriptedChannel):
    """A node that sends an answer to nobody every millisecond, for ever; looking at the clock takes time too."""

    def send(self, can_id: int, data: bytes) -> None:
        """Anything."""

    def receive(self, timeout_s: float) -> Frames:
        """Hundred at once, so that there is always one waiting."""
        for _ in range(100):
            self.come(0.0, 0x580 + NODE, bytes.fromhex("60 99 99 09 00 00 00 00"))
        return super().receive(timeout_s)

    def monotonic_s(self) -> float:
        """Each look costs 0.1 ms."""
        self.sleep(0.0001)
        return super().monotonic_s()


def test_a_value_that_comes_in_drops_without_end_is_given_up(start: Start) -> None:
    drops = [(f"{0x60 | i % 2 << 4:02x}" + " 00" * 7, [(0.29, f"{i % 2 << 4:02x}" + " 61" * 7)]) for i in range(11)]
    sdo = start(("40 08 10 00 00 00 00 00", ["40 08 10 00 00 00 00 00"]), *drops, ("80 08 10 00 00 00 04 05", []))
    with pytest.raises(DeviceRefused, match="was not over after 3 s and was aborted"):
        sdo.upload(0x1008, 0)
