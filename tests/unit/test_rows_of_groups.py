"""Columns of some groups alone: what is laid out for thousands of visits is what acts, and no more."""

import numpy as np
import pytest

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear.grid import RowLayout
from station.diagnosis.linear.noise_floor import _kinds_of_runs
from station.diagnosis.search.candidate_banks import all_candidates
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.model.model_file import Model
from tests.blind.bench import hide
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_chosen_groups_have_the_columns_that_they_have_among_all(share: float) -> None:
    table, _ = hide(recipe(), KNOWN["step"], 1, units=2)
    view = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model())).view
    for candidate in all_candidates(view):
        _assert_chosen_as_among_all(candidate, view.layout, share)


def _assert_chosen_as_among_all(candidate: Candidate, layout: RowLayout, share: float) -> None:
    groups = candidate.local_codes(layout)[1]
    chosen = np.arange(groups)[:: max(1, round(1 / share))]
    whole = candidate.rows(layout).only((chosen[:, None] * candidate.axes + np.arange(candidate.axes)).ravel())
    alone = candidate.rows(layout, chosen)
    np.testing.assert_array_equal(alone.visit, whole.visit)
    if whole.dwell is not None:
        np.testing.assert_array_equal(alone.dwell, whole.dwell)


def test_runs_are_of_one_kind_whatever_the_sign_of_their_zeros() -> None:
    kinds, member = _kinds_of_runs(np.array([[0.0, 1.0], [2.0, 1.0], [-0.0, 1.0]]))
    assert member.tolist() == [0, 1, 0]
    np.testing.assert_array_equal(kinds, [[0.0, 1.0], [2.0, 1.0]])
