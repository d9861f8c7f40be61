"""Control charts and capability: published examples, known answers, and algebra."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.core.types import Floats
from station.domain.line_quality import capability, spc
from station.errors import UsageError

# Montgomery, Introduction to SQC, table 6.1 first ten samples of flow width; R̄ and x̄ worked by hand here.
FLOW = np.array(
    [
        [1.3235, 1.4128, 1.6744, 1.4573, 1.6914],
        [1.4314, 1.3592, 1.6075, 1.4666, 1.6109],
        [1.4284, 1.4871, 1.4932, 1.4324, 1.5674],
        [1.5028, 1.6352, 1.3841, 1.2831, 1.5507],
        [1.5604, 1.2735, 1.5265, 1.4363, 1.6441],
    ]
)


def test_a_mean_and_range_chart_by_hand() -> None:
    location, spread = spc.charts(FLOW)
    ranges = [0.3679, 0.2517, 0.1390, 0.3521, 0.3706]
    assert spread.centre == pytest.approx(np.mean(ranges))
    assert spread.upper == pytest.approx(2.114 * np.mean(ranges), rel=2e-3)  # D4 for n = 5
    assert location.upper - location.centre == pytest.approx(0.577 * np.mean(ranges), rel=2e-3)  # A2 for n = 5


@pytest.mark.parametrize(("n", "published"), [(2, 0.7979), (5, 0.9400), (10, 0.9727), (25, 0.9896)])
def test_c4_matches_the_tables(n: int, published: float) -> None:
    assert spc.c4(n) == pytest.approx(published, abs=5e-5)


@pytest.mark.parametrize(
    ("z", "rule"),
    [
        ([0, 0, 3.1], "beyond 3σ"),
        ([2.1, 0, 2.1], "two of three beyond 2σ"),
        ([1.1, 1.1, 0, 1.1, 1.1], "four of five beyond 1σ"),
        ([0.1] * 9, "nine on a side"),
        ([-0.1] * 9, "nine on a side"),
        ([2.1, 2.1], "two of three beyond 2σ"),
        ([-1.1] * 4, "four of five beyond 1σ"),
    ],
)
def test_each_rule_of_zones_fires_on_its_last_point(z: list[float], rule: str) -> None:
    assert (len(z) - 1, rule) in spc.nelson(np.array(z), 0.0, 1.0)


def test_eight_on_a_side_are_not_nine() -> None:
    assert spc.nelson(np.array([0.1] * 8), 0.0, 1.0) == ()


def test_the_individuals_chart_of_the_nist_handbook() -> None:
    """Flow rates of ten batches (NIST/SEMATECH e-Handbook, 6.3.2.2): centre 50.81, limits 45.8159 and 55.8041."""
    flow = np.array([[49.6], [47.6], [49.9], [51.3], [47.8], [51.2], [52.6], [52.4], [53.6], [52.1]])
    location, spread = spc.charts(flow)
    assert location.centre == pytest.approx(50.81)
    assert spread.centre == pytest.approx(1.8778, abs=5e-5)
    assert [location.lower, location.upper] == pytest.approx([45.8159, 55.8041], abs=1e-4)
    assert location.alarms == spread.alarms == ()


def _with(mean: float, s: float, n: int) -> Floats:
    """n values of exactly that mean and standard deviation."""
    x = np.linspace(-1, 1, n)
    return np.asarray((mean + s * (x - x.mean()) / x.std(ddof=1))[:, None])


def test_intervals_of_the_textbook() -> None:
    """Montgomery, Statistical Quality Control, examples 8.4 and 8.5: n = 20, limits 38 and 62, s = 1.75:
    Cp between 1.57 and 3.01; a Cpk of 1.33 between 0.88 and 1.78 (by a normal approximation)."""
    found = capability.capability(_with(50.0, 1.75, 20), 38.0, 62.0)
    assert found.pp == pytest.approx((2.29, 1.57, 3.01), abs=0.006)
    s = 1.0
    one_sided = capability.capability(_with(0.0, s, 20), None, 3 * 1.33 * s)
    assert one_sided.ppk == pytest.approx((1.33, 0.88, 1.78), abs=0.02)


def test_opposite_sides_do_not_add_up() -> None:
    assert spc.nelson(np.array([2.1, 0, -2.1]), 0.0, 1.0) == ()


def test_capability_knows_within_from_overall(rng: np.random.Generator) -> None:
    groups = rng.normal(size=(200, 5)) + 2 * rng.normal(size=(200, 1))
    result = capability.capability(groups, -10, 10)
    assert result.sigma_within == pytest.approx(1.0, rel=0.1)  # 5 σ of a mean of 200 ranges is 9 %
    assert result.sigma_overall > 2
    assert result.cp is not None
    assert result.pp is not None
    assert result.cp[0] > result.pp[0]
    assert result.cpk[1] < result.cpk[0] < result.cpk[2]


def test_capability_by_hand() -> None:
    result = capability.capability(np.array([[1.0], [2.0], [3.0]]), 0.0, 4.0)
    assert result.sigma_overall == 1.0
    assert result.pp is not None
    assert result.pp[0] == pytest.approx(4 / 6)
    assert result.ppk[0] == pytest.approx(2 / 3)


@given(st.floats(0.1, 10), st.floats(-5, 5))
def test_capability_does_not_depend_on_units(scale: float, shift: float) -> None:
    a, b = (
        capability.capability(g, lo, hi)
        for g, lo, hi in [(FLOW, 1, 2), (FLOW * scale + shift, scale + shift, 2 * scale + shift)]
    )
    assert b.cpk[0] == pytest.approx(a.cpk[0], rel=1e-9)


@pytest.mark.parametrize("size", [1, 2, 5, 10])
def test_capability_intervals_hold(rng: np.random.Generator, size: int) -> None:
    """95 % of 600 draws, ± 3 standard errors (2.7 %); Cpk off the middle, where one limit decides."""
    draws = rng.normal(size=(600, 60 // size + 2, size))
    found = [capability.capability(d, -3, 6) for d in draws]
    assert 0.923 < np.mean([(c := r.cp) is not None and c[1] <= 1.5 <= c[2] for r in found]) < 0.977
    assert 0.923 < np.mean([r.cpk[1] <= 1.0 <= r.cpk[2] for r in found]) < 0.977


def test_a_skew_process_is_read_by_percentiles(rng: np.random.Generator) -> None:
    values = np.exp(0.6 * rng.normal(size=(400, 1)))
    true = (12.0 - 1.0) / (np.exp(0.6 * 3) - 1.0)
    found = capability.capability(values, None, 12.0)
    assert found.normality < 0.01 and found.percentile is not None
    # The 99.865 % point of 400 values is known to about 15 %.
    assert found.percentile == pytest.approx(true, rel=0.3)
    assert found.ppk[0] > 1.3 * found.percentile


def test_the_normality_test_keeps_its_level(rng: np.random.Generator) -> None:
    p = np.array([capability.normality(x) for x in rng.normal(size=(2000, 50))])
    assert (p < 0.05).mean() == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 2000))


@pytest.mark.parametrize(
    ("points", "rule"),
    [
        ([0, 0.1, 0.2, 0.3, 0.4, 0.5], "six in a trend"),
        ([0.5, -0.5] * 7, "fourteen alternating"),
        ([0.2] * 8 + [-0.2] * 7, "fifteen within 1σ"),
        ([1.5, -1.5] * 4, "eight beyond 1σ on both sides"),
    ],
)
def test_nelsons_further_rules(points: list[float], rule: str) -> None:
    assert (len(points) - 1, rule) in spc.nelson(np.array(points), 0.0, 1.0)


def test_data_that_cannot_be_charted_are_refused() -> None:
    with pytest.raises(UsageError, match="two subgroups"):
        spc.charts(np.ones((1, 5)))
    with pytest.raises(UsageError, match="vary"):
        capability.capability(np.ones((5, 5)), 0, 2)
    with pytest.raises(UsageError, match="limit"):
        capability.capability(FLOW, None, None)
