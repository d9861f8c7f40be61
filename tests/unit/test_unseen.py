"""What no column of the bank shows: a ripple faster than the visits at any frequency and phase, and a state of a unit
or a nest that changes at any visit, are found; noise of no colour is one."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy

from station.diagnosis.candidates.bank import candidates
from station.diagnosis.candidates.kernels import NEST_STATE, STATE
from station.diagnosis.candidates.nuisance import accept_candidate
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.alarm import UNKNOWN_NATS
from station.diagnosis.search.hidden_state import find_states
from station.diagnosis.search.problem import FloorAllowance, initial_problem, refined
from station.diagnosis.search.ripple import MOST_VISITS, find_ripple
from station.diagnosis.search.unseen import NOTHING, Unseen
from station.domain.core.types import Floats, SampleTable
from station.model.effects.settling import Settling
from station.model.model_file import Model
from tests.blind.bench import WHITE, Scaled, World, hide
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe, six_faces


def _found(table: SampleTable) -> tuple[Unseen, Unseen, Unseen]:
    """The ripple, the state of units, that of nests."""
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    floor = problem.fit().floor
    states = find_states(problem, floor)
    return find_ripple(problem, floor), states[STATE], states[NEST_STATE]


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
    assert _found(table)[0].surprise > 5.0


def _telegraph(w: World, rng: Scaled) -> tuple[Any, Any]:
    """Each unit has two offsets and is at either for some visits."""
    state = np.cumsum(np.random.default_rng(8).uniform(size=w.stop.max() + 1) < 0.25) % 2
    return w.a, state[w.stop, None] * rng.amplitude(1e-4, (4, 3))[w.unit]


def test_an_offset_that_jumps_to_and_fro_is_a_state() -> None:
    table, _ = hide(recipe(), _telegraph, 54, d=20.0, floor=WHITE)  # type: ignore[arg-type]
    assert _found(table)[1].surprise > 5.0


def _rattles(w: World, rng: Scaled) -> tuple[Any, Any]:
    """Each nest is turned about an axis of its own at some visits."""
    state = np.random.default_rng(9).uniform(size=w.stop.max() + 1) < 0.3
    return w.feel(nest=state[w.stop, None] * rng.amplitude(1e-3, (2, 3))[w.nest]), np.zeros_like(w.a)


def test_a_nest_that_rattles_is_a_state_of_nests() -> None:
    table, _ = hide(recipe(), _rattles, 56, d=20.0, floor=WHITE)  # type: ignore[arg-type]
    unit, nest = _found(table)[1:]
    assert nest.surprise > 5.0
    assert nest.nats > unit.nats


@pytest.mark.parametrize("size", [1.0, 30.0])
def test_wrong_visits_are_told_better_by_their_own_cause(size: float) -> None:
    """The cause itself explains n/2 · ln(1 + d²/n) nats of n numbers, here of one visit alone."""
    table, _ = hide(recipe(), None, 55, floor=WHITE)
    bumped = table.reading.copy()
    for visit in (7, 9, 10):
        hit = (table.unit.code == 1) & (table.run == 2) & (table.visit == visit)
        bumped[hit] += size * np.array([3e-3, -2e-3, 1e-3])
    found = _found(replace(table, reading=bumped))
    numbers, d = 3 * 24 * 3 * 4, size * np.sqrt(14e-6 * 25) / 3.5e-4
    assert max(f.nats for f in found) < numbers / 2 * np.log1p(d**2 / numbers) / 4


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
        # Noise goes beyond this in one of 10,000 sets.
        assert max(found.surprise for found in _found(noisy)) < 4.0


def test_beside_what_moves_within_dwells_noise_is_no_state_either() -> None:
    """The contrasts of the dwells, which are looked at beside it, are no visits."""
    faces = six_faces("shuffled")
    table, _ = hide(faces, KNOWN["settling"], 54, units=3, floor=WHITE, d=30.0)
    problem = initial_problem(reduce_samples(faces, table), FloorAllowance.of(faces, Model()))
    settles = candidates(Settling.example(), problem.view)[0]
    beside = refined(problem.with_accepted([accept_candidate(settles, np.ones(len(settles.names), bool), 1e-3)]))
    assert max(found.nats for found in find_states(beside, beside.fit().floor).values()) < UNKNOWN_NATS


def test_runs_too_long_to_be_white_are_left_out() -> None:
    table, _ = hide(recipe(), None, 53, units=1, floor=WHITE)
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    slot = np.arange(MOST_VISITS + 1)[None, None]
    long = replace(problem, view=replace(problem.view, grid=replace(problem.view.grid, slot=slot)))
    floor = problem.fit().floor
    assert {find_ripple(long, floor), *find_states(long, floor).values()} == {NOTHING}
