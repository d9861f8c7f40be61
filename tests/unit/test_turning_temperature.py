"""Rates of temperature where a chamber's ramp begins or ends within a visit."""

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.data.reduce import reduce_samples
from station.domain.core.types import Labels, SampleTable

RATE_HZ, VISIT_S, VISITS = 5.0, 40.0, 40


def ramp(turn_s: float, noise: float, step: float = 0.0) -> tuple[SampleTable, np.ndarray]:
    """One pose whose temperature rises by .02 degC/s, and from turn_s on stands; the true mean rate of each visit."""
    n = int(VISITS * VISIT_S * RATE_HZ)
    time_s = np.arange(n) / RATE_HZ
    warm = 20 + 0.02 * np.minimum(time_s, turn_s) + noise * np.random.default_rng(4).standard_normal(n)
    warm = np.round(warm / step) * step if step else warm
    visit, nothing = (time_s // VISIT_S).astype(np.int32), np.zeros(n, np.int32)
    reading = np.tile([0.0, 0.0, 1.0], (n, 1)) + 1e-4 * np.random.default_rng(5).standard_normal((n, 3))
    table = SampleTable(Labels(("A",), nothing), nothing, visit, Labels(("z-up",), nothing), time_s, reading,
                        values={"temperature_degC": warm})  # fmt: skip
    edges = np.minimum(np.arange(VISITS + 1) * VISIT_S, turn_s)
    return table, 0.02 * np.diff(edges) / VISIT_S


@pytest.mark.parametrize(("noise", "step"), [(0.005, 0.0), (0.0, 0.0625)])
@pytest.mark.parametrize("part", [0.2, 0.8])
def test_a_ramp_that_ends_within_a_visit_has_its_mean_rate_there(part: float, noise: float, step: float) -> None:
    """A smooth course through the means of visits was off by .0022 degC/s, and such visits were called disturbed."""
    table, true = ramp((VISITS // 2 + part) * VISIT_S, noise, step)
    rate = reduce_samples(load_recipe("one-point"), table).scene.require("temperature_rate")
    # A rate is not known to less than a step of the thermometer over the visit.
    assert np.abs(rate - true)[VISITS // 2 - 1 : VISITS // 2 + 2].max() < max(0.001, step / VISIT_S)


def test_a_noisy_thermometer_is_left_to_the_smooth_course() -> None:
    table, true = ramp(np.inf, 0.3)
    rate = reduce_samples(load_recipe("one-point"), table).scene.require("temperature_rate")
    assert np.abs(rate - true).max() < 0.002


def test_a_step_of_a_coarse_thermometer_is_no_turn() -> None:
    """Visits that warm by less than a step show none, or one at some moment."""
    table, _ = ramp(np.inf, 0.0, 0.0625)
    slow = SampleTable(table.unit, table.run, table.visit, table.position, table.time_s, table.reading,
                       values={"temperature_degC": np.round((20 + 1e-3 * table.time_s) / 0.0625) * 0.0625})  # fmt: skip
    rate = reduce_samples(load_recipe("one-point"), slow).scene.require("temperature_rate")
    assert np.abs(rate - 1e-3).max() < 3e-4
