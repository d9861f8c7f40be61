"""Known columns that tell the same: the calibration has what any of them does."""

import numpy as np
import pytest

from station.diagnosis.candidates.solve import with_most_in_first


def test_what_two_columns_say_alike_is_in_the_first_ones() -> None:
    """The speed of a rate table is all gains alike, but for what the Earth adds to the last digit."""
    rng = np.random.default_rng(11)
    gains, other = rng.standard_normal((1, 40, 3)), rng.standard_normal((1, 40, 1))
    speed = 1e-4 * gains.sum(axis=2, keepdims=True) + 1e-10 * rng.standard_normal((1, 40, 1))
    columns = np.concatenate([gains, speed, other], axis=2)
    shared = np.array([[0.857, 0.857, 0.857, -8.56e3, 0.3]])
    moved = with_most_in_first(columns, shared, 3)
    does = np.einsum("ump,up->um", columns, shared)
    assert np.einsum("ump,up->um", columns, moved) == pytest.approx(does, abs=1e-4)
    assert moved[0, :3] == pytest.approx([0.001] * 3, abs=1e-6)
    assert moved[0, 3] == pytest.approx(0.0, abs=1e-2)
    assert moved[0, 4] == pytest.approx(0.3, abs=1e-5)


def test_columns_that_differ_keep_what_they_have() -> None:
    rng = np.random.default_rng(12)
    columns, own = rng.standard_normal((2, 30, 4)), rng.standard_normal((2, 4))
    assert np.array_equal(with_most_in_first(columns, own, 2), own)
