"""Scans in which several units are hit at once, each far above the noise."""

import numpy as np
import pytest

from station.diagnosis.linear.evidence import DataSets, EigenSpectrum, log_mean_exp, spectrum
from station.diagnosis.linear.projection import SpaceSize
from station.diagnosis.linear.several_hits import spread_of_hits
from station.domain.core.types import Floats

UNITS, GROUPS, NUMBERS = 3, 5, 40


def scan() -> EigenSpectrum:
    """One number for each of five groups of three units, all seen equally well."""
    size = SpaceSize(copies=1, dof=UNITS * NUMBERS, logdet=0.0)
    m = np.ones((1, UNITS, GROUPS, 1))
    return spectrum(size, m, np.zeros((*m.shape, 0)), "scan", np.array([np.inf]))


def judged(hits: dict[int, float]) -> tuple[Floats, Floats]:
    """Log-likelihood by share of readings with a hit of such a size in group 2 of some units: together, and each hit
    as if it were alone."""
    can = scan()
    u = np.random.default_rng(3).standard_normal((1, 1, UNITS, GROUPS, 1))
    for unit, size in hits.items():
        u[0, 0, unit, 2, 0] = size
    rest = float(np.sum(u**2)) + UNITS * (NUMBERS - GROUPS)
    sets = DataSets(can.size, np.array([rest]), np.zeros((1, 0)))
    odds = log_mean_exp(can.likelihoods(u, sets))
    return spread_of_hits(can, u, sets, odds)[0, 0], can.spread(odds)[0, 0]


@pytest.mark.parametrize("units", [(0,), (0, 1), (0, 1, 2)])
def test_hard_hits_explain_together_what_noise_does_not(units: tuple[int, ...]) -> None:
    size = 1e4
    together, _ = judged(dict.fromkeys(units, size))
    dof = UNITS * NUMBERS
    whole = 0.5 * dof * np.log(len(units) * size**2 / dof)
    # Each hit pays for its size, which lies within the grid's 10 decades of squares, and for which group it is.
    paid = len(units) * (np.log(size) + 0.5 * np.log(1e10) + np.log(1 / 0.003))
    assert whole - paid < together.max() < whole + 0.05 * dof


def test_one_hit_is_judged_as_before() -> None:
    together, alone = judged({1: 1e3})
    assert together == pytest.approx(alone, abs=0.5)


def test_hits_that_hide_none_are_judged_as_before() -> None:
    together, alone = judged({})
    assert np.array_equal(together, alone)


def test_two_hard_hits_are_more_than_each_alone() -> None:
    """Alone, each explains half: dof · log 2 / 2 nats, whatever their size."""
    together, alone = judged({0: 1e4, 2: 1e4})
    assert alone.max() < UNITS * NUMBERS * np.log(2)
    assert together.max() > 4 * alone.max()
