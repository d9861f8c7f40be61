"""Frames decoded as they come in are the frames decoded at once, however they are cut into portions."""

from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.adapters.dbc import read_layouts
from station.config.products import load_product
from station.config.search_path import shipped_folder
from station.domain.can import encode
from station.domain.can.decode import Samples, decode_samples
from station.domain.can.sample_decoder import SampleDecoder
from station.domain.can.sensor_layout import SensorLayout, resolve
from station.domain.capture.visit import CapturedVisit, decode_visit, dwell_frames
from station.domain.core.types import REMOTE, Frames

NODE, MS = 17, 1_000_000


def layout_of(product: str) -> SensorLayout:
    frames = load_product(product, None).frames
    return resolve(frames, read_layouts(Path(shipped_folder(), "dbc", frames.dbc)))


LAYOUT = layout_of("accelerometer")


def assert_same(a: Samples, b: Samples) -> None:
    for field in fields(Samples):
        mine, other = getattr(a, field.name), getattr(b, field.name)
        if isinstance(mine, np.ndarray):
            np.testing.assert_array_equal(mine, other, err_msg=field.name)
            assert mine.dtype == other.dtype, field.name
        else:
            assert mine == other, field.name


def recording(seed: int, n: int) -> Frames:
    """Frames of two nodes with broken, repeated, remote and short ones among them, and temperatures."""
    rng = np.random.default_rng(seed)
    time_ns = np.arange(n) * MS
    parts = [encode.sample_frames(LAYOUT, node, time_ns + node, rng.normal(size=(n, 3)) * 0.1) for node in (NODE, 18)]
    parts.append(encode.temperature_frames(LAYOUT, NODE, time_ns[::7] + 500, rng.uniform(20, 30, len(time_ns[::7]))))
    joined = Frames.join(parts)
    data, can_id, length = joined.data.copy(), joined.can_id.copy(), joined.length.copy()
    if n > 4:
        data[rng.integers(0, n, 2), 3] ^= 1
        data[rng.integers(1, n)] = data[0]
        can_id[rng.integers(0, n)] |= np.uint32(REMOTE)
        length[rng.integers(0, n)] = 3
    frames = replace(joined, data=data, can_id=can_id, length=length)
    return frames[np.argsort(frames.time_ns, kind="stable")]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    n=st.integers(0, 60),
    cuts=st.lists(st.integers(0, 200), max_size=8),
    dwell=st.tuples(st.integers(-5, 70), st.integers(-5, 70)),
)
def test_portions_make_no_difference(seed: int, n: int, cuts: list[int], dwell: tuple[int, int]) -> None:
    frames = recording(seed, n)
    from_ns, to_ns = dwell[0] * MS, dwell[1] * MS
    captured = CapturedVisit(0, 0, "z-up", "home", 0, from_ns, to_ns, frames)
    decoder = SampleDecoder(LAYOUT, NODE)
    edges = [0, *sorted(c for c in cuts if c < len(frames)), len(frames)]
    for a, b in pairwise(edges):
        decoder.add(frames[a:b])
    live, stored = decoder.samples(from_ns, to_ns), decode_visit(captured, LAYOUT, NODE).samples
    assert_same(live, stored)
    assert_same(decoder.samples(), decode_samples(frames, LAYOUT, NODE))
    at_once = decode_samples(dwell_frames(captured), LAYOUT, NODE)
    np.testing.assert_array_equal(live.readings, at_once.readings)
    assert live.frame_errors == at_once.frame_errors
    np.testing.assert_array_equal(decoder.recent(from_ns).xyz, decoder.samples(from_ns).xyz)
    np.testing.assert_array_equal(decoder.newest().xyz, decode_samples(frames[edges[-2] :], LAYOUT, NODE).xyz)


@pytest.mark.parametrize("product", ["accelerometer", "magnetometer", "gyroscope"])
def test_a_silent_node_reads_nothing(product: str) -> None:
    layout = layout_of(product)
    decoder = SampleDecoder(layout, NODE)
    assert_same(decoder.samples(), decode_samples(Frames.empty(), layout, NODE))
    assert len(decoder.newest()) == len(decoder.recent(0)) == 0


def test_what_is_old_can_be_forgotten() -> None:
    frames = recording(1, 40)
    decoder = SampleDecoder(LAYOUT, NODE)
    for part in (frames[:30], frames[30:60], frames[60:]):
        decoder.add(part)
    since_ns = int(frames.time_ns[45])
    before = decoder.recent(since_ns)
    decoder.forget(since_ns)
    after = decoder.recent(since_ns)
    np.testing.assert_array_equal(after.xyz, before.xyz)
    assert after.frame_errors == before.frame_errors
    assert len(before) > 0
    assert len(decoder.samples()) < 40
