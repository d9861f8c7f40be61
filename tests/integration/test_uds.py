"""UDS byte by byte: what the station sends and takes, and what udsoncan's own client says of the simulated device."""

import logging
from collections.abc import Callable
from typing import Any

import pytest
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import BaseConnection

from station.adapters.canopen import eds
from station.adapters.canopen.network import ServiceNetwork
from station.adapters.object_access.client import ObjectClient
from station.adapters.object_access.isotp_transport import IsoTpTransport
from station.adapters.object_access.uds import UdsProtocol, uds_written
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.simulated_device.objects import SimulatedObjects
from station.adapters.simulated_device.uds_server import UdsServer
from station.config.products import load_product
from station.config.search_path import shipped_folder
from station.domain.product.access import UdsAccess, UdsSecurity
from station.errors import BusFault, DeviceRefused, DeviceSilent
from tests.fakes.scripted_channel import Line, ScriptedChannel

IDS = (0x741, 0x761)
SESSION: Line = ("02 10 03", ["06 50 03 00 32 01 f4"])


def key_of(level: int, seed: bytes) -> bytes:
    """A maker's secret, for these tests."""
    return bytes((byte + level) & 0xFF ^ 0x5A for byte in seed)


def client(*script: Line, **options: Any) -> tuple[ObjectClient, ScriptedChannel]:
    channel = ScriptedChannel(1, *script, ids=IDS)
    network = ServiceNetwork(channel, channel)
    protocol = UdsProtocol(**options)
    return ObjectClient(network, 1, protocol, IsoTpTransport(network, *IDS), 0.3), channel


def test_a_value_is_read_and_another_identifiers_answer_dropped() -> None:
    uds, channel = client(("03 22 f1 8c", ["06 62 f1 8d 00 00 07", "06 62 f1 8c 00 00 2a"]))
    assert uds.upload(0xF18C, 0).hex() == "00002a"
    channel.close()


def test_a_number_is_turned_round_and_a_text_is_not() -> None:
    uds, _ = client(
        ("03 22 30 21", ["07 62 30 21 3f 80 00 00"]),
        ("03 22 30 00", ["05 62 30 00 61 62"]),
        numbers=frozenset({(0x3020, 1)}),
    )
    assert uds.upload(0x3020, 1).hex() == "0000803f"
    assert uds.upload(0x3000, 0) == b"ab"


def test_a_long_write_goes_in_several_frames_as_the_device_wants_them() -> None:
    text = b"0123456789"
    uds, channel = client(
        SESSION,
        ("10 0d 2e 30 00 30 31 32", ["30 00 00"]),
        ("21 33 34 35 36 37 38 39", ["03 6e 30 00"]),
    )
    uds.download(0x3000, 0, text)
    channel.close()


def test_a_device_that_asks_for_patience_gets_it() -> None:
    pending = "03 7f 2e 78"
    uds, _ = client(SESSION, ("04 2e 30 60 01", [pending, (0.5, pending), (1.0, "03 6e 30 60")]))
    uds.download(0x3060, 0, b"\x01")


def test_a_device_that_asks_for_patience_for_ever_is_silent_and_its_write_in_doubt() -> None:
    pleas = [(0.2 * i, "03 7f 2e 78") for i in range(200)]
    uds, channel = client(SESSION, ("04 2e 30 60 01", pleas), pending_s=1.0)
    began_s = channel.monotonic_s()
    with pytest.raises(DeviceSilent, match=r"answered \"pending\" 5\d times in 10 s"):
        uds.download(0x3060, 0, b"\x01")
    assert channel.monotonic_s() - began_s < 11
    with pytest.raises(DeviceSilent, match="read"):
        uds.download(0x3060, 0, b"\x01")


def test_seed_and_key_come_before_a_write_and_the_key_is_the_plugins() -> None:
    seed = bytes.fromhex("11223344")
    uds, channel = client(
        SESSION,
        ("02 27 01", ["06 67 01 " + seed.hex(" ")]),
        ("06 27 02 " + key_of(1, seed).hex(" "), ["02 67 02"]),
        ("04 2e 30 60 01", ["03 6e 30 60"]),
        ("04 2e 30 60 00", ["03 6e 30 60"]),
        key=key_of,
    )
    uds.download(0x3060, 0, b"\x01")
    uds.download(0x3060, 0, b"\x00")
    channel.close()


@pytest.mark.parametrize(("code", "says"), [(0x31, "no such identifier"), (0x33, "security access"), (0xF0, "own")])
def test_a_negative_answer_is_a_sentence(code: int, says: str) -> None:
    uds, _ = client(("03 22 30 21", [f"03 7f 22 {code:02x}"]))
    with pytest.raises(DeviceRefused, match=says):
        uds.upload(0x3020, 1)


def test_broken_frames_are_no_lines_on_the_operator_s_screen(capfd: pytest.CaptureFixture[str]) -> None:
    uds, _ = client(("03 22 30 21", ["10 0d 62 30 21 00 00 80"]), ("30 08 00", ["22 3f 00 00 00 00 00 00"]))
    logging.getLogger("isotp").propagate = False  # pytest's own handlers would hide the lines
    try:
        with pytest.raises(DeviceSilent, match="timed out"):
            uds.upload(0x3020, 1)
    finally:
        logging.getLogger("isotp").propagate = True
    assert capfd.readouterr().err == ""


def test_communication_objects_are_refused_without_a_frame() -> None:
    uds, channel = client()
    with pytest.raises(DeviceRefused, match="does not exist"):
        uds.upload(0x1017, 0)
    channel.close()


def test_a_write_without_an_answer_is_in_doubt_until_it_is_read() -> None:
    uds, _ = client(
        SESSION,
        ("04 2e 30 60 01", []),
        ("02 3e 00", ["02 7e 00"]),
        ("03 22 30 60", ["04 62 30 60 01"]),
        SESSION,
        ("04 2e 30 60 01", ["03 6e 30 60"]),
    )
    with pytest.raises(DeviceSilent, match="timed out"):
        uds.download(0x3060, 0, b"\x01")
    with pytest.raises(DeviceSilent, match="read"):
        uds.download(0x3060, 0, b"\x01")
    assert uds.upload(0x3060, 0) == b"\x01"
    uds.download(0x3060, 0, b"\x01")


def test_two_devices_with_one_identifier_are_named() -> None:
    twice = ["04 62 30 60 01"] * 2
    uds, _ = client(("03 22 30 60", twice), ("03 22 30 60", twice), ("03 22 30 60", twice))
    with pytest.raises(BusFault, match="two devices"):
        for _ in range(3):
            uds.upload(0x3060, 0)


@pytest.mark.parametrize(
    ("frame", "at"),
    [
        ("04 2e 30 60 01", (0x3060, 0)),
        ("10 0d 2e 30 00 30 31 32", (0x3000, 0)),
        ("04 31 01 3f 00", (0x3F00, 0)),
        ("02 11 01", (0, 0)),
        ("03 22 30 60", None),
        ("02 3e 00", None),
        ("21 33 34", None),
        ("", None),
    ],
)
def test_a_foreign_tester_that_changes_something_is_recognised(frame: str, at: tuple[int, int] | None) -> None:
    assert uds_written(bytes.fromhex(frame)) == at


class _Straight(BaseConnection):
    """udsoncan's client straight at the server, without frames."""

    def __init__(self, server: UdsServer) -> None:
        super().__init__("straight")
        self._server, self._answers = server, list[bytes]()

    def open(self) -> "_Straight":
        return self

    def close(self) -> None:
        self._answers.clear()

    def is_open(self) -> bool:
        return True

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._answers += self._server.handle(payload)

    def specific_wait_frame(self, timeout: float | None = None) -> bytes | None:
        if not self._answers:
            raise udsoncan.exceptions.TimeoutException
        return self._answers.pop(0)

    def empty_rxqueue(self) -> None:
        self._answers.clear()


def foreign_client(key: Callable[[int, bytes], bytes] | None = None) -> Client:
    product = load_product("accelerometer-uds")
    objects = SimulatedObjects(
        eds.load(shipped_folder() / "dbc" / "accelerometer-uds.eds", 1, frozenset()),
        product.map,
        NonVolatileMemory(),
        fixed={(0xF18C, 0): 42},
        computed={},
        spoil=lambda _index, _sub: None,
    )
    security = None if key is None else UdsSecurity(level=1, algorithm="test")
    server = UdsServer(objects, UdsAccess(request=0x741, response=0x761, security=security), key)
    config: Any = {
        "data_identifiers": {0xF18C: ">I", 0x3011: ">f", 0x3060: "B"},
        "security_algo": lambda level, seed, params: key_of(level, seed),
        "use_server_timing": False,
    }
    found = Client(_Straight(server))
    found.set_configs(config)
    return found


def test_the_simulated_device_is_one_to_a_foreign_client() -> None:
    with foreign_client() as uds:
        assert uds.read_data_by_identifier_first(0xF18C) == (42,)
        with pytest.raises(udsoncan.exceptions.NegativeResponseException) as refused:
            uds.write_data_by_identifier(0x3011, 1.01)
        assert refused.value.response.code == 0x7F
        uds.change_session(3)
        uds.write_data_by_identifier(0x3011, 1.01)
        assert uds.read_data_by_identifier_first(0x3011) == pytest.approx((1.01,))
        uds.start_routine(0x3F00)
        uds.tester_present()
        uds.ecu_reset(1)


def test_a_locked_device_takes_the_right_key_alone() -> None:
    with foreign_client(key_of) as uds:
        uds.change_session(3)
        with pytest.raises(udsoncan.exceptions.NegativeResponseException):
            uds.write_data_by_identifier(0x3060, 1)
        uds.unlock_security_access(1)
        uds.write_data_by_identifier(0x3060, 1)
        uds.change_session(3)
        with pytest.raises(udsoncan.exceptions.NegativeResponseException):
            uds.send_key(1, b"wrong key")
