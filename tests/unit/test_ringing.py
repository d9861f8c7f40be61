"""What rings within the dwells is found in the samples, followed by finer blocks, and named."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from station.diagnosis.data.reduce import BLOCK_EDGES, MOST_BLOCKS, reduce_samples, ringing_edges
from station.diagnosis.data.ringing import FALSE_RINGINGS, Ringing, find_ringings
from station.diagnosis.data.visit_noise import sample_noise
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.effects.settling import Settling
from station.model.scene import visits_scene_of_table
from tests.blind.bench import World, hide
from tests.blind.inspection import diagnosis_of, searched
from tests.blind.recipes import recipe


def fast() -> Recipe:
    """One run of tilts at 100 samples a second, measured at once on arrival."""
    one = recipe(1)
    return one.model_copy(update={"device": one.device.model_copy(update={"rate_hz": 100.0})})


def swing(frequency_hz: float, constant_s: float) -> Any:
    """What every move leaves on each axis in proportion, dying away, as a wave or not."""

    def hidden(w: World, rng: Any) -> tuple[Any, Any]:
        wave = np.exp(-w.away / constant_s) * np.cos(2 * np.pi * frequency_hz * w.away)
        return w.a, (w.before - w.a) * rng.amplitude(1e-3, (3,)) * wave[:, None]

    return hidden


def ringing(table: SampleTable) -> Any:
    visit = visits_scene_of_table(fast(), table).visit
    return find_ringings(fast(), table, visit, sample_noise(table.reading, visit))


@pytest.mark.parametrize(("frequency_hz", "constant_s"), [(7.0, 0.25), (11.0, 0.15)])
def test_a_ringing_faster_than_the_blocks_of_a_dwell_is_named_with_its_frequency(
    frequency_hz: float, constant_s: float
) -> None:
    table, _ = hide(fast(), swing(frequency_hz, constant_s), 4, units=2, d=12)
    found = diagnosis_of(fast(), table)
    assert [cause.finding.name for cause in found.causes] == ["settling"]
    estimate = found.causes[0].estimate
    assert estimate is not None
    form = {f.field: f for f in estimate.form}
    assert abs(form["frequency_hz"].value - frequency_hz) < 4 * form["frequency_hz"].std
    assert abs(form["time_constant_s"].value - constant_s) < 4 * form["time_constant_s"].std


@pytest.mark.parametrize("constant_s", [0.045, 0.1, 0.2])
def test_what_dies_away_without_a_wave_is_no_ringing_however_large(constant_s: float) -> None:
    table, _ = hide(fast(), swing(0.0, constant_s), 5, units=2, d=150)
    assert ringing(table) == ()


@pytest.mark.parametrize("kept", [0.0, 0.7, -0.6])
def test_noise_of_any_colour_rings_as_seldom_as_stated(kept: float) -> None:
    table, _ = hide(fast(), None, 6, units=2)
    visits, sets = int(table.visit.max() + 1) * 2, 60
    found = 0
    for seed in range(sets):
        noise = np.random.default_rng(seed).standard_normal((visits, 120, 3))
        for i in range(1, 120):
            noise[:, i] += kept * noise[:, i - 1]
        found += ringing(replace(table, reading=table.reading + 5e-3 * noise[:, 20:].reshape(-1, 3))) != ()
    # More than two of 60 at that chance are rarer than one in 300.
    assert FALSE_RINGINGS * sets < 0.31
    assert found <= 2


@example(3.0, 0.03125, 2.0)
@given(st.floats(2, 30), st.floats(0.03, 0.5), st.floats(0.08, 60))
def test_the_blocks_of_a_ringing_rise_to_the_end_of_the_dwell(hz: float, constant_s: float, dwell_s: float) -> None:
    edges = ringing_edges([Ringing(hz, constant_s, 0.0)], dwell_s)
    assert edges[-1] == 1.0
    assert np.all(np.diff(edges, prepend=0.0) > 0)
    # None is shorter than a quarter of a wave, and no dwell has more than a fleet's memory can hold.
    assert np.diff(edges, prepend=0.0).min() > min(0.99 / (4 * hz * dwell_s), 0.059)
    assert len(edges) <= MOST_BLOCKS + len(BLOCK_EDGES)


@pytest.mark.parametrize("rate_hz", [0.2, 1.0, 4.0, 10.0])
def test_slow_samples_show_no_ringing(rate_hz: float) -> None:
    slow = fast().model_copy(update={"device": fast().device.model_copy(update={"rate_hz": rate_hz})})
    table, _ = hide(fast(), swing(11.0, 0.15), 8, units=2, d=40)
    visit = visits_scene_of_table(slow, table).visit
    assert find_ringings(slow, table, visit, sample_noise(table.reading, visit)) == ()


def test_where_nothing_rings_the_blocks_are_those_of_any_dwell() -> None:
    quiet, loud = (hide(fast(), hidden, 7, units=2, d=40)[0] for hidden in (None, swing(11.0, 0.15)))
    assert reduce_samples(fast(), quiet).edges is BLOCK_EDGES
    found = reduce_samples(fast(), loud)
    assert found.count.shape[1] == len(found.edges) > len(BLOCK_EDGES)
    # Four blocks a wave.
    assert np.diff(found.edges[:8]) == pytest.approx(1 / (4 * found.ringing_hz[0]), rel=0.05)


def both(*shapes: tuple[float, float]) -> Any:
    """What several swings leave together."""

    def hidden(w: World, rng: Any) -> tuple[Any, Any]:
        return w.a, sum(swing(*shape)(w, rng)[1] for shape in shapes)

    return hidden


@pytest.mark.parametrize("seed", range(4))
def test_two_ringings_are_each_found_at_their_own_frequency(seed: int) -> None:
    """The best single wave lies between them and dies away sooner."""
    table, _ = hide(fast(), both((20.0, 0.12), (30.0, 0.12)), seed, units=2, d=35)
    assert sorted(r.frequency_hz for r in ringing(table)) == pytest.approx([20.0, 30.0], abs=1.0)


@pytest.mark.parametrize(("frequency_hz", "constant_s"), [(9.3, 0.08), (16.1, 0.045), (22.4, 0.17), (28.6, 0.3)])
def test_a_wave_between_those_tried_is_one_however_large(frequency_hz: float, constant_s: float) -> None:
    table, _ = hide(fast(), swing(frequency_hz, constant_s), 5, units=2, d=300)
    (found,) = ringing(table)
    assert found.frequency_hz == pytest.approx(frequency_hz, abs=0.6)


def test_two_fast_ringings_are_named_with_their_frequencies() -> None:
    table, _ = hide(fast(), both((20.0, 0.12), (30.0, 0.12)), 4, units=2, d=35)
    found = searched(fast(), table)
    assert [finding.name for finding in found.findings] == ["settling", "settling"]
    effects = [finding.accepted.candidate.effect for finding in found.findings if finding.accepted is not None]
    frequencies = [effect.frequency_hz for effect in effects if isinstance(effect, Settling)]
    assert sorted(frequencies) == pytest.approx([20.0, 30.0], abs=0.5)
    assert found.words == ()
