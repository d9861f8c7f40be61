"""Weights of a time constant: those of a Gauss curve, of what the data do not tell, and of a lopsided peak."""

import math

import numpy as np
import pytest

from station.diagnosis.candidates.shape import FormEstimate
from station.diagnosis.results.form_posterior import weigh

WIDE = (math.log(0.1), math.log(1000.0))


@pytest.mark.parametrize("spread", [0.02, 0.1, 0.5])
def test_a_gauss_curve_gives_its_middle_and_its_deviation_back(spread: float) -> None:
    found = weigh(
        FormEstimate("tau_s", 10.0, 10.0 * spread), WIDE, lambda x: -0.5 * ((x - math.log(10.0)) / spread) ** 2
    )
    # Beyond the last values, 6 nats or 3.5 deviations down, lies less than a thousandth of the curve.
    assert math.log(found.estimate.value) == pytest.approx(math.log(10.0), abs=1e-9)
    assert found.estimate.std / found.estimate.value == pytest.approx(spread, rel=0.01)
    assert found.weights.sum() == pytest.approx(1.0)


def test_what_the_data_do_not_tell_may_be_anything_within_the_bounds() -> None:
    found = weigh(FormEstimate("tau_s", 10.0, 1.0), WIDE, lambda _: 3.0)
    low, high = np.log(found.values.min()), np.log(found.values.max())
    assert found.estimate.std / found.estimate.value == pytest.approx((high - low) / math.sqrt(12), rel=0.05)
    assert (WIDE[0] <= low, high <= WIDE[1]) == (True, True)


def test_a_best_value_at_the_edge_is_no_more_than_the_end_of_what_it_may_be() -> None:
    """The evidence falls by a nat in three of the logarithm: the mean lies well within."""
    edge = WIDE[0]
    found = weigh(FormEstimate("tau_s", math.exp(edge), math.exp(edge)), WIDE, lambda x: -(x - edge) / 3)
    length = WIDE[1] - edge
    mean = 3 - length / (math.exp(length / 3) - 1)
    assert math.log(found.estimate.value) - edge == pytest.approx(mean, abs=0.4)


def test_a_value_that_nothing_stands_beside_keeps_its_curvature() -> None:
    found = weigh(FormEstimate("tau_s", 10.0, 5.0), (math.log(9.0), math.log(11.0)), lambda _: 0.0)
    assert found.estimate.value == pytest.approx(10.0)
    assert found.estimate.std == pytest.approx(5.0)
