"""Gauge studies against the worked example of AIAG MSA, 4th edition (chapter III, section B)."""

import numpy as np
import pytest

from station.domain.line_quality import msa
from station.errors import UsageError

_A = [
    [0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
    [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
    [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31],
]
_B = [
    [0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
    [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
    [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50],
]
_C = [
    [0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
    [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
    [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16],
]
AIAG = np.array([_A, _B, _C]).transpose(2, 0, 1)


def test_average_and_range_give_the_published_report() -> None:
    study = msa.xbar_r(AIAG)
    # The book rounds R-bar to four digits before it goes on.
    assert study.repeatability == pytest.approx(0.20188, abs=5e-5)
    assert study.reproducibility == pytest.approx(0.22963, abs=5e-5)
    assert study.grr == pytest.approx(0.30575, abs=5e-5)
    assert study.part == pytest.approx(1.10456, abs=5e-5)
    assert study.total == pytest.approx(1.14610, abs=5e-5)
    assert study.percent_grr == pytest.approx(26.68, abs=0.01)
    assert study.ndc == 5
    assert study.judgement == "conditional"


def test_analysis_of_variance_gives_the_published_report() -> None:
    study = msa.anova(AIAG)
    assert study.repeatability == pytest.approx(0.199933, abs=2e-6)
    assert study.reproducibility == pytest.approx(0.226838, abs=2e-6)
    assert study.interaction == 0
    assert study.grr == pytest.approx(0.302373, abs=2e-6)
    assert study.part == pytest.approx(1.042327, abs=2e-6)
    assert study.percent_grr == pytest.approx(27.9, abs=0.05)
    assert study.ndc == 4


def test_a_real_interaction_is_not_pooled(rng: np.random.Generator) -> None:
    cells = rng.normal(size=(10, 3, 1))
    study = msa.anova(10 * rng.normal(size=(10, 1, 1)) + cells + 0.01 * rng.normal(size=(10, 3, 3)))
    # 18 degrees of freedom: the sample deviation stays within a factor of 0.5 to 1.7 at 4 σ.
    assert 0.5 < study.interaction < 1.7
    assert study.repeatability == pytest.approx(0.01, rel=0.4)


def test_type_1_by_hand() -> None:
    study = msa.type1(np.array([1.0, 2.0, 3.0]), reference=1.5, tolerance=60.0)
    assert (study.mean, study.s, study.bias) == (2.0, 1.0, 0.5)
    assert study.cg == pytest.approx(0.2 * 60 / 6)
    assert study.cgk == pytest.approx((0.1 * 60 - 0.5) / 3)
    assert study.t == pytest.approx(0.5 * np.sqrt(3))


@pytest.mark.parametrize("shape", [(1, 2, 2), (5, 3, 1), (4, 4)])
def test_a_study_that_is_too_small_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(UsageError, match="at least 2 parts"):
        msa.anova(np.ones(shape))


def test_readings_that_do_not_vary_are_refused() -> None:
    with pytest.raises(UsageError, match="no variation"):
        msa.xbar_r(np.ones((3, 2, 2)))
    with pytest.raises(UsageError, match="All readings"):
        msa.type1(np.ones(25), 1.0, 1.0)


@pytest.mark.parametrize(("appraisers", "of_people"), [(3, 0.15), (2, 0.0)])
def test_intervals_of_a_gauge_study_hold(rng: np.random.Generator, appraisers: int, of_people: float) -> None:
    """GRR of 400 studies of 10 parts, 3 trials, appraisers who differ or do not; 95 % ± 3 standard errors of 1.1 %."""
    true = np.hypot(0.2, of_people)
    inside = []
    for _ in range(400):
        parts, people = rng.normal(size=(10, 1, 1)), of_people * rng.normal(size=(1, appraisers, 1))
        low, high = msa.anova(parts + people + 0.2 * rng.normal(size=(10, appraisers, 3))).intervals["grr"]
        inside.append(low <= true <= high)
    assert 0.917 < np.mean(inside) < 0.983


def test_the_large_sample_interval_of_one_mean_square_is_that_of_its_chi2() -> None:
    """Exact where one part is all there is; of several equal parts no wider than their sum, no narrower than one."""
    from scipy.stats import chi2

    low, high = msa._large_sample(np.array([4.0]), np.array([7]))
    assert (low, high) == pytest.approx((7 * 4.0 / chi2.ppf(0.975, 7), 7 * 4.0 / chi2.ppf(0.025, 7)))
    both = msa._large_sample(np.array([4.0, 4.0]), np.array([7, 7]))
    assert 2 * low < both[0] < 8 < both[1] < 2 * high
