"""What is looked for in which data."""

from dataclasses import replace

import pytest

from station.diagnosis.candidates.bank import build_bank
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search import best_form
from station.diagnosis.search.candidate_banks import all_candidates
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.rank import RankedCause
from station.diagnosis.search.scoring import score_bank
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


def test_a_jump_that_times_of_each_run_do_not_pay_for_stays_what_was_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a cause is tied with asks for the groups that it hits where it was scored."""
    whole = recipe(2)
    problem = initial_problem(
        reduce_samples(whole, hide(whole, None, 3, units=2)[0]), FloorAllowance.of(whole, Model())
    )
    step = next(c for c in all_candidates(problem.view) if c.name == "step" and c.pattern == "scan" and c.of == "run")
    bank = build_bank([step], problem.view.layout, moving=step.moving)
    now = RankedCause("step", 50.0, step, score_bank(problem, [bank], problem.fit().floor))
    monkeypatch.setattr(best_form, "at_own_times", lambda _problem, one, _at: (replace(one), 1e9))
    after = best_form.tune_forms(problem, {"step": now})["step"]
    assert after.best is not None
    assert after.at.hit(after.best, problem.view, alone=True).any()
