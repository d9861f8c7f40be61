"""What a thermometer errs by is part of what an offset in proportion to the temperature may do."""

from dataclasses import replace

import numpy as np

from station.diagnosis.candidates.bank import Candidate, candidates
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import ResidualView, initial_view
from station.diagnosis.search.distinguishability import has_covariate_error
from station.domain.core.types import Floats
from station.model.effect import Effect
from station.model.effects.offset_temperature import OffsetTemperature
from station.model.simulate import SimulationJob, simulate
from station.wiring.jobs import load_job

NOISE_DEGC = 0.03


def view_of(course: Floats) -> ResidualView:
    """Six faces of two units, as warm at the visits as the course (6) says, read by a noisy thermometer."""
    recipe, rng = load_job("six-point")[0].recipe, np.random.default_rng(3)
    table = simulate(SimulationJob(recipe, ("SN1", "SN2"), 5)).table
    read = course + NOISE_DEGC * rng.standard_normal((2, 6))
    warm = 22 + read[table.unit.code, table.visit]
    return initial_view(reduce_samples(recipe, replace(table, values={**table.values, "temperature_degC": warm})))


def own(effect: Effect, view: ResidualView) -> Candidate:
    """The candidate with coefficients of each unit."""
    return next(c for c in candidates(effect, view) if c.of == "unit" and c.pattern == "own")


def test_an_offset_of_temperature_has_columns_of_what_the_thermometer_errs_by() -> None:
    found = own(OffsetTemperature(), view_of(np.linspace(0.0, 0.2, 6)))
    assert has_covariate_error(found)
    assert found.plain is not None
    modes = found.visit[..., found.plain.axes :]
    # No mode of six visits is longer than the noise of as many.
    assert 0 < np.sqrt(np.sum(modes[:6] ** 2, axis=(0, 1))).max() < 2 * NOISE_DEGC * np.sqrt(6)


def test_a_temperature_that_changes_by_far_more_than_its_thermometer_errs_is_as_it_was_read() -> None:
    assert not has_covariate_error(own(OffsetTemperature(), view_of(np.linspace(0.0, 25.0, 6))))
