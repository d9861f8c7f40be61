"""Readings of several messages, by turns, and several to a frame: joined, and every gap of the join counted."""

from itertools import pairwise
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.adapters.dbc.layouts import _frame
from station.domain.can import encode
from station.domain.can.decode import Samples, decode_samples
from station.domain.can.sample_decoder import SampleDecoder
from station.domain.can.sensor_layout import SYNC, FrameMap, SensorLayout, resolve
from station.domain.core.types import EXTENDED, Frames
from station.messages import render

MS, NODE = 1_000_000, 5
DBC = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 385 XY: 8 A
 SG_ COUNT : 0|8@1+ (1,0) [0|255] "" A
 SG_ X : 16|16@1- (0.001,0) [0|0] "g" A
 SG_ Y : 32|16@1- (0.001,0) [0|0] "g" A
BO_ 641 ZT: 4 A
 SG_ COUNT : 0|8@1+ (1,0) [0|255] "" A
 SG_ Z : 23|16@0- (0.001,0) [0|0] "g" A
BO_ 897 TURNS: 4 A
 SG_ AXIS M : 0|8@1+ (1,0) [0|2] "" A
 SG_ MX m0 : 16|16@1- (0.001,0) [0|0] "g" A
 SG_ MY m1 : 16|16@1- (0.001,0) [0|0] "g" A
 SG_ MZ m2 : 16|16@1- (0.001,0) [0|0] "g" A
BO_ 2566844417 LONG: 8 A
 SG_ LX : 0|16@1- (0.001,0) [0|0] "g" A
 SG_ LY : 16|16@1- (0.001,0) [0|0] "g" A
 SG_ LZ : 32|16@1- (0.001,0) [0|0] "g" A
BO_ 900 FD: 20 A
 SG_ N : 0|8@1+ (1,0) [0|255] "" A
 SG_ X0 : 8|16@1- (0.001,0) [0|0] "g" A
 SG_ Y0 : 24|16@1- (0.001,0) [0|0] "g" A
 SG_ Z0 : 40|16@1- (0.001,0) [0|0] "g" A
 SG_ X1 : 56|16@1- (0.001,0) [0|0] "g" A
 SG_ Y1 : 72|16@1- (0.001,0) [0|0] "g" A
 SG_ Z1 : 95|16@0- (0.001,0) [0|0] "g" A
 SG_ X2 : 104|16@1- (0.001,0) [0|0] "g" A
 SG_ Y2 : 120|16@1- (0.001,0) [0|0] "g" A
 SG_ Z2 : 136|16@1- (0.001,0) [0|0] "g" A
"""
TWO: dict[str, Any] = {"message": "XY", "x": "X", "y": "Y", "z": "ZT.Z"}
FD: dict[str, Any] = {"message": "FD", "x": ["X0", "X1", "X2"], "y": ["Y0", "Y1", "Y2"], "z": ["Z0", "Z1", "Z2"]}
DATABASE: Any = cantools.database.load_string(DBC, "dbc", sort_signals=None)


def layout(sample: dict[str, Any], **more: Any) -> SensorLayout:
    roles = FrameMap.model_validate({"dbc": "t.dbc", "sample": sample, **more})
    return resolve(roles, {m.name: _frame(m, None) for m in DATABASE.messages})


COUNTED = layout({**TWO, "counter": "COUNT"})
TIMED = layout(TWO)
SYNCED = layout(TWO, join={"by": "sync"})
TURNS = layout({"message": "TURNS", "x": "MX", "y": "MY", "z": "MZ"})
SEVERAL = layout({**FD, "counter": "N"})


def readings(n: int, seed: int = 1) -> np.ndarray[Any, Any]:
    return np.random.default_rng(seed).integers(-2000, 2000, (n, 3)) * 0.001


def frames_of(of: SensorLayout, xyz: np.ndarray[Any, Any], apart_ns: int = MS // 5, **more: Any) -> Frames:
    """Frames of a unit at 100 Hz; the messages of a reading come one behind the other."""
    made = encode.sample_frames(of, NODE, np.arange(len(xyz)) * 10 * MS, xyz, **more)
    late = {of.id_of(m, NODE): i * apart_ns for i, m in enumerate(of.messages)}
    made.time_ns[:] += np.array([late[int(i)] for i in made.can_id], np.int64)
    return made


def with_sync(frames: Frames, n: int) -> Frames:
    sync = Frames(
        np.arange(n) * 10 * MS - MS, np.full(n, SYNC, np.uint32), np.zeros(n, np.uint8), np.zeros((n, 8), np.uint8)
    )
    both = Frames.join([frames, sync])
    return both[np.argsort(both.time_ns, kind="stable")]


def decoded(frames: Frames, of: SensorLayout) -> Samples:
    return decode_samples(frames, of, NODE)


@pytest.mark.parametrize("of", [COUNTED, TIMED, TURNS])
def test_readings_of_several_messages_come_back(of: SensorLayout) -> None:
    xyz = readings(300)
    found = decoded(frames_of(of, xyz), of)
    np.testing.assert_allclose(found.readings, xyz, atol=1e-12)
    assert found.frame_errors.clean, found.frame_errors


def test_sync_joins_what_follows_it() -> None:
    xyz = readings(50)
    sent = with_sync(frames_of(SYNCED, xyz, apart_ns=8 * MS), 50)
    np.testing.assert_allclose(decoded(sent, SYNCED).readings, xyz, atol=1e-12)
    assert SYNCED.ids(NODE) == (0x185, 0x285, SYNC)
    # By time alone the second message would be nearer to the next reading.
    assert not np.allclose(decoded(sent, TIMED).readings[:40], xyz[:40])


@pytest.mark.parametrize("of", [COUNTED, TIMED, SYNCED])
def test_every_gap_of_a_join_is_counted_and_no_reading_is_mixed(of: SensorLayout) -> None:
    n, rng = 200, np.random.default_rng(3)
    xyz = readings(n)
    sent = frames_of(of, xyz)
    second = np.flatnonzero(sent.can_id == 0x285)
    lost = rng.choice(second[5:-5], 12, replace=False)
    keep = np.ones(len(sent), bool)
    keep[lost] = False
    sent = with_sync(sent[keep], n) if of is SYNCED else sent[keep]
    found = decoded(sent, of)
    assert found.frame_errors.incomplete == 12
    assert not found.frame_errors.clean
    assert "12 readings of which a message is missing" in map(render, found.frame_errors.messages())
    whole = np.setdiff1d(np.arange(n), np.searchsorted(second, lost))
    np.testing.assert_allclose(found.readings, xyz[whole], atol=1e-12)


def test_a_lost_leading_message_is_a_gap_too() -> None:
    sent = frames_of(COUNTED, readings(100))
    lost = np.flatnonzero(sent.can_id == 0x185)[[20, 60]]
    found = decoded(sent[np.setdiff1d(np.arange(len(sent)), lost)], COUNTED).frame_errors
    assert (found.counter.lost, found.incomplete) == (2, 2)


def test_a_second_message_that_never_comes_leaves_no_reading() -> None:
    sent = frames_of(TIMED, readings(100))
    found = decoded(sent[sent.can_id == 0x185], TIMED)
    assert len(found.readings) == 0


def test_a_counter_joins_across_a_pause_that_time_would_not() -> None:
    xyz = readings(100)
    sent = frames_of(COUNTED, xyz, apart_ns=37 * MS)  # nearly four periods behind
    sent = sent[np.argsort(sent.time_ns, kind="stable")]
    found = decoded(sent, COUNTED)
    np.testing.assert_allclose(found.readings, xyz, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    kind=st.sampled_from(["counted", "timed", "synced", "turns", "several"]),
    cuts=st.lists(st.integers(0, 200), max_size=8),
    dwell=st.tuples(st.integers(-50, 700), st.integers(-50, 700)),
)
def test_portions_make_no_difference(seed: int, kind: str, cuts: list[int], dwell: tuple[int, int]) -> None:
    of = {"counted": COUNTED, "timed": TIMED, "synced": SYNCED, "turns": TURNS, "several": SEVERAL}[kind]
    rng = np.random.default_rng(seed)
    sent = frames_of(of, readings(60, seed))
    sent = with_sync(sent[rng.random(len(sent)) > 0.05], 60)
    decoder = SampleDecoder(of, NODE)
    for a, b in pairwise([0, *sorted(c for c in cuts if c < len(sent)), len(sent)]):
        decoder.add(sent[a:b])
    from_ns, to_ns = (t * MS for t in dwell)
    live = decoder.samples(from_ns, to_ns)
    stored = decoded(sent[(sent.time_ns >= from_ns) & (sent.time_ns < to_ns)], of)
    np.testing.assert_array_equal(live.xyz, stored.xyz)
    np.testing.assert_array_equal(live.time_ns, stored.time_ns)
    assert live.frame_errors == stored.frame_errors


def test_several_readings_of_an_fd_frame_have_times_and_counts_of_their_own() -> None:
    xyz = readings(30)
    sent = encode.sample_frames(SEVERAL, NODE, np.arange(30) * MS, xyz, first_count=3 * 7)
    assert (len(sent), sent.data.shape[1], set(sent.length.tolist())) == (10, 64, {20})
    found = decoded(sent, SEVERAL)
    np.testing.assert_allclose(found.xyz, xyz, atol=1e-12)
    np.testing.assert_array_equal(found.time_ns, np.arange(30) * MS)
    assert found.counter is not None
    np.testing.assert_array_equal(found.counter, np.arange(21, 51))
    assert (found.frame_errors.frames, found.frame_errors.clean) == (10, True)
    assert SEVERAL.counter_values == 3 * 256
    assert decoded(sent[[0, 1, 2, 4, 5]], SEVERAL).frame_errors.counter.lost == 1


def test_fd_payloads_are_those_of_cantools() -> None:
    rng = np.random.default_rng(7)
    sent = encode.sample_frames(SEVERAL, NODE, np.arange(30) * MS, readings(30), first_count=int(rng.integers(99)))
    message = DATABASE.get_message_by_name("FD")
    names = [f"{axis}{i}" for i in range(3) for axis in "XYZ"]
    by_cantools = [[message.decode(row[:20].tobytes())[name] for name in names] for row in sent.data]
    np.testing.assert_allclose(decoded(sent, SEVERAL).xyz.reshape(10, 9), by_cantools, atol=1e-12)


def test_long_identifiers_follow_the_node() -> None:
    of = layout({"message": "LONG", "x": "LX", "y": "LY", "z": "LZ"})
    assert of.ids(NODE) == ((0x18FEF001 + 4) | EXTENDED,)
    xyz = readings(20)
    np.testing.assert_allclose(decoded(frames_of(of, xyz), of).readings, xyz, atol=1e-12)


def test_the_readings_are_brought_to_another_unit() -> None:
    of = COUNTED.scaled({"X": 9.0, "Y": 9.0, "ZT.Z": 9.0}, "m/s2")
    xyz = readings(20)
    np.testing.assert_allclose(decoded(frames_of(COUNTED, xyz), of).readings, 9 * xyz, rtol=1e-12)
    assert {axis.unit for axis in of.axes} == {"m/s2"}
