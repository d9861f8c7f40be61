"""Rounding errors of equal codes: how alike they are, by drawing readings."""

import numpy as np
import pytest

from station.domain.methods.quantisation import correlation


@pytest.mark.parametrize("spread", [0.0, 0.1, 0.3, 1.0, 5.0])
def test_errors_of_equal_codes_are_correlated_as_drawn(spread: float, rng: np.random.Generator) -> None:
    """Two readings anywhere, apart as stated, of which those with one code are taken; four standard errors."""
    n = 400_000
    x = rng.uniform(0, 1000, n)[:, None] + spread * rng.standard_normal((n, 2))
    same = np.round(x[:, 0]) == np.round(x[:, 1])
    error = (np.round(x) - x)[same]
    found = np.corrcoef(error.T)[0, 1]
    assert correlation(spread) == pytest.approx(found, abs=4 / same.sum() ** 0.5 + 2e-3)


def test_readings_that_are_alike_share_their_error_and_far_ones_do_not() -> None:
    assert correlation(0.0) == 1.0
    assert abs(correlation(20.0)) < 1e-3
    assert np.all(np.diff([correlation(s) for s in np.linspace(0, 10, 200)]) <= 1e-12)
