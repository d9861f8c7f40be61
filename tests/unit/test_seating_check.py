"""A seating that is stated otherwise than the readings show it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from station.diagnosis.data.seating_check import check_seatings
from station.domain.core.types import Labels, SampleTable
from station.domain.recipe.position import Turn
from station.errors import SamplesError
from station.messages import render
from station.model.simulate import SimulationJob, simulate
from station.wiring.jobs import load_job

RECIPE = load_job("tilt-24")[0].recipe
SLOW = RECIPE.model_copy(update={"device": RECIPE.device.model_copy(update={"rate_hz": 10.0})})


def measured() -> SampleTable:
    return simulate(SimulationJob(SLOW, ("SN1", "SN2"), 3)).table


def stated(table: SampleTable, of: Mapping[int, str], unit: int = 1) -> SampleTable:
    """The table with other seatings stated of one unit's runs."""
    names = np.array(table.labels["seating"].names, object)[table.labels["seating"].code]
    for run, name in of.items():
        names[(table.unit.code == unit) & (table.run == run)] = name
    return replace(table, labels={**table.labels, "seating": Labels.of([str(n) for n in names])})


def test_what_is_stated_as_it_was_is_taken() -> None:
    check_seatings(SLOW, measured())


@pytest.mark.parametrize(
    ("of", "words"),
    [
        (
            {1: "home"},
            "run 1: seating home is stated, but the readings show the unit turned by 180° about z, as it sits in t",
        ),
        (
            {2: "turned"},
            "run 2: seating turned is stated, but the readings show the unit turned by 180° about y, as it s",
        ),
        (
            {0: "flipped"},
            "run 0: seating flipped is stated, but the readings show the unit turned by 180° about x, as it",
        ),
    ],
)
def test_another_seating_is_said(of: dict[int, str], words: str) -> None:
    with pytest.raises(SamplesError) as refused:
        check_seatings(SLOW, stated(measured(), of))
    assert words in render(refused.value.message)
    assert "SN2" in render(refused.value.message)


def test_a_turn_that_is_no_seating_of_the_recipe_is_said_by_its_angle() -> None:
    """In the third run the unit lay on another side than the recipe says."""
    wrong = {**SLOW.seatings, "flipped": Turn(axis=(0, 0, 1), angle_deg=90)}
    with pytest.raises(SamplesError) as refused:
        check_seatings(SLOW.model_copy(update={"seatings": wrong}), measured())
    assert "SN1, run 2: seating flipped is stated, but the readings show the unit turned by 180° about" in render(
        refused.value.message
    )
