"""Coverage factors against tabulated ones (JCGM 100, table G.2, 95 %)."""

import numpy as np
import pytest
from scipy import special

from station.domain.methods import coverage


@pytest.mark.parametrize(("dof", "k"), [(1, 12.71), (5, 2.57), (10, 2.23), (50, 2.01), (1e9, 1.96)])
def test_the_factor_is_the_table_s(dof: float, k: float) -> None:
    assert float(coverage.factor(np.asarray(dof))) == pytest.approx(k, abs=0.005)


def test_the_normal_quantile_belongs_to_the_stated_probability() -> None:
    assert special.ndtri((1 + coverage.PROBABILITY) / 2) == coverage.NORMAL
