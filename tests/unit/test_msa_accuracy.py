"""Type-1, bias and linearity studies against published sets."""

import numpy as np
import pytest
from scipy.stats import linregress

from station.domain.line_quality import msa
from station.domain.line_quality.accuracy import bias_study, linearity
from station.errors import UsageError

#: AIAG MSA, 4th edition, table III-B 1: fifteen readings of a reference of 6.00.
BIAS = np.array([5.8, 5.7, 5.9, 5.9, 6.0, 6.1, 6.0, 6.1, 6.4, 6.3, 6.0, 6.1, 6.2, 5.6, 6.0])
#: Its table III-B 4: twelve readings of each of five references.
REFERENCES = np.repeat([2.0, 4.0, 6.0, 8.0, 10.0], 12)
LINEARITY = np.array(
    [
        *(2.7, 2.5, 2.4, 2.5, 2.7, 2.3, 2.5, 2.5, 2.4, 2.4, 2.6, 2.4),
        *(5.1, 3.9, 4.2, 5.0, 3.8, 3.9, 3.9, 3.9, 3.9, 4.0, 4.1, 3.8),
        *(5.8, 5.7, 5.9, 5.9, 6.0, 6.1, 6.0, 6.1, 6.4, 6.3, 6.0, 6.1),
        *(7.6, 7.7, 7.8, 7.7, 7.8, 7.8, 7.8, 7.7, 7.8, 7.5, 7.6, 7.7),
        *(9.1, 9.3, 9.5, 9.3, 9.4, 9.5, 9.5, 9.5, 9.6, 9.2, 9.3, 9.4),
    ]
)
#: Michelson's hundred determinations of the speed of light, 1879, Mm/s less 299, times 1000 (NIST StRD, Michelso).
MICHELSON = [
    850, 740, 900, 1070, 930, 850, 950, 980, 980, 880, 1000, 980, 930, 650, 760, 810, 1000, 1000, 960, 960,
    960, 940, 960, 940, 880, 800, 850, 880, 900, 840, 830, 790, 810, 880, 880, 830, 800, 790, 760, 800,
    880, 880, 880, 860, 720, 720, 620, 860, 970, 950, 880, 910, 850, 870, 840, 840, 850, 840, 840, 840,
    890, 810, 810, 820, 800, 770, 760, 740, 750, 760, 910, 920, 890, 860, 880, 720, 840, 850, 850, 780,
    890, 840, 780, 810, 760, 810, 790, 810, 820, 850, 870, 870, 810, 740, 810, 940, 950, 800, 810, 870,
]  # fmt: skip
#: Its certified mean and standard deviation.
CERTIFIED_MEAN, CERTIFIED_STD = 299.852400000000, 0.0790105478190518


def test_type_1_by_certified_figures() -> None:
    """Cg and Cgk of Michelson's readings, by the mean and deviation that NIST certifies to fifteen digits."""
    readings, reference, tolerance = 299 + np.array(MICHELSON) / 1000, 299.792458, 5.0
    study = msa.type1(readings, reference, tolerance)
    assert study.mean == pytest.approx(CERTIFIED_MEAN, rel=1e-14) and study.s == pytest.approx(CERTIFIED_STD, rel=1e-11)
    assert study.cg == pytest.approx(0.2 * tolerance / (6 * CERTIFIED_STD), rel=1e-11)
    assert study.cgk == pytest.approx((0.1 * tolerance - (CERTIFIED_MEAN - reference)) / (3 * CERTIFIED_STD), rel=1e-11)
    assert bias_study(readings, reference).judgement == "biased"


def test_the_published_bias_study() -> None:
    """Bias 0.0067, not significant. The book estimates the deviation by the range, 0.2251; by readings it is 0.2120."""
    found = bias_study(BIAS, 6.0)
    assert found.bias == pytest.approx(0.0067, abs=5e-5) and found.s == pytest.approx(0.2120, abs=5e-5)
    assert found.p > 0.9 and found.judgement == "no bias evident"
    assert found.half == pytest.approx(2.14479 * found.s / 15**0.5, rel=1e-5)


def test_the_published_linearity_study() -> None:
    """Slope −0.1317, intercept 0.7367, R² 71.4 %, t −12.043 and 10.158."""
    found = linearity(REFERENCES, LINEARITY)
    assert found.slope == pytest.approx(-0.1317, abs=5e-5) and found.intercept == pytest.approx(0.7367, abs=5e-5)
    assert found.r2 == pytest.approx(0.714, abs=5e-4)
    assert found.slope_t == pytest.approx(-12.043, abs=5e-4) and found.intercept_t == pytest.approx(10.158, abs=5e-4)
    assert found.judgement == "biased over the range"
    assert [f.mean for f in found.fitted] == pytest.approx([0.491667, 0.125, 0.025, -0.291667, -0.616667], abs=1e-6)
    line = linregress(REFERENCES, LINEARITY - REFERENCES)
    assert found.slope_half == pytest.approx(2.00172 * line.stderr, rel=1e-5)


def test_no_bias_is_found_as_rarely_as_stated(rng: np.random.Generator) -> None:
    draws = 6.0 + rng.standard_normal((400, 10))
    wrong = np.mean([bias_study(x, 6.0).judgement == "biased" for x in draws])
    assert wrong == pytest.approx(0.05, abs=4 * (0.05 * 0.95 / 400) ** 0.5)


def test_what_says_nothing_is_refused() -> None:
    with pytest.raises(UsageError, match="2 readings"):
        bias_study(np.ones(2), 1.0)
    with pytest.raises(UsageError):
        linearity(np.ones(9), np.arange(9.0))
