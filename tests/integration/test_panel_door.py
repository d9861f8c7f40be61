"""The page's door: open as soon as its address is said, and answers leave at once."""

import socket

import pytest

from station.cli._panel import ListenAddress, _listening_socket
from station.errors import StationFault


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
