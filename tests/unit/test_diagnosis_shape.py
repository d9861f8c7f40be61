"""A parameter of a form is found wherever it is looked for from."""

from typing import Any

import numpy as np
import pytest

from station.diagnosis.candidates.bank import Candidate, candidate_in_view, candidates, cause_library
from station.diagnosis.candidates.shape import evidence_of, log_range, tune_form, with_form_value, with_ringing
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.problem import FloorAllowance, initial_problem, with_model
from station.model.model_file import Model
from tests.blind.bench import WHITE, World, hide
from tests.blind.hidden import adds
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


def _flat(name: str, at: float) -> tuple[Candidate, ResidualView, ResidualSpace]:
    """A cause with a time constant at a value, where nothing is hidden."""
    table, _ = hide(recipe(1), None, 9, floor=WHITE)
    bare = initial_problem(reduce_samples(recipe(1), table), FloorAllowance.of(recipe(1), Model()))
    (effect,) = (e for e in cause_library(recipe(1)) if e.id == name)
    one = next(c for c in candidates(effect, bare.view) if c.of == effect.of[0])
    space = bare.space(bare.fit().floor, moving=one.moving)
    return with_form_value(one, "time_constant_s", at, bare.view), bare.view, space


@pytest.mark.parametrize("end", [0, 1])
def test_a_time_constant_that_is_tuned_again_and_again_stays_within_its_range(end: int) -> None:
    """A creep seen long after clamping looks the same with every shorter constant, and the search began each time at
    the end that the last one had moved."""
    (effect,) = (e for e in cause_library(recipe(1)) if e.id == "clamp-creep")
    bounds = np.exp(log_range(effect.forms[0]))
    tuned, view, space = _flat("clamp-creep", float(bounds[end]))
    for _ in range(4):
        tuned, _ = tune_form(tuned, view, space)
        assert bounds[0] * 0.999 <= tuned.effect.time_constant_s <= bounds[1] * 1.001  # type: ignore[union-attr]


def test_a_wave_on_a_ridge_of_its_frequency_and_its_constant_is_found() -> None:
    """A wave that dies away within a quarter of its period looks like a slower one that lasts longer: climbing one
    parameter after the other, a few steps end beside it, and on another peak far below it."""

    def wave(w: World, rng: Any) -> Any:
        left = np.exp(-w.away / 0.113) * np.cos(2 * np.pi * 2.21 * w.away)
        return (w.before - w.a) * rng.amplitude(3e-2, (1, 3)) * left[:, None]

    table, _ = hide(recipe(1), adds(wave), 31, floor=WHITE, d=40.0)
    bare = initial_problem(reduce_samples(recipe(1), table), FloorAllowance.of(recipe(1), Model()))
    (effect,) = (e for e in cause_library(recipe(1)) if e.id == "settling")
    one = next(c for c in candidates(effect, bare.view) if c.of == "common")
    space = bare.space(bare.fit().floor, moving=True)
    true = with_form_value(with_form_value(one, "time_constant_s", 0.113, bare.view), "frequency_hz", 2.21, bare.view)
    found = evidence_of(with_ringing(one, bare.view, space), bare.view, space)
    # The best explains no less than the true one but for where the search ends.
    assert found > evidence_of(true, bare.view, space) - 0.5
