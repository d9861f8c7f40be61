"""Medians of rows are numpy's, to the bit."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from station.domain.core.medians import medians
from station.domain.core.types import Floats

rows = arrays(float, array_shapes(min_dims=1, max_dims=3, max_side=12), elements=st.floats(-1e300, 1e300))


@given(rows)
def test_they_are_numpys(values: Floats) -> None:
    assert np.array_equal(medians(values), np.median(values, axis=-1))


@given(rows)
def test_rows_may_lie_in_any_order(values: Floats) -> None:
    assert np.array_equal(medians(values.T), np.median(values.T, axis=-1))
