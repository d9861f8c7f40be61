"""Frames of one node → samples: what was encoded comes back, and every injected fault is found and counted."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from station.adapters.dbc import read_layouts
from station.domain.can.decode import FrameErrors, decode_samples
from station.domain.can.encode import payloads, sample_frames, temperature_frames, to_raw
from station.domain.can.sensor_layout import FrameMap, SensorLayout, resolve
from station.domain.can.sequence_counter import CounterErrors
from station.domain.can.signals import FrameLayout, SignalLayout, decode, raw
from station.domain.core.types import ERROR, EXTENDED, REMOTE, Frames
from station.messages import Message
from tests.portion import examples
from tests.unit.dbc_text import Text, messages
from tests.unit.test_frames_map import BARE, BLOCK, DBC

MS = 1_000_000
LSB_g = 6.25e-5
NODE = 5


@pytest.fixture(scope="module")
def layout() -> SensorLayout:
    """Our own product."""
    return resolve(FrameMap.model_validate(BLOCK), read_layouts(DBC))


def _frames(layout: SensorLayout, n: int = 100, node: int = NODE, **options: Any) -> Frames:
    counts = np.arange(3 * n, dtype=float).reshape(n, 3) - 150
    return sample_frames(layout, node, np.arange(n) * MS, counts * LSB_g, **options)


def steps(xyz: Any) -> Any:
    """Readings as the integers that were sent."""
    return np.rint(xyz / LSB_g).astype(int).tolist()


def _alter(frames: Frames, **columns: Any) -> Frames:
    return replace(frames, **columns)


def test_what_was_encoded_comes_back(layout: SensorLayout) -> None:
    found = decode_samples(_frames(layout, first_count=7, status=3), layout, NODE)
    np.testing.assert_array_equal(found.xyz, (np.arange(300).reshape(100, 3) - 150) * LSB_g)
    assert found.counter is not None and found.status is not None
    np.testing.assert_array_equal(found.counter, (7 + np.arange(100)) % 15)
    assert set(found.status) == {3}
    assert found.usable.all() and found.crc_ok.all()
    assert found.frame_errors == FrameErrors(frames=100) and found.frame_errors.clean
    assert found.frame_errors.messages() == ()


def test_cantools_reads_our_frames(layout: SensorLayout) -> None:
    frames = _frames(layout, 20, node=1)
    database: Any = cantools.database.load_file(DBC)
    message = database.get_message_by_name("ACCELERATION")
    for row in range(20):
        shown = message.decode(frames.data[row].tobytes())
        assert [shown[axis] for axis in "XYZ"] == decode_samples(frames[row : row + 1], layout, 1).xyz[0].tolist()
        assert shown["COUNTER"] == row % 15


def test_only_the_nodes_own_frames_count(layout: SensorLayout) -> None:
    mixed = Frames.join([_frames(layout, 10, node=n) for n in (4, 5, 6)])
    extended = _alter(_frames(layout, 3), can_id=np.full(3, 0x185 | EXTENDED, np.uint32))
    error = _alter(_frames(layout, 3), can_id=np.full(3, 0x185 | ERROR, np.uint32))
    found = decode_samples(Frames.join([mixed, extended, error]), layout, NODE)
    assert (len(found), found.frame_errors) == (10, FrameErrors(frames=10))


def test_a_frame_of_another_node_fails_the_crc(layout: SensorLayout) -> None:
    stray = _alter(_frames(layout, 5, node=4), can_id=np.full(5, 0x185, np.uint32))
    found = decode_samples(stray, layout, NODE)
    assert found.frame_errors.crc_errors == 5
    assert not found.usable.any()


@pytest.mark.parametrize("byte", range(8))
def test_a_flipped_bit_costs_one_sample_and_no_more(layout: SensorLayout, byte: int) -> None:
    frames = _frames(layout)
    frames.data[40, byte] ^= 0x10
    found = decode_samples(frames, layout, NODE)
    assert found.frame_errors == FrameErrors(frames=100, crc_errors=1)
    assert np.flatnonzero(~found.usable).tolist() == [40]
    assert found.frame_errors.messages() == (Message("frames-wrong-crc", count=1),)


def test_wrong_lengths_and_remote_frames_are_counted_and_left_out(layout: SensorLayout) -> None:
    frames = _frames(layout)
    length, can_id = frames.length.copy(), frames.can_id.copy()
    length[[3, 4]] = [7, 0]
    can_id[90] |= np.uint32(REMOTE)
    found = decode_samples(_alter(frames, length=length, can_id=can_id), layout, NODE)
    assert len(found) == 97
    assert found.frame_errors == FrameErrors(
        frames=100, wrong_length=2, remote=1, counter=CounterErrors(lost=3, gaps=2)
    )
    assert not found.frame_errors.clean


def test_lost_repeated_and_late_frames(layout: SensorLayout) -> None:
    frames = _frames(layout)
    order = [*range(20), *range(35, 50), 50, 50, *range(51, 70), 71, 70, *range(72, 100)]
    found = decode_samples(frames[order], layout, NODE)
    assert found.frame_errors.counter == CounterErrors(lost=15, gaps=3, repeats=1, longest_repeat=1, late=1)
    assert np.flatnonzero(~found.usable).tolist() == [36]
    assert found.frame_errors.messages()[0] == Message("frames-lost", count=15, gaps=3)


def test_a_frozen_sensor_is_stuck(layout: SensorLayout) -> None:
    frames = _frames(layout, 30)
    frozen = frames[[*range(20), *[20] * 10]]
    found = decode_samples(_alter(frozen, time_ns=np.arange(30) * MS), layout, NODE)
    assert found.frame_errors.counter.stuck
    assert found.usable.sum() == 21
    assert found.frame_errors.messages()[-1] == Message("counter-stuck")


def test_a_counter_value_that_cannot_be_is_an_error(layout: SensorLayout) -> None:
    frames = _frames(layout, 1)
    frames.data[0, 1] = 15
    frames.data[0, 0] = _crc_p01(0x1A00 + NODE, frames.data[0].tobytes())
    assert decode_samples(frames, layout, NODE).frame_errors.crc_errors == 1


def _crc_p01(data_id: int, frame: bytes) -> int:
    """Profile 1 as long division by x⁸ + x⁴ + x³ + x² + 1."""
    remainder = int.from_bytes(data_id.to_bytes(2, "little") + frame[1:] + b"\0", "big")
    for bit in range(remainder.bit_length() - 1, 7, -1):
        if remainder >> bit & 1:
            remainder ^= 0x11D << (bit - 8)
    return remainder


def test_long_division_agrees_with_what_we_send(layout: SensorLayout) -> None:
    for row in _frames(layout).data:
        assert row[0] == _crc_p01(0x1A00 + NODE, row.tobytes())


def test_readings_are_quantised_half_to_even_and_clipped(layout: SensorLayout) -> None:
    xyz = np.array([[0.5, 1.5, -0.5], [40000, -40000, 32766.6]]) * LSB_g
    frames = sample_frames(layout, NODE, np.arange(2) * MS, xyz)
    assert steps(decode_samples(frames, layout, NODE).xyz) == [[0, 2, 0], [32767, -32768, 32767]]


def test_temperature_comes_with_its_own_times(layout: SensorLayout) -> None:
    warm = temperature_frames(layout, NODE, np.array([5, 900]) * MS, np.array([23.456, -12.0]))
    assert set(warm.can_id) == {0x285} and set(warm.length) == {2}
    found = decode_samples(Frames.join([_frames(layout), warm]), layout, NODE)
    assert found.temperature_time_ns.tolist() == [5 * MS, 900 * MS]
    np.testing.assert_allclose(found.temperature_degC, [23.46, -12.0], rtol=1e-12)


def test_a_bare_sensor_needs_no_counter_crc_or_temperature() -> None:
    bare = resolve(FrameMap.model_validate(BARE), read_layouts(DBC))
    found = decode_samples(_frames(bare), bare, NODE)
    assert (found.counter, found.status, found.frame_errors) == (None, None, FrameErrors(frames=100))
    assert found.usable.all() and not len(found.temperature_degC)
    assert not len(temperature_frames(bare, NODE, np.array([1]), np.array([20.0])))


def test_no_frames_are_no_samples(layout: SensorLayout) -> None:
    found = decode_samples(Frames.empty(), layout, NODE)
    assert (len(found), found.xyz.shape, found.frame_errors) == (0, (0, 3), FrameErrors())


def test_a_reading_that_is_no_number_is_not_usable() -> None:
    signals = tuple(SignalLayout(n, 16 * i, 16, is_float=True) for i, n in enumerate("XYZ"))
    bare = resolve(FrameMap.model_validate(BARE), {"ACCELERATION": FrameLayout("ACCELERATION", 0x181, 6, signals)})
    xyz = np.array([[0.5, 1.0, -1.0], [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]])
    found = decode_samples(sample_frames(bare, 1, np.arange(3) * MS, xyz), bare, 1)
    assert found.usable.tolist() == [True, False, False]
    assert found.frame_errors == FrameErrors(frames=3, not_finite=2)
    np.testing.assert_array_equal(found.xyz, xyz)


@pytest.mark.parametrize("mode", ["both", "alt", "low", "nibble"])
def test_every_mode_protects_and_checks(mode: str) -> None:
    sample = {**BLOCK["sample"]} if mode != "nibble" else {k: v for k, v in BLOCK["sample"].items() if k != "status"}
    block = {**BLOCK, "sample": sample, "e2e": {"profile": "P01", "mode": mode, "data_id": 0x0A77}}
    layout = resolve(FrameMap.model_validate(block), read_layouts(DBC))
    frames = _frames(layout)
    assert decode_samples(frames, layout, NODE).frame_errors.clean
    frames.data[::2, 2] ^= 1
    assert decode_samples(frames, layout, NODE).frame_errors.crc_errors == 50


def test_profile_2_counts_to_fifteen() -> None:
    block = {**BLOCK, "counter_values": None, "e2e": {"profile": "P02", "data_ids": list(range(16))}}
    layout = resolve(FrameMap.model_validate(block), read_layouts(DBC))
    found = decode_samples(_frames(layout), layout, NODE)
    assert found.frame_errors.clean
    assert found.counter is not None and found.counter.max() == 15


@settings(max_examples=examples(100), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=messages(), seed=st.integers(0, 2**32 - 1))
def test_payloads_are_the_inverse_of_decoding(text: Text, seed: int, tmp_path: Path) -> None:
    """Raw bits survive a round trip through physical values wherever a float can hold them."""
    layout = text.layout(tmp_path)
    random = np.frombuffer(np.random.default_rng(seed).bytes(8 * 20), np.uint8).reshape(20, 8).copy()
    random[:, layout.length :] = 0
    frames = Frames(np.arange(20), np.full(20, layout.can_id, np.uint32), np.full(20, layout.length, np.uint8), random)
    values = decode(frames, layout).values
    again = payloads(layout, values)
    for signal in layout.signals:
        before = raw(random, signal)
        if not signal.is_float and signal.length <= 24 and abs(signal.offset) < 1e6:
            np.testing.assert_array_equal(raw(again, signal), before)


def test_raw_limits_hold_at_64_bits() -> None:
    unsigned, signed = SignalLayout("U", 0, 64), SignalLayout("S", 0, 64, signed=True)
    assert to_raw(np.array([-1.0, 1e30]), unsigned).tolist() == [0, 2**64 - 1]
    assert to_raw(np.array([-1e30, 1e30]), signed).tolist() == [-(2**63), 2**63 - 1]


def test_an_empty_block_has_the_right_shape(layout: SensorLayout) -> None:
    none = sample_frames(layout, NODE, np.zeros(0, np.int64), np.zeros((0, 3)))
    assert (len(none), none.data.shape) == (0, (0, 8))
