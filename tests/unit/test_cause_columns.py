"""Columns of the visits are held without the places that are zero, and are whole where they are asked for."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from station.diagnosis.candidates import columns
from station.diagnosis.candidates.columns import CauseColumns


def whole(rng: np.random.Generator, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Columns of five visits and of two contrasts each."""
    there = {
        "an axis each": np.eye(3)[:, [0, 1, 2, 0]],
        "several axes": np.array([[1, 0, 1], [1, 1, 0], [0, 0, 1]]),
        "one of zeros": np.eye(3)[:, :2] * [1, 0],
        "in another order": np.eye(3)[:, [2, 0, 1]],
    }[kind]
    return there * rng.standard_normal((5, *there.shape)), there * rng.standard_normal((5, 2, *there.shape))


@pytest.mark.parametrize("kind", ["an axis each", "several axes", "one of zeros", "in another order"])
@pytest.mark.parametrize("k", [1, 3])
def test_columns_are_whole_where_they_are_asked_for(kind: str, k: int, rng: np.random.Generator) -> None:
    visit, dwell = whole(rng, kind)
    # What moves at no visit's mean may still move within the visits.
    visit[:, :, 0] = 0.0
    held, some, keep = CauseColumns.of(visit, dwell), slice(1, 4), rng.standard_normal((5, k, 3))
    np.testing.assert_array_equal(held.visit(some), visit[some])
    np.testing.assert_array_equal(held.dwell(some), dwell[some])
    np.testing.assert_array_equal(held.retained(keep, some), keep[some] @ visit[some])
    chosen = np.array([True, False, True, True, False])
    np.testing.assert_array_equal(held.select_visits(chosen).dwell(), dwell[chosen])
    assert CauseColumns.of(visit).dwell() is None


def test_columns_of_an_axis_each_are_held_in_a_third(rng: np.random.Generator) -> None:
    visit, dwell = whole(rng, "an axis each")
    held = CauseColumns.of(visit, dwell)
    assert held.moving is not None
    assert held.still.nbytes == visit.nbytes / 3 and held.moving.nbytes == dwell.nbytes / 3


def test_a_course_that_several_axes_share_is_held_once(rng: np.random.Generator) -> None:
    course, keep = rng.standard_normal((5, 1, 1)), rng.standard_normal((5, 3, 3))
    visit = np.concatenate([np.eye(3) * course, np.eye(3) * course**2], axis=2)
    held = CauseColumns.of(visit)
    assert held.still.shape == (5, 2)
    np.testing.assert_array_equal(held.visit(), visit)
    np.testing.assert_array_equal(held.retained(keep), keep @ visit)
    assert held.count == 6


def test_functions_of_each_axis_are_held_as_their_whole_columns_are(rng: np.random.Generator) -> None:
    alike, own = np.repeat(rng.standard_normal((5, 1)), 3, axis=1), rng.standard_normal((5, 3))
    for parts in ([alike, own], [own, np.zeros((5, 3))], [own * [1.0, 0.0, 1.0], alike], [np.zeros((5, 3))]):
        held = CauseColumns.by_axis(parts)
        whole_ones = CauseColumns.of(np.concatenate([np.eye(3) * part[:, None] for part in parts], axis=2))
        for name in ("axis", "column", "course", "still", "count", "on_one_axis"):
            np.testing.assert_array_equal(getattr(held, name), getattr(whole_ones, name))


@pytest.mark.parametrize("kind", ["an axis each", "several axes"])
def test_a_bank_of_many_stops_holds_half_and_shows_the_same(
    kind: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    visit, dwell = whole(rng, kind)
    view: Any = SimpleNamespace(grid=SimpleNamespace(k=3))
    full = CauseColumns.in_bank(view, visit, dwell)
    monkeypatch.setattr(columns, "MANY_VISITS", len(visit) - 1)
    half = CauseColumns.in_bank(view, visit, dwell)
    assert full.moving is not None and half.moving is not None
    assert (half.still.nbytes, half.moving.nbytes) == (full.still.nbytes // 2, full.moving.nbytes // 2)
    # What is made of them is in full precision again, within half a step of single precision.
    step, keep = 2.0**-24, rng.standard_normal((5, 3, 3))
    for some, every in ((half.visit(), visit), (half.dwell(), dwell)):
        assert some is not None and some.dtype == float
        np.testing.assert_allclose(some, every, rtol=step, atol=0.0)
    bound = 1.01 * step * (np.abs(keep) @ np.abs(visit))
    assert np.all(np.abs(half.retained(keep) - keep @ visit) <= bound)
    # Where only a length is kept most of a column may be lost, and rounding would be what is left.
    view.grid.k = 1
    assert CauseColumns.in_bank(view, visit).still.dtype == float
