"""A ripple faster than the visits is found at any frequency and phase, and noise of no colour is one."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.ripple import MOST_VISITS, NONE, Ripple, find_ripple
from station.domain.core.types import Floats, SampleTable
from station.model.model_file import Model
from tests.blind.bench import WHITE, Scaled, World, hide
from tests.blind.recipes import recipe


def _found(table: SampleTable) -> Ripple:
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    return find_ripple(problem, problem.fit().floor)


def _ripple(period_s: float, *, each_run: bool) -> Callable[[World, Scaled], tuple[Any, Any]]:
    """A wave of the clock of each run, of another size for each unit and axis; each_run: and of another phase."""

    def law(w: World, rng: Scaled) -> tuple[Any, Any]:
        phase = (2.4 * w.run + 1.7 * w.unit) if each_run else 0.3
        wave = np.sin(2 * np.pi * w.t / period_s + phase)
        return w.a, wave[:, None] * rng.amplitude(1e-4, (4, 3))[w.unit]

    return law


@pytest.mark.parametrize("period_s", [0.8, 1.9, 3.7])
@pytest.mark.parametrize("each_run", [False, True])
def test_a_ripple_about_as_long_as_a_dwell_is_found(period_s: float, each_run: bool) -> None:
    table, _ = hide(recipe(), _ripple(period_s, each_run=each_run), 51, d=20.0, floor=WHITE)  # type: ignore[arg-type]
    assert _found(table).surprise > 5.0


def _white(noise: Floats) -> Floats:
    return noise


def _remembering(noise: Floats) -> Floats:
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -0.9], noise, axis=0))


def _resonating(noise: Floats) -> Floats:
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -1.8 * np.cos(0.4), 0.81], noise, axis=0))


@pytest.mark.parametrize("colour", [_white, _remembering, _resonating])
def test_noise_of_any_colour_is_no_ripple(colour: Callable[[Floats], Floats], rng: np.random.Generator) -> None:
    table, _ = hide(recipe(), None, 52, floor=WHITE)
    for _ in range(5):
        added = colour(rng.standard_normal(table.reading.shape))
        noisy = replace(table, reading=table.reading + 1e-3 * added / added.std())
        assert _found(noisy).surprise == 0.0


def test_runs_too_long_to_be_white_are_left_out() -> None:
    table, _ = hide(recipe(), None, 53, units=1, floor=WHITE)
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    slot = np.arange(MOST_VISITS + 1)[None, None]
    long = replace(problem, view=replace(problem.view, grid=replace(problem.view.grid, slot=slot)))
    assert find_ripple(long, problem.fit().floor) == NONE
