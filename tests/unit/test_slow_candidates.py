"""Which candidates follow a walk: some kernels by their name, others by what a walk adds to the noise along them."""

import numpy as np

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.walk_marginal import (
    FLEXIBLE_KERNELS,
    SLOW_SHARE,
    _slow_candidates,
    _walk_shares,
)
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe


def test_a_candidate_is_as_slow_beside_others_as_alone() -> None:
    table, _ = hide(recipe(2), None, 3, units=3, floor=WHITE)
    problem = initial_problem(reduce_samples(recipe(2), table), FloorAllowance.of(recipe(2), Model()))
    floor, most = problem.fit().floor, float(np.sqrt(problem.upper[2]))
    slow_by_share = 0
    for bank in CandidateBanks(problem.view).of(problem.view, ()):
        shares = _walk_shares(problem, bank, floor, most)
        expected = [i for i, c in enumerate(bank.candidates) if c.name in FLEXIBLE_KERNELS or shares[i] > SLOW_SHARE]
        assert _slow_candidates(problem, bank, floor, most) == expected
        slow_by_share += sum(bank.candidates[i].name not in FLEXIBLE_KERNELS for i in expected)
    assert slow_by_share > 0
