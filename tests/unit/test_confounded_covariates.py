"""Of two covariates that are a curve of one another both are said; of others only the one that was found."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import initial_view
from station.diagnosis.results.confounded_covariates import with_confounded
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe


@pytest.fixture(scope="module")
def view() -> Any:
    table, _ = hide(recipe(1), None, 4, units=2, floor=WHITE)
    return initial_view(reduce_samples(recipe(1), table))


def _with_temperature(view: Any, T: Any) -> Any:
    return replace(view, reduced=replace(view.reduced, scene=replace(view.scene, temperature_degC=T)))


def test_a_temperature_that_only_rises_is_a_time(view: Any) -> None:
    unit, t = view.scene.visits.unit.code, view.scene.time_s
    rising = _with_temperature(view, 20.0 + 3.0 * unit + 2.0 * (1 - np.exp(-t / t.max())))
    assert with_confounded(("temperature",), rising) == ("temperature", "time")
    assert with_confounded(("order", "time"), rising) == ("order", "time", "temperature")
    assert with_confounded(("order",), rising) == ("order",)


def test_one_that_comes_and_goes_is_none(view: Any) -> None:
    t = view.scene.time_s
    waving = _with_temperature(view, 20.0 + np.sin(2 * np.pi * 3 * t / t.max()))
    assert with_confounded(("temperature",), waving) == ("temperature",)
    assert with_confounded(("time",), waving) == ("time",)
    assert with_confounded(("time",), _with_temperature(view, None)) == ("time",)
