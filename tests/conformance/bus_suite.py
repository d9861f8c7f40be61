"""What every bus promises, as tests; a subclass brings the rig that puts frames on it."""

from abc import ABC, abstractmethod

import numpy as np
import pytest

from station.domain.core.types import ERROR, EXTENDED, REMOTE, Frames
from station.errors import BusFault
from station.ports.bus import Bus, Channel

MS = 1_000_000
START_NS = 1_767_225_600_000_000_000
STATES = {"active", "warning", "passive", "bus-off", "down", "unknown"}


def frames_of(*rows: tuple[int, bytes]) -> Frames:
    """Frames a millisecond apart; of a remote frame the payload's length is its DLC."""
    n = len(rows)
    data = np.zeros((n, 8), np.uint8)
    for row, (can_id, payload) in enumerate(rows):
        if not can_id & REMOTE:
            data[row, : len(payload)] = np.frombuffer(payload, np.uint8)
    return Frames(
        START_NS + MS * np.arange(n),
        np.array([can_id for can_id, _ in rows], np.uint32),
        np.array([len(payload) for _, payload in rows], np.uint8),
        data,
    )


def rows_of(frames: Frames) -> list[tuple[int, bytes]]:
    """The inverse of frames_of, without times."""
    return [
        (int(can_id), data[:length].tobytes())
        for can_id, length, data in zip(frames.can_id, frames.length, frames.data, strict=True)
    ]


class Rig(ABC):
    """A bus on which known frames will appear."""

    sends = True
    keeps_errors = True  # class and payload of error frames
    own_times = True  # the frames' times are kept to 1 µs, not replaced by those of arrival

    @abstractmethod
    def bus(self, coming: Frames) -> Bus:
        """The bus; `coming` is what play() will put on it."""

    @abstractmethod
    def play(self) -> None:
        """Puts the frames on the bus."""


def collect(channel: Channel, count: int) -> Frames:
    """At least `count` frames, or what came before a second of silence."""
    parts: list[Frames] = []
    while sum(len(p) for p in parts) < count:
        parts.append(channel.receive(1.0))
        if not len(parts[-1]):
            break
    return Frames.join(parts)


#: As many small datagrams as a socket of Linux keeps unread at its default size (212,992 bytes, 768 each): where the
#: reader gets no turn for a while, a bus over UDP loses what comes after.
UNREAD = 250

MIXED = [
    (0x181, bytes(range(8))),
    (0x182, b"\x01"),
    (0x181 | EXTENDED, b"\xff\xfe"),
    (0x181, b""),
    (0x7FF, b"\x80" * 8),
    (0x1FFF_FFFF | EXTENDED, b"abcdefg"),
    (0x181 | REMOTE, bytes(8)),
    (0x000, b"\x01\x02"),
    (0x182 | EXTENDED | REMOTE, bytes(2)),
    (ERROR | 0x44, b"\x00\x30\x00\x00\x00\x00\x80\x88"),
    (0x181, b"\x07\x06\x05\x04\x03\x02\x01\x00"),
]


class FramesSuite:
    """What any source of frames promises of them; subclasses define the fixture `rig`."""

    def test_a_stream_without_ids_hears_everything(self, rig: Rig) -> None:
        stream = rig.bus(frames_of(*MIXED)).stream(())
        rig.play()
        self._same(rig, collect(stream, len(MIXED)), MIXED)

    def test_random_frames_arrive_as_they_were(self, rig: Rig, rng: np.random.Generator) -> None:
        ids = [int(rng.integers(0x800)) if i % 2 else int(rng.integers(0x2000_0000)) | EXTENDED for i in range(UNREAD)]
        sent = [(can_id, rng.bytes(int(rng.integers(9)))) for can_id in ids]
        stream = rig.bus(frames_of(*sent)).stream(())
        rig.play()
        self._same(rig, collect(stream, UNREAD), sent)

    def test_arrays_have_their_types_shapes_and_order(self, rig: Rig) -> None:
        sent = frames_of(*MIXED[:6])
        stream = rig.bus(sent).stream(())
        rig.play()
        for frames in (collect(stream, 6), stream.receive(0.0)):
            kinds = [a.dtype for a in (frames.time_ns, frames.can_id, frames.length, frames.data)]
            assert kinds == [np.int64, np.uint32, np.uint8, np.uint8]
            assert frames.data.shape == (len(frames), 8)
            assert (np.diff(frames.time_ns) >= 0).all()

    def test_times_are_those_of_the_frames(self, rig: Rig) -> None:
        sent = frames_of(*MIXED[:6])
        stream = rig.bus(sent).stream(())
        rig.play()
        received = collect(stream, 6)
        if rig.own_times:
            assert np.abs((received.time_ns - received.time_ns[0]) - (sent.time_ns - sent.time_ns[0])).max() <= 1000
        else:
            assert received.time_ns[-1] - received.time_ns[0] < 10_000 * MS

    @staticmethod
    def _same(rig: Rig, received: Frames, sent: list[tuple[int, bytes]]) -> None:
        rows = [(i, b"" if i & REMOTE else d) for i, d in rows_of(received)]
        expected = [(i, b"" if i & REMOTE else d) for i, d in sent]
        if not rig.keeps_errors:
            rows = [(ERROR, b"") if i & ERROR else (i, d) for i, d in rows]
            expected = [(ERROR, b"") if i & ERROR else (i, d) for i, d in expected]
        assert rows == expected
        lengths = [int(n) for n, i in zip(received.length, received.can_id, strict=True) if not i & ERROR]
        assert lengths == [len(d) for i, d in sent if not i & ERROR]


class BusSuite(FramesSuite):
    """Conformance of one kind of bus."""

    def test_a_stream_hears_its_ids_and_every_error(self, rig: Rig) -> None:
        stream = rig.bus(frames_of(*MIXED)).stream((0x181, 0x1FFF_FFFF | EXTENDED))
        rig.play()
        expected = [r for r in MIXED if r[0] in (0x181, 0x181 | REMOTE, 0x1FFF_FFFF | EXTENDED) or r[0] & ERROR]
        self._same(rig, collect(stream, len(expected)), expected)

    def test_a_service_hears_its_ids_and_no_error(self, rig: Rig) -> None:
        service = rig.bus(frames_of(*MIXED)).service((0x182, 0x181 | EXTENDED))
        rig.play()
        self._same(rig, collect(service, 2), [MIXED[1], MIXED[2]])

    def test_a_service_without_ids_hears_everything_but_errors(self, rig: Rig) -> None:
        service = rig.bus(frames_of(*MIXED)).service(())
        rig.play()
        expected = [r for r in MIXED if not r[0] & ERROR]
        self._same(rig, collect(service, len(expected)), expected)

    def test_each_channel_hears_for_itself(self, rig: Rig) -> None:
        bus = rig.bus(frames_of(*MIXED[:6]))
        first, second = bus.stream((0x181,)), bus.service((0x182,))
        rig.play()
        self._same(rig, collect(first, 2), [MIXED[0], MIXED[3]])
        self._same(rig, collect(second, 1), [MIXED[1]])

    def test_a_burst_is_not_lost(self, rig: Rig) -> None:
        sent = [(0x181, i.to_bytes(4, "little")) for i in range(5000)]
        stream = rig.bus(frames_of(*sent)).stream((0x181,))
        rig.play()
        self._same(rig, collect(stream, 5000), sent)
        assert stream.drops() == 0

    def test_silence_is_no_frames_at_once(self, rig: Rig) -> None:
        stream = rig.bus(frames_of(MIXED[0])).stream((0x111,))
        rig.play()
        assert len(stream.receive(0.0)) == 0
        assert len(stream.receive(0.01)) == 0

    def test_what_is_sent_is_heard_by_others_or_refused(self, rig: Rig) -> None:
        bus = rig.bus(frames_of(MIXED[0]))
        mine, other, deaf = bus.service((0x601,)), bus.service((0x601,)), bus.service((0x602,))
        if not rig.sends:
            with pytest.raises(BusFault, match="recording"):
                mine.send(0x601, b"\x40\x18\x10\x04")
            return
        mine.send(0x601, b"\x40\x18\x10\x04")
        mine.send(0x601, b"")
        assert rows_of(collect(other, 2)) == [(0x601, b"\x40\x18\x10\x04"), (0x601, b"")]
        assert not len(mine.receive(0.0)) and not len(deaf.receive(0.0))
        with pytest.raises(ValueError, match="8 bytes"):
            mine.send(0x601, bytes(9))

    def test_a_closed_channel_says_so(self, rig: Rig) -> None:
        bus = rig.bus(frames_of(MIXED[0]))
        first, second = bus.stream(()), bus.service(())
        first.close()
        first.close()
        bus.close()
        bus.close()
        for channel in (first, second):
            with pytest.raises(BusFault):
                channel.receive(0.0)
            with pytest.raises(BusFault):
                channel.send(0x1, b"")

    def test_name_and_state_are_words(self, rig: Rig) -> None:
        bus = rig.bus(frames_of(MIXED[0]))
        assert bus.name
        assert bus.state() in STATES
        assert bus.stream(()).drops() == 0
