"""The kernel's own ways: time stamps, drops, a full queue, link down and up, absent interfaces, state."""

import socket
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from vcan_harness.command import run
from vcan_harness.interface import Interface, Link, create_link, create_vcan
from vcan_harness.programs import Candump
from vcan_harness.raw import RawSocket
from vcan_harness.waiting import until

from station.adapters.bus import _netlink, write_log
from station.adapters.bus.socketcan import SocketCan
from station.domain.can.error_frames import error_frames, has_bus_off
from station.domain.core.types import ERROR, Frames
from station.errors import BusFault, ConfigError
from station.messages import render
from tests.conformance.bus_suite import collect, frames_of, rows_of

Open = Callable[..., RawSocket]


@pytest.fixture
def bus(vcan: Interface) -> Iterator[SocketCan]:
    """The station's own bus on a fresh vcan."""
    opened = SocketCan(vcan.name)
    yield opened
    opened.close()


def test_the_kernels_time_is_kept_to_the_nanosecond(bus: SocketCan, vcan: Interface, raw_socket: Open) -> None:
    stream, sender = bus.stream(()), raw_socket(vcan)
    before_ns = time.time_ns()
    for i in range(200):
        sender.send(0x100 + i, b"")
    times = collect(stream, 200).time_ns
    after_ns = time.time_ns()
    assert before_ns <= times.min() and times.max() <= after_ns
    assert len(set(times % 1000)) > 20  # a float of seconds since 1970 would leave multiples of 238 ns


def test_candump_and_the_station_log_the_same_bytes(
    bus: SocketCan, vcan: Interface, raw_socket: Open, candump: Callable[[Interface], Candump], tmp_path: Any
) -> None:
    stream, dump, sender = bus.stream(()), candump(vcan), raw_socket(vcan)
    rng = np.random.default_rng(3)
    sent = [(int(rng.integers(0x800)), rng.bytes(int(rng.integers(9)))) for _ in range(50)]
    sent += [(0x9234_5678, b"\x01\x02"), (0x4000_0123, b""), (ERROR | 0x40, bytes(8))]
    for can_id, data in sent:
        sender.send(can_id, data)
    dump.wait_for(len(sent))
    write_log(tmp_path / "ours.log", collect(stream, len(sent)), vcan.name)
    assert (tmp_path / "ours.log").read_text() == dump.log.read_text()


def test_the_drop_counter_tells_the_truth_under_a_flood(
    bus: SocketCan, vcan: Interface, cangen: Callable[..., Any], raw_socket: Open
) -> None:
    service, witness = bus.service((0x42A,)), raw_socket(vcan, 4096)
    flood = cangen(vcan, "-g", "0", "-n", "5000", "-I", "42A", "-L", "8", "-D", "i")
    assert flood.wait(timeout=60) == 0
    until(lambda: witness.drops() + len(witness.waiting()) > 4000, "the flood")
    received = collect(service, 5000)
    dropped = service.drops()
    numbers = np.ascontiguousarray(received.data).view("<u8")[:, 0]
    assert len(received) + dropped == 5000
    assert dropped > 0  # a service's buffer does not hold them all
    assert (np.diff(numbers) == 1).all()  # what was kept is the beginning, without holes


def test_a_stream_keeps_what_a_service_would_drop(bus: SocketCan, vcan: Interface, cangen: Callable[..., Any]) -> None:
    stream = bus.stream((0x42A,))
    flood = cangen(vcan, "-g", "0", "-n", "5000", "-I", "42A", "-L", "8", "-D", "i")
    assert flood.wait(timeout=60) == 0
    assert len(collect(stream, 5000)) == 5000
    assert stream.drops() == 0


def test_the_same_channel_works_again_after_link_down_and_up(bus: SocketCan, vcan: Interface, raw_socket: Open) -> None:
    stream, service, idle, sender = bus.stream(()), bus.service(()), bus.service(()), raw_socket(vcan)
    sender.send(0x1, b"\x01")
    vcan.down()
    assert bus.state() == "down"
    down = f"{vcan.name} went down: bring it up with `ip link set {vcan.name} up`"
    with pytest.raises(BusFault, match=down):
        service.send(0x2, b"")
    with pytest.raises(BusFault, match=down):
        stream.receive(5.0)
    assert rows_of(stream.receive(0.0)) == [(0x1, b"\x01")]  # what had arrived before is not lost
    vcan.up()
    assert bus.state() == "active"
    with pytest.raises(BusFault, match=down):
        idle.receive(0.0)  # who looks only now learns of it too, once
    service.send(0x3, b"\x03")
    assert rows_of(collect(stream, 1)) == [(0x3, b"\x03")]
    assert rows_of(idle.receive(0.0)) == [(0x1, b"\x01"), (0x3, b"\x03")]
    assert stream.drops() == 0


def test_an_interface_taken_away_is_gone_not_down() -> None:
    gone = create_vcan("vcan-gone")
    bus = SocketCan(gone.name)
    stream = bus.stream(())
    gone.delete()
    with pytest.raises(BusFault, match=gone.name):
        stream.receive(5.0)
    with pytest.raises(BusFault, match=f"{gone.name} is gone: plug the adapter in"):
        stream.send(0x1, b"")
    assert bus.state() == "unknown"
    bus.close()


def test_an_absent_interface_is_a_config_error_that_lists_the_others(vcan: Interface) -> None:
    with pytest.raises(ConfigError, match="CAN interface can77 cannot be opened") as refused:
        SocketCan("can77")
    assert vcan.name in refused.value.sentence


def test_a_full_queue_is_waited_for(shaped_vcan: Callable[[int], Link]) -> None:
    link = shaped_vcan(50_000)
    far, near = SocketCan(link.far.name), SocketCan(link.near.name)
    listener, sender = far.stream(()), near.service(())
    for i in range(100):
        sender.send(i, bytes(8))
    assert [can_id for can_id, _ in rows_of(collect(listener, 100))] == list(range(100))
    far.close()
    near.close()


def test_a_queue_that_stays_full_is_a_fault_with_a_remedy() -> None:
    """A token bucket that lets nothing through: what a bus without a second node looks like."""
    link = create_link("stuck0", "stuck1", 50_000)
    run("tc", "qdisc", "replace", "dev", "stuck0", "root", "tbf", "rate", "8bit", "burst", "16", "limit", "1600")
    bus = SocketCan("stuck0")
    sender = bus.service(())
    started_s = time.monotonic()
    with pytest.raises(BusFault, match="queue is full: check that a node acknowledges"):
        for _ in range(1000):
            sender.send(0x1, bytes(8))
    assert 1.0 <= time.monotonic() - started_s < 20.0
    bus.close()
    link.near.delete()


def test_a_block_is_sent_in_order(bus: SocketCan) -> None:
    sender, listener = bus.service(()), bus.stream(())
    sent = [(0x200 + i, bytes([i])) for i in range(100)]
    sender.send_many(frames_of(*sent))
    assert rows_of(collect(listener, 100)) == sent


def test_bus_off_is_read_from_the_error_frames(
    bus: SocketCan, vcan: Interface, cansend: Callable[[Interface, int, bytes], None]
) -> None:
    stream = bus.stream((0x181,))
    cansend(vcan, ERROR | 0x04, b"\x00\x30\x00\x00\x00\x00\x80\x88")
    cansend(vcan, ERROR | 0x40, bytes(8))
    frames = collect(stream, 2)
    assert has_bus_off(frames)
    assert tuple(render(message) for message in error_frames(frames)) == (
        "error passive while receiving",
        "error passive while sending",
        "the controller is bus-off: check wiring, termination and bit rate",
    )


def test_waiting_ends_with_the_first_frame_or_the_time_out(bus: SocketCan, vcan: Interface, raw_socket: Open) -> None:
    stream, sender = bus.stream(()), raw_socket(vcan)
    started_s = time.monotonic()
    assert not len(stream.receive(0.2))
    assert 0.19 < time.monotonic() - started_s < 2.0
    sender.send(0x1, b"")
    started_s = time.monotonic()
    assert len(stream.receive(30.0)) == 1
    assert time.monotonic() - started_s < 5.0


def test_our_netlink_agrees_with_iproute2(vcan: Interface) -> None:
    for change in (vcan.down, vcan.up):
        change()
        link, shown = _netlink.query_link(vcan.name), vcan.details()
        assert link.up == ("UP" in shown["flags"])
        assert link.kind == shown["linkinfo"]["info_kind"] == "vcan"
        assert link.can_state is None


def test_what_the_kernel_says_of_an_absent_link_is_an_error() -> None:
    with pytest.raises(OSError, match="no interface"):
        _netlink.query_link("can77")


def test_the_stream_buffer_holds_a_second_of_a_full_bus(bus: SocketCan) -> None:
    """9,009 frames/s at 1 Mbit/s, each taking what one frame takes in this kernel."""
    stream = bus.stream(())
    bus.service(()).send(0x1, bytes(8))
    assert len(Frames.join([stream.receive(1.0)])) == 1
    size = stream._sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    bus.service(()).send(0x1, bytes(8))
    used = struct.unpack("=9I", stream._sock.getsockopt(socket.SOL_SOCKET, 55, 36))[0]
    assert used > 0
    assert size / used > 9009


def test_the_kernel_repeats_a_frame_until_it_is_closed(bus: SocketCan) -> None:
    stream = bus.stream((0x080,))
    sync = bus.repeat(0x080, b"", 0.01)
    frames = collect(stream, 20)
    sync.close()
    sync.close()
    assert set(rows_of(frames)) == {(0x080, b"")}
    assert 0.008 < float(np.median(np.diff(frames.time_ns))) / 1e9 < 0.02
    stream.receive(0.05)
    assert not len(stream.receive(0.1))


def test_fd_frames_come_among_classic_ones(bus: SocketCan) -> None:
    data = np.zeros((3, 64), np.uint8)
    data[0, :8], data[1, :20], data[2, :3] = 7, np.arange(20), 9
    lengths = np.array([8, 20, 3], np.uint8)
    sent = Frames(np.arange(3, dtype=np.int64), np.array([0x181, 0x182, 0x183], np.uint32), lengths, data)
    stream, sender = bus.stream((0x181, 0x182, 0x183)), bus.service((0x7FF,))
    sender.send_many(sent)
    assert rows_of(collect(stream, 3)) == rows_of(sent)
    sender.send_many(sent[[0, 2]])
    narrow = collect(stream, 2)
    assert narrow.data.shape == (2, 8)
