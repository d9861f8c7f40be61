"""Sharing time among stops: known answers, limits, and no general optimiser that finds less."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from station.domain.core.types import Floats
from station.domain.planning.allocation import NEAR, least_dwells


def dwells(price: Floats, past: float = 0.0, shortest: float = 0.01, longest: float = 1e3) -> Floats:
    """One fixture."""
    price = np.atleast_2d(price)
    v = price.shape[1]
    limits = np.full((1, v), shortest), np.full((1, v), longest)
    return np.asarray(least_dwells(price[None], np.full((1, len(price)), past), *limits)[0])


def test_one_coefficient_shares_by_the_square_root() -> None:
    """Neyman: T_v = √price_v · Σ√price."""
    assert dwells(np.array([4.0, 1.0, 9.0])) == pytest.approx([12.0, 6.0, 18.0], rel=1e-3)


def test_what_was_done_already_leaves_less_room() -> None:
    assert dwells(np.array([1.0]), past=0.75) == pytest.approx([4.0], rel=1e-3)


def test_coefficients_apart_are_served_apart() -> None:
    assert dwells(np.diag([2.0, 5.0])) == pytest.approx([2.0, 5.0], rel=2e-3)


def test_limits_hold_and_a_coefficient_out_of_reach_comes_near() -> None:
    price = np.array([10.0, 10.0])
    T = dwells(price, longest=5.0)
    assert (T <= 5.0).all()
    assert (price / T).sum() <= NEAR * (price / 5.0).sum() * 1.001


def test_rounding_is_no_way_to_make_up_for_a_stop_that_was_too_short() -> None:
    price = np.array([[1.0, 1e-17], [0.0, 1.0]])
    limits = np.full((1, 1), 0.2), np.full((1, 1), 50.0)
    T = least_dwells(price[None, :, 1:], np.array([[1.3, 0.0]]), *limits)
    assert T[0] == pytest.approx([1.0], rel=2e-3)


def test_fixtures_together_are_those_alone(rng: np.random.Generator) -> None:
    price, past = rng.exponential(size=(7, 3, 5)), rng.uniform(0, 0.5, (7, 3))
    limits = np.full((7, 5), 0.1), np.full((7, 5), 100.0)
    together = least_dwells(price, past, *limits)
    for i in range(7):
        alone = least_dwells(price[i : i + 1], past[i : i + 1], *(limit[i : i + 1] for limit in limits))
        assert together[i].sum() == pytest.approx(alone[0].sum(), rel=2e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 8))
def test_no_optimiser_finds_less(seed: int, coefficients: int, stops: int) -> None:
    rng = np.random.default_rng(seed)
    price, past = rng.exponential(size=(coefficients, stops)) ** 2, 0.3
    T = dwells(price, past, shortest=0.2)
    assert (past + price @ (1 / T)).max() <= 1.002
    found = minimize(
        np.sum,
        T * 1.1,
        jac=np.ones_like,
        bounds=[(0.2, 1e3)] * stops,
        constraints={
            "type": "ineq",
            "fun": lambda x: 1 - past - price @ (1 / x),
            "jac": lambda x: price / x**2,
        },
        method="SLSQP",
    )
    assert T.sum() <= found.fun * 1.005 + 1e-6 or not found.success
