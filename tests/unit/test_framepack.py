"""Frames at rest come back bit for bit, whatever they are; and typical ones are small."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from station.domain.can.e2e import crc8
from station.domain.core.types import Frames
from station.domain.records.framepack import codec, columns, parity, plain, predict
from station.domain.records.framepack.bytestream import ByteReader, ByteWriter
from station.errors import LogError
from tests.portion import examples

IDS = st.sampled_from([0x181, 0x182, 0x281, 0x8000_0000 | 0x1ABCDEF, 0x2000_0004, 0xFFFF_FFFF])


@st.composite
def any_frames(draw: st.DrawFn) -> Frames:
    n, width = draw(st.integers(0, 60)), draw(st.sampled_from([8, 64, 1, 12]))
    time = draw(
        st.one_of(
            hnp.arrays(np.int64, n, elements=st.integers(-(2**63), 2**63 - 1)),
            hnp.arrays(np.int64, n, elements=st.integers(0, 10**7)).map(np.sort),
            st.just(1_700_000_000_000_000_000 + np.arange(n) * 1_000_000),
        )
    )
    few_ids = hnp.arrays(np.uint32, n, elements=IDS)
    return Frames(
        time,
        draw(st.one_of(few_ids, st.just(np.full(n, 0x181, np.uint32)))),
        draw(st.one_of(st.just(np.full(n, min(width, 8), np.uint8)), hnp.arrays(np.uint8, n))),
        draw(hnp.arrays(np.uint8, (n, width), elements=st.integers(0, 255), fill=st.just(0))),
    )


def stop(rng: np.random.Generator, n: int, level: tuple[int, int, int], bad_crc: bool = False) -> Frames:
    """A dwell of a noisy three-axis sensor: CRC, counter of 15, three little-endian 16-bit axes, jittered clock."""
    data = np.zeros((n, 8), np.uint8)
    noise = np.rint(rng.normal(level, 11, (n, 3))).astype("<i2")
    data[:, 2:] = noise.view(np.uint8).reshape(n, 6)
    data[:, 1] = np.arange(n) % 15
    data[:, 0] = crc8(list(data[:, 1:].T), 0x1D, start=7)
    if bad_crc:
        data[n // 2, 0] ^= 0x5A
    time_ns = 1_700_000_000_000_000_000 + np.arange(n) * 1_000_000 + rng.integers(0, 20, n) * 1000
    return Frames(time_ns, np.full(n, 0x181, np.uint32), np.full(n, 8, np.uint8), data)


def same(a: list[Frames], b: list[Frames]) -> bool:
    return [plain.to_bytes(f) for f in a] == [plain.to_bytes(f) for f in b]


@settings(max_examples=examples(300), deadline=None)
@given(st.lists(any_frames(), max_size=4))
def test_any_frames_come_back_bit_for_bit(parts: list[Frames]) -> None:
    assert same(codec.unpack(codec.pack(parts)), parts)


@settings(max_examples=examples(100), deadline=None)
@given(any_frames())
def test_plain_bytes_come_back_and_their_digest_tells_any_change(frames: Frames) -> None:
    stored = plain.to_bytes(frames)
    assert same([plain.from_bytes(stored)], [frames])
    if len(frames):
        frames.data[0, 0] ^= 1
        assert plain.digest(plain.to_bytes(frames)) != plain.digest(stored)


@settings(max_examples=examples(100), deadline=None)
@given(any_frames(), st.lists(st.integers(0, 60), max_size=6))
def test_frames_laid_out_piece_by_piece_are_those_laid_out_at_once(frames: Frames, cuts: list[int]) -> None:
    laying, at = plain.PlainFramesBuilder(), [0, *sorted(cuts), len(frames)]
    for begin, end in pairwise(at):
        laying.add(frames[begin:end])
    whole = laying.frames()
    assert laying.done() == plain.to_plain(whole)
    assert laying.done().count == len(frames)
    if len(frames):
        assert same([whole], [frames])


def test_a_long_frame_among_classic_ones_widens_all() -> None:
    classic = stop(np.random.default_rng(5), 20, (0, 0, 16000))
    long = Frames(classic.time_ns, classic.can_id, classic.length, np.pad(classic.data, ((0, 0), (0, 56))))
    laying = plain.PlainFramesBuilder()
    for part in (classic, long, classic):
        laying.add(part)
    assert laying.done() == plain.to_plain(Frames.join([classic, long, classic]))


@settings(max_examples=examples(100), deadline=None)
@given(any_frames())
def test_frames_of_an_earlier_log_are_read_and_checked_as_ever(frames: Frames) -> None:
    by_columns = plain.to_bytes(frames, plain.COLUMNS)
    assert by_columns.startswith(b"frames/1 %d " % len(frames))
    assert same([plain.from_bytes(by_columns)], [frames])
    assert plain.form_of(by_columns) == plain.COLUMNS
    assert plain.digest_matches(frames, plain.digest(by_columns))
    assert plain.digest_matches(frames, plain.to_plain(frames).sha256)
    assert not plain.digest_matches(frames, plain.digest(by_columns + b"!"))


@pytest.mark.parametrize("bad_crc", [False, True])
def test_a_typical_unit_packs_below_three_and_a_half_bytes_a_frame(bad_crc: bool) -> None:
    rng = np.random.default_rng(4)
    levels = [(0, 0, 16000), (0, 0, -16000), (16000, 0, 0), (-16000, 0, 0), (0, 16000, 0), (0, -16000, 0)]
    parts = [stop(rng, 400, level, bad_crc and i == 0) for i, level in enumerate(levels)]
    packed = codec.pack(parts)
    assert same(codec.unpack(packed), parts)
    # 5.5 bits of noise on each of three axes and 4.3 of clock jitter are 2.6 bytes that no code can save.
    assert len(packed) < 3.5 * 2400


def test_the_crc_byte_is_found_without_its_polynomial() -> None:
    frames = stop(np.random.default_rng(1), 300, (5, -5, 16000))
    words = frames.data.view("<u8")[:, 0].astype(np.uint64)
    found = parity.find_parity(words, 0)
    assert found is not None
    assert (found.predict(words, int(words[0])) == frames.data[:, 0]).all()
    described = found.to_bytes()
    assert parity.Parity.from_bytes(b"?" + described, 1) == (found, 1 + len(described))


def test_a_byte_of_its_own_is_no_parity() -> None:
    words = np.random.default_rng(2).integers(0, 2**63, 300, dtype=np.uint64)
    assert all(parity.find_parity(words, byte) is None for byte in range(8))


@settings(max_examples=examples(200), deadline=None)
@given(st.lists(hnp.arrays(np.uint64, st.integers(0, 40), elements=st.integers(0, 2**64 - 1)), max_size=5))
def test_columns_come_back(stored: list[np.ndarray]) -> None:
    out = ByteWriter()
    columns.pack(out, stored)
    again = columns.unpack(ByteReader(bytes(out)), [len(c) for c in stored])
    assert [c.tolist() for c in again] == [c.tolist() for c in stored]


@settings(max_examples=examples(200), deadline=None)
@given(hnp.arrays(np.int64, st.integers(1, 50), elements=st.integers(-(2**46), 2**46)), st.sampled_from(predict.MODELS))
def test_every_model_is_reversible(column: np.ndarray, model: int) -> None:
    column = column - column[0]
    residual, parameters = predict.residuals(column, model)
    assert len(parameters) == predict.PARAMETERS[model]
    assert (predict.backward(predict.unzigzag(predict.zigzag(residual)), model, parameters) == column).all()


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-3], lambda b: b"\x09" + b[1:], lambda b: b"", lambda b: b"\x02\x03abc"]
)
def test_damaged_bytes_are_one_sentence(damage: object) -> None:
    packed = codec.pack([stop(np.random.default_rng(3), 200, (0, 0, 16000))])
    with pytest.raises(LogError):
        codec.unpack(damage(packed))  # type: ignore[operator]
    for bad in (b"frames/1 5 8\nabc", b"frames/2 8\nabc", b"frames/2 0\n", b"frames/3 8\n", b"", b"frames/1 -1 -14\n"):
        with pytest.raises(LogError, match="damaged"):
            plain.from_bytes(bad)
