"""Coverage factors against tabulated ones (JCGM 100, table G.2, 95 %), and against errors that are drawn (JCGM 101)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special

from station.domain.methods import coverage
from station.domain.methods.coverage import ErrorDistribution


@pytest.mark.parametrize(("dof", "k"), [(1, 12.71), (5, 2.57), (10, 2.23), (50, 2.01), (1e9, 1.96)])
def test_the_factor_is_the_table_s(dof: float, k: float) -> None:
    assert float(coverage.factor(np.asarray(dof))) == pytest.approx(k, abs=0.005)


def test_the_normal_quantile_belongs_to_the_stated_probability() -> None:
    assert special.ndtri((1 + coverage.PROBABILITY) / 2) == coverage.NORMAL


def of(std: float, dof: float, rectangle: float, shift: float) -> ErrorDistribution:
    """Of Student's t with that standard deviation and dof, beside a rectangle and a shift."""
    variance = std**2 + rectangle**2 / 3 + (coverage.SHIFT_STD * shift) ** 2
    whole = dof * (variance / std**2) ** 2
    return ErrorDistribution(*(np.array([x]) for x in (variance**0.5, whole, rectangle, shift)))


def test_a_rectangle_alone_is_held_by_95_percent_of_its_half_width() -> None:
    """JCGM 100, G.1.3 and 4.3.7: U = 0.95·a, k = 1.645."""
    found = of(1e-6, 1e6, 1.0, 0.0)
    assert found.expanded() == pytest.approx([0.95], abs=2e-3)
    assert found.quantile(0.99) == pytest.approx([0.98], abs=2e-3)


def test_what_is_there_or_not_is_held_either_way() -> None:
    """A shift far above the rest: one side of it has all that may miss (JCGM 100, F.2.4.5)."""
    assert of(1.0, 1e6, 0.0, 20.0).expanded() == pytest.approx([20 + special.ndtri(0.95)], rel=1e-4)


@pytest.mark.parametrize(
    ("dof", "rectangle", "shift"),
    [(1e6, 1.0, 0.0), (6.0, 3.0, 0.0), (30.0, 0.5, 1.5), (1e6, 0.0, 0.7), (3.0, 1.0, 1.0)],
)
def test_drawn_errors_are_held_as_often_as_stated(
    dof: float, rectangle: float, shift: float, rng: np.random.Generator
) -> None:
    """Monte Carlo (JCGM 101): four standard deviations of the count."""
    n = 200_000
    error = rng.standard_t(dof, n) + rectangle * rng.uniform(-1, 1, n) + shift
    found = of(1.0, dof, rectangle, shift)
    wide, band = float(found.expanded()[0]), float(found.quantile(0.99)[0])
    assert (np.abs(error) <= wide).mean() == pytest.approx(0.95, abs=4 * (0.95 * 0.05 / n) ** 0.5)
    assert (error <= band).mean() == pytest.approx(0.99, abs=4 * (0.99 * 0.01 / n) ** 0.5)
    above = ((error > band).mean() + (error - shift > band).mean()) / 2
    assert float(found.tail(np.array([band]))[0]) == pytest.approx(above, abs=4 * (0.01 / n) ** 0.5)


@given(
    std=st.floats(1e-3, 1e3), dof=st.floats(1.0, 1e6), rectangle=st.floats(0, 1e3), shift=st.floats(0, 1e3),
    p=st.floats(0.6, 0.9999),
)  # fmt: skip
def test_quantiles_and_tails_are_inverse(std: float, dof: float, rectangle: float, shift: float, p: float) -> None:
    """Without a shift; with one, its quantile is that of the shifted error, whose tail is the larger half."""
    found = of(std, dof, rectangle, 0.0)
    assert found.tail(found.quantile(p)) == pytest.approx([1 - p], rel=1e-4, abs=1e-9)
    moved = of(std, dof, rectangle, shift)
    wide = moved.expanded()
    assert np.isfinite(wide).all() and wide >= shift
    assert moved.quantile(p) >= found.quantile(p) * (1 - 1e-3)


def test_many_at_once_have_the_bits_of_each_alone(rng: np.random.Generator) -> None:
    parts = [rng.uniform(0, 2, 200) for _ in range(4)]
    together = ErrorDistribution(parts[0], 1 + 20 * parts[1], parts[2] * parts[0], parts[3] * parts[0])
    alone = [together.take(np.array([i])).expanded()[0] for i in range(200)]
    assert together.expanded().tolist() == alone


def test_what_is_left_beside_a_large_shift_keeps_its_degrees_of_freedom() -> None:
    """Six of a rest that is a thousandth of u: the whole has 1e12 and more, which must not be cut off before."""
    total, rest = np.array([1.0 + (coverage.SHIFT_STD * 1e3) ** 2]), np.array([1.0])
    dof = coverage.effective_dof(total, [(rest, np.array([6.0]))])
    found = ErrorDistribution(np.sqrt(total), dof, np.zeros(1), np.array([1e3]))
    assert found.quantile(0.99) == pytest.approx([1e3 + special.stdtrit(6, 0.99)], rel=1e-6)
    assert found.tail(np.array([1e3 + 20])) == pytest.approx([special.stdtr(6, -20) / 2], rel=1e-3)


def test_what_is_known_stays_known() -> None:
    assert coverage.effective_dof(np.ones(1), []) == [coverage.KNOWN]
    assert coverage.factor(np.array([coverage.KNOWN])) == pytest.approx([coverage.NORMAL], rel=1e-5)
