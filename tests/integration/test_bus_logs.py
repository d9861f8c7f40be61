"""CAN logs as files: round trips, python-can as the other side, broken files, and a real recording."""

import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest

from station.adapters.bus import _logs, _recorded, read_blocks, read_log, write_log
from station.adapters.bus._python_can import mf4
from station.adapters.bus.replay import ReplayBus
from station.adapters.dbc import read_layouts
from station.domain.can.signals import decode
from station.domain.core.types import ERROR, EXTENDED, REMOTE, Frames
from station.errors import BusFault, LogError, UsageError
from station.files import limited_process
from tests.conformance.bus_suite import MIXED, frames_of, rows_of

#: The second logger's module counts its identifiers from 16 on.
CSS = [("2F6913DB_00000004_00000001.MF4", 0), ("2F6913DB_00001089_00000001-63BEF5CD.MF4", 16)]


def _random(rng: np.random.Generator, n: int) -> Frames:
    kinds = rng.choice(np.array([0, EXTENDED, REMOTE, EXTENDED | REMOTE, ERROR], np.uint32), n)
    number = rng.integers(0, 0x2000_0000, n).astype(np.uint32)
    number[(kinds & np.uint32(EXTENDED | ERROR)) == 0] &= np.uint32(0x7FF)
    length = rng.integers(0, 9, n).astype(np.uint8)
    data = rng.integers(0, 256, (n, 8)).astype(np.uint8)
    data[np.arange(8) >= length[:, None]] = 0
    data[(kinds & np.uint32(REMOTE)) != 0] = 0
    time_ns = 1_767_225_600_000_000_000 + np.cumsum(rng.integers(0, 10**7, n)) // 1000 * 1000
    return Frames(time_ns, number | kinds, length, data)


def _same(ours: Frames, theirs: Frames) -> None:
    for name in ("time_ns", "can_id", "length", "data"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)


def test_candump_logs_lose_nothing(tmp_path: Path, rng: np.random.Generator) -> None:
    frames = _random(rng, 2000)
    write_log(tmp_path / "a.log", frames)
    _same(read_log(tmp_path / "a.log"), frames)


def test_python_can_reads_our_candump_log(tmp_path: Path, rng: np.random.Generator) -> None:
    frames = _random(rng, 500)
    frames = frames[(frames.can_id & np.uint32(ERROR | REMOTE)) == 0]  # of the others it knows less than the log
    write_log(tmp_path / "a.log", frames, "vcan7")
    for message, (can_id, data) in zip(can.LogReader(tmp_path / "a.log"), rows_of(frames), strict=True):
        assert (message.arbitration_id, bool(message.is_extended_id)) == (can_id & 0x1FFF_FFFF, bool(can_id & EXTENDED))
        assert (bytes(message.data), message.channel) == (data, "vcan7")


def test_we_read_python_cans_candump_log(tmp_path: Path, rng: np.random.Generator) -> None:
    frames = _random(rng, 500)
    frames = frames[(frames.can_id & np.uint32(ERROR | REMOTE)) == 0]
    with can.CanutilsLogWriter(tmp_path / "a.log") as writer:
        for row, (can_id, data) in enumerate(rows_of(frames)):
            extended = bool(can_id & EXTENDED)
            stamp = frames.time_ns[row] / 1e9
            writer(can.Message(stamp, can_id & 0x1FFF_FFFF, is_extended_id=extended, data=data))
    _same(read_log(tmp_path / "a.log"), frames)


def test_blf_keeps_frames_and_a_quarter_of_a_microsecond(tmp_path: Path, rng: np.random.Generator) -> None:
    frames = _random(rng, 2000)
    frames = frames[(frames.can_id & np.uint32(ERROR)) == 0]
    write_log(tmp_path / "a.blf", frames)
    again = read_log(tmp_path / "a.blf")
    assert rows_of(again) == rows_of(frames)
    assert np.abs(again.time_ns - frames.time_ns).max() <= 1000


def test_fd_frames_survive_a_candump_log(tmp_path: Path, rng: np.random.Generator) -> None:
    data = rng.integers(0, 256, (3, 64)).astype(np.uint8)
    data[0, 12:] = data[1, 8:] = 0
    length = np.array([12, 8, 64], np.uint8)
    frames = Frames(np.arange(3) * 1000, np.array([1, 2, 3], np.uint32), length, data)
    write_log(tmp_path / "a.log", frames)
    _same(read_log(tmp_path / "a.log"), frames)


def test_one_channel_of_several_can_be_chosen(tmp_path: Path) -> None:
    log = tmp_path / "two.log"
    log.write_text("(1.000001) can0 123#01\n(1.000002) can1 123#02\n(1.000003) can0 124#R4\n")
    assert rows_of(read_log(log, "can0")) == [(0x123, b"\x01"), (0x124 | REMOTE, bytes(4))]
    assert len(read_log(log)) == 3
    with pytest.raises(LogError, match="holds no CAN frames of channel can2"):
        read_log(log, "can2")


def test_other_writers_dialects_are_understood(tmp_path: Path) -> None:
    log = tmp_path / "dialects.log"
    log.write_text("(1436509052.249713) vcan0 044#2A366C2BBA R\n\n(0.5)  can0  1abcdef0#de T\n(2.123456789) 0 7FF#R\n")
    frames = read_log(log)
    assert frames.time_ns.tolist() == [1_436_509_052_249_713_000, 500_000_000, 2_123_456_789]
    assert rows_of(frames) == [(0x44, b"\x2a\x36\x6c\x2b\xba"), (0x1ABCDEF0 | EXTENDED, b"\xde"), (0x7FF | REMOTE, b"")]


def test_a_candump_killed_in_its_last_line_is_read_up_to_there(tmp_path: Path) -> None:
    log = tmp_path / "killed.log"
    log.write_text("(1.000001) can0 123#0102\n(1.000002) can0 123#03")
    assert len(read_log(log)) == 2
    log.write_text("(1.000001) can0 123#0102\n(1.000002) ca")
    assert len(read_log(log)) == 1


@pytest.mark.parametrize("line", ["hello", "(1.0) can0 1", "(1.0) can0 12#0", "(x) can0 1#00", "(1.0) can0 G#00"])
def test_a_line_that_is_no_frame_is_named(line: str, tmp_path: Path) -> None:
    log = tmp_path / "bad.log"
    log.write_text(f"(1.000001) can0 123#0102\n{line}\n")
    with pytest.raises(LogError, match=r"bad\.log, line 2: .* is not a frame"):
        read_log(log)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".mf4", ".log"])
@pytest.mark.parametrize("content", [b"", b"\0" * 200, b"LOGG" + bytes(300), b"\xff\xfe garbage \n" * 50])
def test_garbage_is_a_log_error_whatever_its_name(suffix: str, content: bytes, tmp_path: Path) -> None:
    log = tmp_path / f"garbage{suffix}"
    log.write_bytes(content)
    with pytest.raises(LogError, match="garbage"):
        read_log(log)


def test_a_truncated_blf_is_refused_or_read_up_to_there(tmp_path: Path, rng: np.random.Generator) -> None:
    frames = _random(rng, 3000)
    write_log(tmp_path / "whole.blf", frames)
    cut = tmp_path / "cut.blf"
    cut.write_bytes((tmp_path / "whole.blf").read_bytes()[:-2000])
    try:
        assert len(read_log(cut)) < 3000
    except LogError as error:
        assert "cut.blf" in error.sentence


def test_names_that_cannot_be_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="does not exist"):
        read_log(tmp_path / "absent.log")
    with pytest.raises(LogError, match=r"convert it to \.log"):
        read_log(tmp_path / "frames.txt")
    with pytest.raises(UsageError, match=r"\.log \(candump\) or \.blf"):
        write_log(tmp_path / "frames.mf4", Frames.empty())
    with pytest.raises(UsageError, match="cannot be written"):
        write_log(tmp_path / "absent" / "a.log", Frames.empty())
    with pytest.raises(LogError, match="does not exist"):
        ReplayBus(tmp_path / "absent.blf")
    (tmp_path / "empty.log").touch()
    with pytest.raises(LogError, match="holds no CAN frames"):
        ReplayBus(tmp_path / "empty.log")


def test_a_long_log_comes_in_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_logs, "BLOCK", 100)
    monkeypatch.setattr(_recorded, "BLOCK", 100)
    frames = frames_of(*[(0x100 + i % 3, bytes([i % 256])) for i in range(950)])
    for name in ("a.log", "a.blf"):
        write_log(tmp_path / name, frames)
        assert [len(b) for b in read_blocks(tmp_path / name)] == [100] * 9 + [50]
        channel = ReplayBus(tmp_path / name).stream((0x101,))
        parts = [channel.receive(1.0) for _ in range(12)]
        assert [len(p) for p in parts[10:]] == [0, 0]
        assert rows_of(Frames.join(parts)) == rows_of(frames[frames.can_id == 0x101])


def test_nothing_can_be_sent_to_a_recording(tmp_path: Path) -> None:
    write_log(tmp_path / "a.log", frames_of(*MIXED))
    with pytest.raises(BusFault, match=r"a\.log is a recording"):
        ReplayBus(tmp_path / "a.log").service(()).send(0x601, bytes(8))


@pytest.mark.parametrize(("name", "shift"), CSS)
def test_a_real_recording_decodes_frame_for_frame_as_cantools_does(name: str, shift: int, reference_data: Path) -> None:
    folder = reference_data / "css_canmod"
    database: Any = cantools.database.load_file(folder / "canmod-gps.dbc")
    frames = ReplayBus(folder / name).stream(()).receive(1.0)
    decoded, place = {}, {}
    for layout in read_layouts(folder / "canmod-gps.dbc").values():
        moved = replace(layout, can_id=layout.can_id + shift)
        decoded[moved.can_id] = decode(frames, moved)
        place[moved.can_id] = {int(row): at for at, row in enumerate(decoded[moved.can_id].rows)}
    with mf4().MF4Reader(folder / name) as reader:  # the station itself reads it in another process
        messages = list(reader)
    assert [(m.arbitration_id, bytes(m.data)) for m in messages] == rows_of(frames)
    np.testing.assert_allclose(frames.time_ns, [m.timestamp * 1e9 for m in messages], rtol=0, atol=256)
    checked = [row for row, m in enumerate(messages) if m.arbitration_id in decoded]
    for row in checked:
        can_id = messages[row].arbitration_id
        expected = database.decode_message(can_id - shift, messages[row].data, decode_choices=False)
        at = place[can_id][row]
        assert {key: values[at] for key, values in decoded[can_id].values.items()} == expected
    assert len(checked) == sum(len(d.rows) for d in decoded.values()) > 3000


def test_a_blf_that_unfolds_into_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One container of a megabyte that holds a gigabyte of zeros."""
    monkeypatch.setattr(limited_process, "LEAST_MEMORY", 200 << 20)  # as much is filled sooner
    packer, sum_of_zeros = zlib.compressobj(9), (1 << 30) % 65521 << 16 | 1
    start, mebibyte = (packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    packed = start + mebibyte * 1023 + b"\x03\x00" + sum_of_zeros.to_bytes(4, "big")
    body = struct.pack("<H6xL4x", 2, 1 << 30) + packed
    head = struct.pack("<4sL", b"LOGG", 144).ljust(144, b"\0")
    path = tmp_path / "bomb.blf"
    path.write_bytes(head + struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16 + len(body), 10) + body)
    assert path.stat().st_size < 1_100_000
    with pytest.raises(LogError, match="needs more than 210 MB of memory"):
        read_log(path)
