"""recvmmsg on a datagram socket that every kernel has: order, times, batches, errors, and answers of rtnetlink."""

import os
import socket
import struct
import time
from collections.abc import Iterator

import numpy as np
import pytest

from station.adapters.bus import _netlink
from station.adapters.bus._recvmmsg import CAN_FRAME, Receiver
from station.ports.bus import ErrorCounters

Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    """Two connected UDP sockets on the loopback: sender and receiver."""
    udp = socket.AF_INET, socket.SOCK_DGRAM
    with socket.socket(*udp) as far, socket.socket(*udp) as near:
        near.bind(("127.0.0.1", 0))
        near.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        far.connect(near.getsockname())
        yield far, near


def _frame(can_id: int, data: bytes) -> bytes:
    return struct.pack("=IB3x8s", can_id, len(data), data)


def test_frames_come_in_order_with_the_kernels_time(pair: Pair) -> None:
    sender, receiver = pair[0], Receiver(pair[1], batch=64)
    before_ns = time.time_ns()
    for i in range(50):
        sender.send(_frame(0x8000_0000 | i, i.to_bytes(1, "little") * (i % 9)))
    frames = receiver.take()
    after_ns = time.time_ns()
    assert frames.can_id.tolist() == [0x8000_0000 | i for i in range(50)]
    assert frames.length.tolist() == [i % 9 for i in range(50)]
    assert frames.data[17].tolist() == [17] * 8
    # Linux begins to stamp on arrival a moment after the first socket asks; what came before is stamped when read.
    assert before_ns <= frames.time_ns.min() and frames.time_ns.max() <= after_ns


def test_a_full_batch_leaves_the_rest_for_the_next_call_and_nothing_is_overwritten(pair: Pair) -> None:
    sender, receiver = pair[0], Receiver(pair[1], batch=16)
    for i in range(40):
        sender.send(_frame(i, b""))
    parts = [receiver.take() for _ in range(4)]
    assert [len(p) for p in parts] == [16, 16, 8, 0]
    assert np.concatenate([p.can_id for p in parts]).tolist() == list(range(40))


def test_an_empty_socket_gives_no_frames(pair: Pair) -> None:
    assert len(Receiver(pair[1]).take()) == 0


def test_the_sockets_error_comes_through() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", 9))  # nobody listens: the kernel reports that at the next call
        receiver = Receiver(sock)
        sock.send(b"x")
        with pytest.raises(ConnectionRefusedError):
            receiver.take()


def test_a_frame_is_as_large_as_the_kernels() -> None:
    assert CAN_FRAME.itemsize == len(_frame(0, b"")) == 16


def test_netlink_tells_the_loopback_from_nothing() -> None:
    link = _netlink.query_link("lo")
    assert (link.kind, link.can_state) == ("", None)
    with pytest.raises(OSError):
        _netlink.query_link("can77")


def _attribute(kind: int, payload: bytes) -> bytes:
    size = 4 + len(payload)
    return struct.pack("=HH", size, kind) + payload + bytes(-size % 4)


@pytest.mark.parametrize(("code", "word"), list(enumerate(_netlink.STATES)))
def test_the_controllers_state_is_read_from_the_kernels_answer(code: int, word: str) -> None:
    """The message of a can interface: IFLA_IFNAME, then IFLA_LINKINFO with kind, bit timing and state."""
    counted = _attribute(8, struct.pack("=HH", 96, 135))  # IFLA_CAN_BERR_COUNTER: txerr, rxerr
    timing = struct.pack("=I", 250_000) + bytes(28)
    data = _attribute(1, timing) + _attribute(4, struct.pack("=I", code)) + _attribute(6, bytes(4)) + counted
    info = _attribute(18 | 0x8000, _attribute(1, b"can\0") + _attribute(2, data))
    head = struct.pack("=BxHiII", 0, 280, 3, 1, 0)
    body = head + _attribute(3, b"can0\0") + _attribute(13, struct.pack("=I", 10)) + info
    message = struct.pack("=IHHII", 16 + len(body), 16, 0, 1, 0) + body
    assert _netlink.parse_link(message) == _netlink.Link(
        up=True, kind="can", can_state=word, counters=ErrorCounters(96, 135), bitrate=250_000, queue=10
    )


def test_an_error_answer_is_an_oserror() -> None:
    with pytest.raises(OSError) as refused:
        _netlink.parse_link(struct.pack("=IHHIIi", 36, 2, 0, 1, 0, -19) + bytes(16))
    assert refused.value.errno == 19
    assert refused.value.strerror == os.strerror(19)
