"""can-utils see, make and lose the same frames as we do."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from vcan_harness.interface import Interface
from vcan_harness.programs import Candump
from vcan_harness.raw import RawSocket

_EXTENDED, _ERROR = 0x8000_0000, 0x2000_0000

Open = Callable[..., RawSocket]
Dump = Callable[[Interface], Candump]


def _random_frames(rng: np.random.Generator, count: int) -> list[tuple[int, bytes]]:
    """Standard and extended ids, lengths 0 to 8."""
    ids = [int(rng.integers(0x800)) if i % 2 else int(rng.integers(0x2000_0000)) | _EXTENDED for i in range(count)]
    return [(can_id, rng.bytes(int(rng.integers(9)))) for can_id in ids]


def test_candump_logs_every_frame_byte_for_byte(
    vcan: Interface, raw_socket: Open, candump: Dump, rng: np.random.Generator
) -> None:
    dump, sender = candump(vcan), raw_socket(vcan)
    sent = _random_frames(rng, 200)
    for can_id, data in sent:
        sender.send(can_id, data)
    logged = dump.wait_for(len(sent))
    assert [(frame.can_id, frame.data) for frame in logged] == sent
    assert {frame.interface for frame in logged} == {vcan.name}
    assert (np.diff([frame.time_us for frame in logged]) >= 0).all()


def test_an_error_frame_reaches_candump_and_no_plain_socket(
    vcan: Interface, raw_socket: Open, candump: Dump, cansend: Callable[..., None]
) -> None:
    dump, plain = candump(vcan), raw_socket(vcan)
    bus_off = _ERROR | 0x40
    cansend(vcan, bus_off, bytes(8))
    cansend(vcan, 0x123, b"\x11")
    assert [(f.can_id, f.data) for f in dump.wait_for(2)] == [(bus_off, bytes(8)), (0x123, b"\x11")]
    assert plain.waiting() == [(0x123, b"\x11")]


def test_canplayer_replays_a_log_with_its_pauses(
    vcan: Interface, candump: Dump, canplayer: Callable[..., None], tmp_path: Path, rng: np.random.Generator
) -> None:
    frames = _random_frames(rng, 30)
    names = [f"{can_id & 0x1FFF_FFFF:0{8 if can_id & _EXTENDED else 3}X}" for can_id, _ in frames]
    lines = [
        f"(1700000000.{20_000 * i:06d}) can7 {name}#{data.hex().upper()}"
        for i, (name, (_, data)) in enumerate(zip(names, frames, strict=True))
    ]
    log = tmp_path / "recorded.log"
    log.write_text("\n".join(lines) + "\n")
    dump = candump(vcan)
    canplayer(log, {"can7": vcan.name})
    played = dump.wait_for(len(frames))
    assert [(frame.can_id, frame.data) for frame in played] == frames
    span_s = (played[-1].time_us - played[0].time_us) / 1e6
    assert span_s > 0.9 * 29 * 0.020


def test_a_flood_from_cangen_overruns_a_small_buffer_and_the_counter_tells(
    vcan: Interface, raw_socket: Open, cangen: Callable[..., Any]
) -> None:
    small, large = raw_socket(vcan, 4096), raw_socket(vcan, 1 << 18)
    sent = [(0x42A, i.to_bytes(8, "little")) for i in range(2000)]
    flood = cangen(vcan, "-g", "0", "-n", "2000", "-I", "42A", "-L", "8", "-D", "i")
    received: list[tuple[int, bytes]] = []
    while len(received) + large.drops() < len(sent):
        received.append(large.receive())
    stored = small.waiting()
    assert flood.wait(timeout=30) == 0
    assert set(received) <= set(sent)
    assert received == sorted(received, key=lambda frame: int.from_bytes(frame[1], "little"))
    assert 0 < len(stored) < len(sent)
    assert stored == sent[: len(stored)]
    assert small.drops() == len(sent) - len(stored)
