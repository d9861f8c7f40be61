"""A parameter of a form is found wherever it is looked for from."""

import numpy as np
import pytest

from station.diagnosis.candidates.bank import candidate_in_view
from station.diagnosis.candidates.shape import tune_form
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.problem import FloorAllowance, initial_problem, with_model
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe


@pytest.mark.parametrize("start_s", [0.011, 120.0, 5e5])
def test_a_time_constant_far_from_what_is_usual_is_sought_from_there(start_s: float) -> None:
    """A model file may say one, and nothing in the data need speak of it."""
    rows = [{"name": "amplitude", "axis": "x", "of": "common", "value": 1e-3, "unit": "g"}]
    listed = {"effect": "warm-up", "parameters": rows, "shape": {"time_constant_s": start_s}}
    table, _ = hide(recipe(), None, 8, floor=WHITE)
    bare = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    known = with_model(bare, Model.model_validate({"effects": [listed]}))
    candidate = candidate_in_view(known.accepted[0].candidate, known.view)
    space = bare.space(bare.fit().floor, moving=False)
    tuned, (form,) = tune_form(candidate, bare.view, space)
    assert form.field == "time_constant_s" and np.isfinite([form.value, form.std]).all() and form.value > 0
    assert tuned.effect is not None
