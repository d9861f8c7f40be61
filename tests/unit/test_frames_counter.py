"""The counter's tale: losses, repeats, late frames and standing still, with the modulus right."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from station.domain.can.sequence_counter import STUCK_FRAMES, CounterErrors, count_errors, counter_steps

MS = 1_000_000


def _tale(order: list[int], values: int, time_ns: NDArray[np.int64] | None = None) -> CounterErrors:
    """Count over frames numbered without end; by default each arrives at its own millisecond."""
    number = np.array(order)
    when = number * MS if time_ns is None else time_ns
    step = counter_steps((number % values).astype(np.uint64), when, values)
    return count_errors(step, np.zeros(len(step), np.int64))


@pytest.mark.parametrize("values", [15, 16, 256])
def test_an_undisturbed_stream_says_nothing(values: int) -> None:
    assert _tale(list(range(600)), values) == CounterErrors()


@given(values=st.sampled_from([15, 16, 256]), lost=st.sets(st.integers(1, 398), max_size=300))
def test_every_lost_frame_is_counted_even_whole_turns(values: int, lost: set[int]) -> None:
    stored = [i for i in range(400) if i not in lost]
    ends = sum(1 for i in lost if i - 1 not in lost)
    # Where hardly two frames in a row are left, nobody can know the period.
    assume(sum(b - a == 1 for a, b in itertools.pairwise(stored)) >= 50)
    assert _tale(stored, values) == CounterErrors(lost=len(lost), gaps=ends)


def test_fifteen_lost_frames_show_although_the_counter_looks_right() -> None:
    assert _tale([*range(100), *range(115, 200)], 15) == CounterErrors(lost=15, gaps=1)


def test_repeats_are_not_losses() -> None:
    order = [0, 1, 1, 2, 3, 3, 3, 4, 5]
    assert _tale(order, 15, np.arange(9) * MS) == CounterErrors(repeats=3, longest_repeat=2)


def test_swapped_frames_are_late_not_lost() -> None:
    order = [*range(20), 21, 20, *range(22, 40)]
    assert _tale(order, 15, np.arange(40) * MS) == CounterErrors(gaps=2, late=1)


def test_a_counter_that_stands_still_is_stuck() -> None:
    order = [*range(50), *[50] * STUCK_FRAMES]
    found = _tale(order, 15, np.arange(len(order)) * MS)
    assert (found.stuck, found.lost, found.longest_repeat) == (True, 0, STUCK_FRAMES - 1)
    assert not _tale(order[:-1], 15, np.arange(len(order) - 1) * MS).stuck
    assert _tale([7] * 100, 15, np.arange(100) * MS) == CounterErrors(repeats=99, longest_repeat=99)


def test_frames_that_came_with_a_bad_crc_are_not_lost() -> None:
    step = np.array([1, 3, 1, 2])
    assert count_errors(step, np.array([0, 1, 0, 1])) == CounterErrors(lost=1, gaps=1)


def test_batches_of_an_adapter_are_not_losses() -> None:
    """Eight frames share a time stamp: what a USB adapter without clock does."""
    number = np.arange(400)
    assert _tale(list(number), 15, number // 8 * 8 * MS) == CounterErrors()


@pytest.mark.parametrize("frames", [24, 30, 100])
@pytest.mark.parametrize("together", [4, 8, 12])
def test_frames_that_are_handed_over_some_at_a_time_are_not_losses(frames: int, together: int) -> None:
    """Read and stamped late, a transfer's frames lie microseconds apart: a short dwell has three or four of them."""
    number = np.arange(frames)
    time_ns = (number // together + 1) * together * 20 * MS + number % together * 60_000
    assert _tale(list(number), 15, time_ns) == CounterErrors()


@given(seed=st.integers(0, 2**32 - 1))
def test_jitter_of_a_whole_period_is_not_a_loss(seed: int) -> None:
    number = np.arange(300)
    late_ns = np.random.default_rng(seed).uniform(0, MS, 300).astype(np.int64)
    assert _tale(list(number), 15, number * MS + late_ns) == CounterErrors()


@given(first=st.integers(20, 700), held=st.integers(2, 200), seed=st.integers(0, 2**32 - 1))
def test_a_pause_that_is_made_up_for_is_not_a_loss(first: int, held: int, seed: int) -> None:
    """An adapter holds frames back and then hands them over as fast as a USB transfer does."""
    number = np.arange(1000)
    time_ns = number * MS + np.random.default_rng(seed).integers(0, MS // 10, 1000)
    burst = slice(first, first + held)
    time_ns[burst] = (first + held) * MS + np.arange(held) * 1000
    assert _tale(list(number), 15, np.sort(time_ns)) == CounterErrors()


@given(first=st.integers(20, 700), turns=st.integers(1, 6), held=st.integers(2, 150))
def test_whole_turns_lost_within_such_a_pause_still_show(first: int, turns: int, held: int) -> None:
    number = np.concatenate([np.arange(first), np.arange(first + 15 * turns, 1000)])
    time_ns = number * MS
    time_ns[first : first + held] = time_ns[first + held]
    assert _tale(number.tolist(), 15, time_ns) == CounterErrors(lost=15 * turns, gaps=1)


def test_too_few_frames_say_nothing() -> None:
    assert _tale([], 15) == _tale([3], 15) == CounterErrors()
