"""Points of a picture in groups along its axis."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from station.domain.core.types import Floats
from station.reporting.diagnosis.point_groups import group_points


@given(
    arrays(np.float64, st.integers(1, 80), elements=st.floats(-50, 50, width=32)),
    st.integers(1, 12),
    st.booleans(),
)
def test_no_group_reaches_over_a_gap_and_each_point_is_in_one(at: Floats, most: int, even: bool) -> None:
    groups = group_points(at, most, even=even)
    assert groups.size.sum() == len(at)
    assert np.all(groups.size > 0)
    assert np.all(np.diff(groups.mean(at)) > 0)
    # A gap is half a step wide: no more than twice as many islands as steps, each with its rounded share of groups.
    assert len(groups.size) <= max(most, 4 * most)
    if len(np.unique(np.round(at, 9))) > most:
        for g in range(len(groups.size)):
            inside = np.sort(at[groups.code == g])
            assert np.diff(inside).max(initial=0.0) <= np.ptp(at) / (2 * most) * (1 + 1e-6) + 1e-8


@pytest.mark.parametrize("even", [False, True])
def test_points_of_two_temperatures_stand_at_them(even: bool) -> None:
    """Runs at 26 and 35.5 °C: no dot at 32 °C, where none was."""
    rng = np.random.default_rng(1)
    at = np.r_[26.0 + 0.5 * rng.random(29), 35.5 + 0.5 * rng.random(43)]
    where = group_points(at, 8, even=even).mean(at)
    assert np.all((where < 26.5) | (where > 35.5))


def test_evenly_spread_points_are_in_groups_of_as_many() -> None:
    groups = group_points(np.linspace(0, 1, 96), 12, even=True)
    assert groups.size.tolist() == [8.0] * 12
