"""Two levels or any size: what jumps is told from what scatters along one direction."""

import numpy as np
import pytest

from station.diagnosis.search.two_levels import levels_ahead


@pytest.mark.parametrize("share", [0.5, 0.2])
def test_two_levels_are_ahead_of_a_spread(share: float, rng: np.random.Generator) -> None:
    found = [levels_ahead(4.0 * (rng.random(24) < share) + rng.standard_normal(24), 1.0) for _ in range(40)]
    assert np.mean(np.array(found) > 0) > 0.9


def test_a_spread_is_ahead_of_two_levels(rng: np.random.Generator) -> None:
    found = [levels_ahead(3.0 * rng.standard_normal(72), 1.0) for _ in range(40)]
    # By chance one in a hundred looks like two.
    assert np.mean(np.array(found) > 0) < 0.1
