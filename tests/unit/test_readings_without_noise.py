"""Devices whose dwells always read the same, for lack of noise or of samples: no warning, no step that nobody saw."""

from dataclasses import replace

import numpy as np
import pytest

from station.diagnosis.data.faults import grid_step, inspect
from station.diagnosis.planning.suspects import _size_of
from station.diagnosis.search.distinguishability import SignatureAxes
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from tests.blind.bench import Floor, hide
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import six_faces

LSB = 4e-3
SEED = 5


def coarse_faces() -> Recipe:
    faces = six_faces("listed", "reversed")
    return faces.model_copy(update={"device": faces.device.model_copy(update={"lsb": LSB})})


def frozen(lsb: float = LSB) -> SampleTable:
    table, _ = hide(six_faces("listed", "reversed"), None, SEED, units=2, floor=Floor(density=1e-7))
    return replace(table, reading=np.round(table.reading / lsb) * lsb)


def test_faces_without_noise_show_no_step_of_the_output() -> None:
    """Minus, none and plus one g lie at equal distances on any grid."""
    assert [f.effect for f in inspect(coarse_faces(), frozen()).faults] == []


def test_steps_that_noise_shows_are_a_step() -> None:
    table, _ = hide(six_faces("listed", "reversed"), None, SEED, units=2, floor=Floor(density=3e-3))
    coarse = replace(table, reading=np.round(table.reading / (16 * LSB)) * 16 * LSB)
    (fault,) = inspect(coarse_faces(), coarse).faults
    assert fault.effect == "quantization"
    assert fault.numbers[0].value == pytest.approx(16 * LSB, rel=1e-3)


def test_many_levels_show_a_step_without_noise() -> None:
    levels = np.repeat(np.arange(9) * 16 * LSB, 4)[:, None] * np.ones(3)
    assert grid_step._axes_with_steps(levels, np.repeat(np.arange(9), 4)) == [0, 1, 2]


@pytest.mark.parametrize("axis", [0, 2])
def test_an_axis_of_one_unit_that_stands_still_in_each_dwell_is_diagnosed_without_a_warning(axis: int) -> None:
    table, _ = hide(coarse_faces(), None, SEED, units=2)
    visit = table.run * 100 + table.visit
    first = np.unique(visit, return_index=True)
    own = table.unit.code == 0
    still = table.reading[first[1], axis][np.searchsorted(first[0], visit)]
    table.reading[own, axis] = still[own]
    assert diagnosis_of(coarse_faces(), table).verdict in {"none", "named", "incomplete", "unknown"}


def test_no_suspect_is_larger_than_anything_thinkable() -> None:
    """What these data hardly show would have to be 10¹² g to look like what was found."""
    hardly = SignatureAxes(np.zeros((1, 6, 1)), np.array([[1e-24]]), own=True)
    assert _size_of(3.0, hardly, 0.5) == 0.5
