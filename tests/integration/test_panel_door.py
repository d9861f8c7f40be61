"""The page's door: open as soon as its address is said, and answers leave at once; an address that is none."""

import socket

import pytest

from station.adapters.modbus.client import ModbusRegisters
from station.cli._panel import ListenAddress, _listening_socket
from station.cli._witness import listening
from station.errors import PlcFault, StationFault


def test_whoever_reads_the_address_may_come_at_once() -> None:
    with (
        _listening_socket(ListenAddress("127.0.0.1", 0, secure=False)) as door,
        socket.create_connection(door.getsockname(), 5),
    ):
        accepted, _ = door.accept()
        with accepted:
            assert accepted.proto == socket.IPPROTO_TCP, "asyncio sends without delay only where it sees TCP"


def test_a_door_that_is_taken_is_said() -> None:
    with _listening_socket(ListenAddress("127.0.0.1", 0, secure=False)) as door:
        taken = ListenAddress("127.0.0.1", door.getsockname()[1], secure=False)
        with pytest.raises(StationFault, match="choose another --host or --port"):
            _listening_socket(taken)


@pytest.mark.parametrize("host", [".inf", "a..b", "x" * 64, "nowhere.invalid"])
def test_a_host_that_can_be_none_is_said(host: str) -> None:
    with pytest.raises(StationFault, match="no machine of that name"):
        _listening_socket(ListenAddress(host, 0, secure=False))
    with pytest.raises(StationFault, match="no machine of that name"):
        listening(host, 0)
    with pytest.raises(PlcFault, match="takes no connection"):
        ModbusRegisters(host, 502, device=1, timeout_s=1.0).read("holding", 0, 1)
