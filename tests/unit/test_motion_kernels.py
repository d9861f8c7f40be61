"""What a visit keeps of those before it is what one visit after the other tells."""

from typing import Any

import numpy as np
import pytest

from station.diagnosis.candidates import motion_kernels
from station.diagnosis.data.reduce import mean_and_contrasts, reduce_samples
from station.diagnosis.data.residuals import initial_view
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe


@pytest.fixture(scope="module")
def view() -> Any:
    """Runs of several lengths, one unit without its second one."""
    table, _ = hide(recipe(2), None, 3, units=3, floor=WHITE)
    gone = (table.unit.code == 1) & (table.run == 1) | (table.unit.code == 2) & (table.visit > 15)
    return initial_view(reduce_samples(recipe(2), table[~gone]))


@pytest.mark.parametrize("kept", [0.0, 0.6, 1.0])
def test_what_is_remembered_adds_up_visit_by_visit(view: Any, kept: float, rng: np.random.Generator) -> None:
    previous = view.scene.visits.previous
    values = rng.standard_normal((len(previous), 2))
    expected = values.copy()
    for i, before in enumerate(previous):
        if before >= 0:
            expected[i] += kept * expected[before]
    np.testing.assert_allclose(motion_kernels.remembered(values, view, kept), expected, atol=1e-12)


def test_a_turn_is_a_reversal_where_the_last_one_about_its_axis_went_the_other_way(
    view: Any, rng: np.random.Generator
) -> None:
    previous = view.scene.visits.previous
    way = rng.integers(-1, 2, (len(previous), 3)).astype(float)
    last, expected = np.zeros(3), np.zeros_like(way)
    for i, before in enumerate(previous):
        last = last if before >= 0 else np.zeros(3)
        expected[i] = way[i] * (way[i] * last < 0)
        last = np.where(way[i] != 0, way[i], last)
    np.testing.assert_array_equal(motion_kernels._reversals(way, view), expected)


def test_mean_and_contrasts_hold_all_that_the_blocks_do(rng: np.random.Generator) -> None:
    """Whitened blocks turned by an orthogonal matrix of which the mean, times the root of all samples, is a row."""
    count, block = rng.integers(1, 9, (6, 4)).astype(float), rng.standard_normal((6, 4, 3, 2))
    mean, contrasts = mean_and_contrasts(block, count)
    assert contrasts.shape == (6, 3, 3, 2)
    np.testing.assert_allclose(mean, np.einsum("vb,vbij->vij", count / count.sum(1, keepdims=True), block))
    squares = count.sum(1)[:, None, None] * mean**2 + np.sum(contrasts**2, axis=1)
    np.testing.assert_allclose(squares, np.einsum("vb,vbij->vij", count, block**2))
