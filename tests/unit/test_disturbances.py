"""Bumped stops, stuck and clipped axes, wrong faces: found, named, reported; and none of it where nothing is wrong."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.domain.core.types import SampleTable
from station.domain.evaluation import pipeline
from station.messages import render
from tests.fakes import tumble
from tests.fakes.tumble import TODAY, coefficients


def bench(method: str, rng: np.random.Generator, units: int = 1, **more: Any) -> tuple[Any, Any, SampleTable]:
    recipe = tumble.recipe(method, **more)
    theta = tumble.units(rng, units)
    return recipe, theta, tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), 1e-3, 60, rng)


def pushed(table: SampleTable, visit: int, push: list[float]) -> SampleTable:
    reading = table.reading.copy()
    reading[table.visit == visit] += push
    return replace(table, reading=reading)


@pytest.mark.parametrize("method", ["n-point", "norm"])
def test_a_bumped_stop_is_left_out_and_reported(method: str, rng: np.random.Generator) -> None:
    recipe, theta, table = bench(method, rng)
    # Along the stimulus: norm cannot see across.
    push = 0.02 * tumble.truths(recipe)[4]
    found = tumble.calibrate_unit(recipe, pushed(table, 4, push.tolist()), TODAY)
    assert found.calibration is not None and found.budget is not None
    assert np.flatnonzero(found.calibration.disturbed).tolist() == [4]
    assert any(note.id == "visit-disturbed" and "visit 4" in render(note) for note in found.calibration.notes)
    assert (np.abs(coefficients(found) - theta[0]) < 4 * found.budget.std()).all()


def test_four_bumped_stops_of_thirty_six(rng: np.random.Generator) -> None:
    recipe, _, table = bench("n-point", rng, runs=[{"order": "listed"}, {"order": "reversed"}])
    # Visit 3 of both passes, and visit 11 of both passes.
    table = pushed(pushed(table, 3, [0.0, 0.01, 0.0]), 11, [0.02, 0.0, 0.0])
    found = tumble.calibrate_unit(recipe, table, TODAY).calibration
    assert found is not None
    bumped = {v for v, out in zip([*range(18), *range(18)], found.disturbed, strict=True) if out}
    assert bumped == {3, 11}
    assert found.disturbed.sum() == 4


def test_six_faces_cannot_say_which_of_a_pair_was_bumped_and_do_not_pretend(rng: np.random.Generator) -> None:
    recipe, theta, table = bench("six-point", rng)
    found = tumble.calibrate_unit(recipe, pushed(table, 4, [0.01, 0.0, 0.0]), TODAY)
    assert found.calibration is not None and found.budget is not None
    assert not found.calibration.disturbed.any()
    assert any(note.id == "visits-scatter" for note in found.calibration.notes)
    assert (np.abs(coefficients(found) - theta[0]) < 1.96 * found.budget.std()).mean() > 0.8


def test_without_a_disturbance_hardly_a_stop_is_lost(rng: np.random.Generator) -> None:
    recipe, _, table = bench("n-point", rng, 400)
    lost = sum(r.calibration.disturbed.sum() for r in pipeline.calibrate(recipe, table, TODAY) if r.calibration)
    assert lost <= 3


def checks(recipe: Any, table: SampleTable) -> dict[str, str]:
    verdict = tumble.calibrate_unit(recipe, table, TODAY).verdict
    return {r.check: r.sentence for r in verdict.reasons}


def test_sound_readings_give_no_reason(rng: np.random.Generator) -> None:
    recipe, _, table = bench("six-point", rng, device={"full_scale": 2.0})
    assert checks(recipe, table) == {}


def test_a_stuck_axis(rng: np.random.Generator) -> None:
    recipe, _, table = bench("six-point", rng)
    reading = table.reading.copy()
    reading[:, 1] = 0.125
    shown = checks(recipe, replace(table, reading=reading))
    assert "Axis y reads 0.125 g in every position" in shown["stuck"]


def test_a_clipped_axis(rng: np.random.Generator) -> None:
    recipe, _, table = bench("six-point", rng, device={"full_scale": 0.9})
    shown = checks(recipe, replace(table, reading=np.clip(table.reading, -0.9, 0.9)))
    assert "end of its range, ±0.9 g" in shown["clipped"]


def test_a_wrong_face_is_named_with_the_one_it_looks_like(rng: np.random.Generator) -> None:
    recipe, _, table = bench("six-point", rng)
    names = list(table.position.names)
    swapped = [{"x-up": "y-up", "y-up": "x-up"}.get(n, n) for n in names]
    table = replace(table, position=type(table.position)(tuple(swapped), table.position.code))
    shown = [r.sentence for r in tumble.calibrate_unit(recipe, table, TODAY).verdict.reasons if r.check == "wrong-face"]
    assert any("at 'y-up'" in one and "looks like 'x-up'" in one for one in shown)
    assert any("at 'x-up'" in one and "looks like 'y-up'" in one for one in shown)


def test_metres_per_second_squared_are_recognised(rng: np.random.Generator) -> None:
    recipe, _, table = bench("six-point", rng)
    shown = checks(recipe, replace(table, reading=table.reading * 9.80665))
    assert "are they in m/s²?" in shown["scale"]


def test_a_dwell_that_moves_more_than_the_residual_may(rng: np.random.Generator) -> None:
    recipe, _, table = bench("six-point", rng, limits={"residual": 0.01})
    reading = table.reading.copy()
    rows = np.flatnonzero(table.visit == 2)
    reading[rows, 0] += np.linspace(0.1, 0.0, len(rows))
    shown = checks(recipe, replace(table, reading=reading))
    assert "lengthen settle.time_s" in shown["not-still"]


def test_one_bad_unit_does_not_stop_the_others(rng: np.random.Generator) -> None:
    recipe, theta, table = bench("six-point", rng, 3)
    second = table.unit.code == 1
    gone = second & (table.visit > 1)
    found = list(pipeline.calibrate(recipe, table[~gone], TODAY))
    assert [str(r.verdict.outcome) for r in found] == ["PASS", "ERROR", "PASS"]
    (reason,) = found[1].verdict.reasons
    assert "it was never at y-up, y-down, z-up, z-down" in reason.sentence
    flat = table.reading.copy()
    flat[second] = 0.0
    outcomes = [str(r.verdict.outcome) for r in pipeline.calibrate(recipe, replace(table, reading=flat), TODAY)]
    assert outcomes == ["PASS", "FAIL", "PASS"]
    for i in (0, 2):
        assert coefficients(found[i]) == pytest.approx(theta[i], abs=2e-3)


def test_a_visit_in_which_all_axes_froze_is_not_clipped(rng: np.random.Generator) -> None:
    """Even at the end of what one axis ever read."""
    recipe, _, table = bench("six-point", rng)
    reading = table.reading.copy()
    highest = int(np.argmax(reading[:, 2]))
    stop = (table.unit.code == table.unit.code[highest]) & (table.run == table.run[highest])
    stop &= table.visit == table.visit[highest]
    reading[stop] = reading[highest]
    assert "clipped" not in checks(recipe, replace(table, reading=reading))
    reading[stop, :2] = table.reading[stop, :2]
    assert "clipped" in checks(recipe, replace(table, reading=reading))
