"""The kernel's CAN network itself: delivery, loss, link state, pace."""

import errno
import time
from collections.abc import Callable

import pytest
from vcan_harness.interface import Interface, Link
from vcan_harness.raw import RawSocket

Open = Callable[..., RawSocket]
_ERROR_FLAG = 0x2000_0000
_MOST_ROUNDS = 300


def test_a_frame_sent_by_one_socket_arrives_at_another(vcan: Interface, raw_socket: Open) -> None:
    sender, receiver = raw_socket(vcan), raw_socket(vcan)
    sender.send(0x181, bytes(range(8)))
    assert receiver.receive() == (0x181, bytes(range(8)))
    assert sender.waiting() == []


def test_two_interfaces_do_not_hear_each_other(new_vcan: Callable[[], Interface], raw_socket: Open) -> None:
    here, there = new_vcan(), new_vcan()
    listener, stranger = raw_socket(here), raw_socket(there)
    raw_socket(here).send(0x123, b"\x01")
    assert listener.receive() == (0x123, b"\x01")
    assert stranger.waiting() == []


def test_a_small_buffer_loses_frames_and_the_kernel_counts_each(vcan: Interface, raw_socket: Open) -> None:
    small, large = raw_socket(vcan, 4096), raw_socket(vcan, 1 << 18)
    sender = raw_socket(vcan)
    sent = [(0x100 + i, bytes([i])) for i in range(200)]
    for can_id, data in sent:
        sender.send(can_id, data)
    assert [large.receive() for _ in sent] == sent
    assert large.drops() == 0
    stored = small.waiting()
    assert 0 < len(stored) < 200
    assert stored == sent[: len(stored)]
    assert small.drops() == 200 - len(stored)


def test_a_socket_lives_through_link_down_and_up(vcan: Interface, raw_socket: Open) -> None:
    sender, receiver = raw_socket(vcan), raw_socket(vcan)
    vcan.down()
    with pytest.raises(OSError) as sending:
        sender.send(0x1, b"")
    with pytest.raises(OSError) as receiving:
        receiver.receive()
    assert sending.value.errno == errno.ENETDOWN
    assert receiving.value.errno == errno.ENETDOWN
    vcan.up()
    sender.send(0x2, b"\x02")
    assert receiver.receive() == (0x2, b"\x02")


@pytest.mark.parametrize("bitrate", [125_000, 50_000])
def test_a_shaped_bus_carries_frames_at_its_bit_rate(
    shaped_vcan: Callable[[int], Link], raw_socket: Open, bitrate: int
) -> None:
    link = shaped_vcan(bitrate)
    sender, receiver = raw_socket(link.near), raw_socket(link.far)
    frames = [(i, bytes(8)) for i in range(50)]

    def round_s() -> float:
        started = time.monotonic()
        for can_id, data in frames:
            sender.send(can_id, data)
        assert [receiver.receive() for _ in frames] == frames
        return time.monotonic() - started

    # The bucket holds two frames, which go at once. No round beats the bus; one at least is not held up elsewhere, as a
    # busy machine does to many in a row.
    wire_s = (len(frames) - 2) * 135 / bitrate
    rounds_s = [round_s() for _ in range(5)]
    while min(rounds_s) >= 1.25 * wire_s and len(rounds_s) < _MOST_ROUNDS:
        rounds_s.append(round_s())
    assert min(rounds_s) >= wire_s
    assert min(rounds_s) < 1.25 * wire_s
