"""What is looked for in which data."""

from dataclasses import replace

import pytest

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.candidate_banks import all_candidates
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.model.model_file import Model
from tests.blind.bench import hide
from tests.blind.recipes import recipe


@pytest.mark.parametrize(("pose", "axes"), [("known", [3, 3]), ("unknown", [1])])
def test_no_turn_of_a_visit_is_looked_for_where_only_lengths_are_known(pose: str, axes: list[int]) -> None:
    """Of lengths it had sizes of a radian with errors as large, by the last digits of a turn that shows in none."""
    whole = recipe(1)
    table, _ = hide(whole, None, 3, units=1)
    if pose == "unknown":
        unknown = whole.reference.model_copy(update={"pose": "unknown"})
        whole = whole.model_copy(update={"reference": unknown, "positions": ()})
        table = replace(table, labels={}, values={})
    view = initial_problem(reduce_samples(whole, table), FloorAllowance.of(whole, Model())).view
    assert [c.axes for c in all_candidates(view) if c.name == "disturbed-visit"] == axes
