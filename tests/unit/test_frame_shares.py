"""Shares of lost frames: their intervals hold, whether frames are lost one by one or in bursts."""

import numpy as np
import pytest

from station.diagnosis.data.faults.counters import _share_std

FRAMES, VISITS, SETS = 100, 24, 400


@pytest.mark.parametrize(("burst", "least"), [(1, 0.93), (4, 0.90)])
def test_the_interval_of_a_share_covers(burst: int, least: float) -> None:
    rng = np.random.default_rng(burst)
    held = 0
    for _ in range(SETS):
        share = np.exp(rng.uniform(np.log(0.002), np.log(0.05)))
        # As many bursts as come by chance, each of frames of one visit.
        events = burst * rng.binomial(FRAMES // burst, share, VISITS)
        held += abs(events.sum() / (FRAMES * VISITS) - share) < 1.96 * _share_std(events, np.full(VISITS, FRAMES))
    # Three deviations of the count below what is asked for; bursts of four of few frames are counted with difficulty.
    assert held > least * SETS - 3 * np.sqrt(SETS * least * (1 - least))


def test_no_event_leaves_a_share_that_three_frames_in_the_count_would_show() -> None:
    """Of n frames none was lost: 3/n is where that has a chance of 5 %."""
    std = _share_std(np.zeros(6, int), np.full(6, 50))
    assert 0.9 < 1.96 * std / (3 / 300) < 1.1
