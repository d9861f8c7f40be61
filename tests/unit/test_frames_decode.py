"""Bulk decoding agrees with cantools, value for value, on random DBCs and payloads."""

from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from station.domain.can.signals import FrameLayout, SignalLayout, are_adjacent, decode, physical, raw, raw_words
from station.domain.core.types import ERROR, EXTENDED, REMOTE, Frames
from station.errors import ProductError
from tests.portion import examples
from tests.unit.dbc_text import Text, messages

MANY = settings(max_examples=examples(150), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
SPECIAL = [bytes(64), b"\xff" * 64, b"\x80" + bytes(63), bytes(7) + b"\x80" + bytes(56), b"\x7f" + b"\xff" * 63]


def _frames(can_id: int, payloads: list[bytes], width: int = 8) -> Frames:
    n = len(payloads)
    data = np.frombuffer(b"".join(p.ljust(width, b"\0") for p in payloads), np.uint8).reshape(n, width)
    lengths = np.array([len(p) for p in payloads], np.uint8)
    return Frames(np.arange(n) * 1_000_000, np.full(n, can_id, np.uint32), lengths, data)


def _load(text: Text, folder: Path) -> tuple[Any, FrameLayout]:
    database: Any = cantools.database.load_string(text.dbc(), "dbc")
    return database.messages[0], text.layout(folder)


def _same(ours: Any, theirs: Any) -> bool:
    return bool(ours == theirs or float(ours) == float(theirs) or (np.isnan(ours) and np.isnan(theirs)))


@MANY
@given(text=messages(), seed=st.integers(0, 2**32 - 1))
def test_plain_signals_of_either_byte_order_agree(text: Text, seed: int, tmp_path: Path) -> None:
    message, layout = _load(text, tmp_path)
    random = np.random.default_rng(seed)
    payloads = [p[: text.length] for p in SPECIAL] + [random.bytes(text.length) for _ in range(10)]
    decoded = decode(_frames(layout.can_id, payloads), layout)
    assert decoded.rows.tolist() == list(range(len(payloads)))
    for row, payload in enumerate(payloads):
        expected = message.decode(payload)
        assert set(expected) == set(decoded.values)
        for name, value in expected.items():
            assert _same(decoded.values[name][row], value), (name, payload.hex())


@MANY
@given(text=messages(longest=64), seed=st.integers(0, 2**32 - 1))
def test_long_frames_agree_too(text: Text, seed: int, tmp_path: Path) -> None:
    message, layout = _load(text, tmp_path)
    payloads = [np.random.default_rng(seed).bytes(text.length) for _ in range(5)]
    decoded = decode(_frames(layout.can_id, payloads, 64), layout)
    for row, payload in enumerate(payloads):
        for name, value in message.decode(payload).items():
            assert _same(decoded.values[name][row], value), (name, payload.hex())


@MANY
@given(text=messages(multiplexed=True), seed=st.integers(0, 2**32 - 1))
def test_multiplexed_signals_are_there_when_cantools_says_so(text: Text, seed: int, tmp_path: Path) -> None:
    message, layout = _load(text, tmp_path)
    random = np.random.default_rng(seed)
    selectors = [*sorted({v for s in layout.signals if s.selector == "M" for v in s.selected_by}), 255]
    heads = [bytes([m, n << 4]) for m in selectors for n in (0, 3, 5, 9, 15)]
    payloads = [head + random.bytes(text.length - 2) for head in heads]
    decoded = decode(_frames(layout.can_id, payloads), layout)
    for row, payload in enumerate(payloads):
        there = {n: v[row] for n, v in decoded.values.items() if n not in decoded.present or decoded.present[n][row]}
        try:
            expected = message.decode(payload)
        except cantools.database.DecodeError:  # a selector value without signals: what hangs on it is absent
            assert not any(n.startswith("Q") for n in there)
            continue
        assert set(there) == set(expected)
        assert all(_same(there[name], value) for name, value in expected.items())


def test_half_precision_floats_agree_with_numpy() -> None:
    values = np.array([0.0, -0.0, 1.0, -1.5, 65504.0, 6e-8, np.inf, np.nan], np.float16)
    for big in (False, True):
        signal = SignalLayout("H", 7 if big else 0, 16, big_endian=big, is_float=True)
        data = np.zeros((len(values), 8), np.uint8)
        data[:, :2] = values.astype(">f2" if big else "<f2").view(np.uint8).reshape(-1, 2)
        np.testing.assert_array_equal(raw(data, signal), values.astype(float))


@pytest.mark.parametrize("scale", [1, 3e300])
def test_a_signalling_nan_and_an_overflow_decode_without_a_warning(scale: float) -> None:
    payloads = [bytes.fromhex("0000a07f"), bytes.fromhex("ffff7f7f")]
    signal = SignalLayout("S", 0, 32, False, False, True, scale, 0, None, None, "", None)
    values = physical(raw(_frames(1, payloads).data, signal), signal)
    assert np.isnan(values[0])
    assert values[1] == (np.inf if scale > 1 else np.float64(np.finfo(np.float32).max))


def test_integers_too_large_for_a_word_are_rounded_once() -> None:
    signal = SignalLayout("L", 0, 64, scale=3, offset=1)
    value = np.array([2**64 - 1], np.uint64)
    assert physical(value, signal)[0] == float(3 * (2**64 - 1) + 1)


def test_only_whole_data_frames_of_that_identifier_are_decoded() -> None:
    layout = FrameLayout("F", 0x123, 2, (SignalLayout("A", 0, 16),))
    can_id = np.array([0x123, 0x124, 0x123 | REMOTE, 0x123 | ERROR, 0x123 | EXTENDED, 0x123, 0x123], np.uint32)
    length = np.array([2, 2, 2, 2, 2, 1, 8], np.uint8)
    frames = Frames(np.arange(7), can_id, length, np.ones((7, 8), np.uint8))
    decoded = decode(frames, layout)
    assert decoded.rows.tolist() == [0, 6]
    assert decoded.values["A"].tolist() == [0x0101, 0x0101]
    assert len(decode(Frames.empty(), layout).rows) == 0


def test_a_missing_signal_lists_the_known_ones() -> None:
    layout = FrameLayout("F", 0x123, 2, (SignalLayout("A", 0, 8), SignalLayout("B", 8, 8)))
    with pytest.raises(ProductError, match="message F has no signal C; its signals are A, B"):
        layout.signal("C")


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("length", [8, 16, 32])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("width", [8, 64])
def test_words_side_by_side_are_read_at_once_as_one_by_one(
    big_endian: bool, length: int, signed: bool, width: int
) -> None:
    data = np.random.default_rng(length).integers(0, 256, (50, width), dtype=np.uint8)
    starts = [n * length + (7 if big_endian else 0) for n in range(8 * width // length)]
    signals = [SignalLayout("s", s, length, big_endian, signed, scale=0.1, offset=-0.5) for s in starts]
    assert are_adjacent(signals)
    one_by_one = np.stack([physical(raw(data, s), s) for s in signals], axis=1)
    for first in (0, 1):
        together = raw_words(data, signals[first], len(signals) - first)
        np.testing.assert_array_equal(physical(together, signals[0]), one_by_one[:, first:])


def test_signals_of_different_scale_place_or_kind_are_not_read_at_once() -> None:
    word = SignalLayout("x", 0, 16)
    others = [
        SignalLayout("y", 32, 16),
        SignalLayout("y", 16, 16, scale=2),
        SignalLayout("y", 16, 16, signed=True),
        SignalLayout("y", 16, 8),
    ]
    assert not any(are_adjacent([word, other]) for other in others)
    assert not are_adjacent([SignalLayout("x", 4, 16), SignalLayout("y", 20, 16)])
    assert not are_adjacent([SignalLayout("x", 0, 32, is_float=True), SignalLayout("y", 32, 32, is_float=True)])
