"""What a healthy gyroscope feels beside its rate is known before any cause is looked for."""

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.candidates.nuisance import nuisance_of
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import initial_view
from station.diagnosis.linear.noise_floor import covariance_root
from station.diagnosis.linear.projection import _orthonormal
from station.diagnosis.results.blind_spots import BlindSpots
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.domain.core.types import Floats
from station.model.simulate import SimulationJob, parse_effects, simulate
from tests.blind.inspection import diagnosis_of, searched


def left_of(recipe_name: str, pull: Floats) -> float:
    """The largest share of readings of a unit that no calibration and no known column takes, of axes that feel gravity
    by pull (3, 3)."""
    recipe = load_recipe(recipe_name)
    table = simulate(SimulationJob(recipe, ("A",), seed=3)).table
    view = initial_view(reduce_samples(recipe, table))
    known, _ = nuisance_of(view, (), matrix=False)
    visits = view.scene.visits
    up = np.einsum("vji,vkj->vik", visits.seat_R, visits.nest_R)[..., 2]
    added = view.rows((up @ pull.T)[..., None], None).visit.reshape(-1)
    columns = known.own.visit.reshape(len(added), -1)
    rest = added - columns @ np.linalg.lstsq(columns, added, rcond=1e-9)[0]
    return float(np.linalg.norm(rest) / np.linalg.norm(added))


@pytest.mark.parametrize("name", ["gyroscope-six-point", "gyroscope-n-point"])
def test_gravity_on_a_gyroscope_is_no_cause(name: str) -> None:
    assert left_of(name, np.random.default_rng(4).standard_normal((3, 3))) < 1e-9


def test_axes_that_are_not_square_are_named_on_six_spins() -> None:
    """Six spins leave six numbers beside what a healthy gyroscope feels, three of which its axes' angles move: with
    these known nothing is left, and the floor comes down to what the samples show."""
    spins = load_recipe("gyroscope-six-point")
    job = SimulationJob(spins, ("A", "B", "C"), 3, parse_effects(["cross-axis"], spins))
    found = searched(spins, simulate(job).table)
    assert [(f.name, f.indistinguishable_from) for f in found.findings] == [("cross-axis", ())]
    assert found.last.fit().floor.noise < 0.01


def test_a_floor_draws_where_turns_and_noise_are_one() -> None:
    """About a rate table's axes a turn does what noise does: their covariance has a root all the same."""
    spins = load_recipe("gyroscope-six-point")
    table = simulate(SimulationJob(spins, ("A",), seed=3)).table
    covariance = initial_problem(reduce_samples(spins, table), FloorAllowance()).fit().covariance
    assert np.linalg.matrix_rank(covariance) < 3
    root = covariance_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-9, atol=0.0)


def test_nothing_is_advised_for_what_a_gyroscope_does_not_feel() -> None:
    """Neither a base that leans nor an arm that swings moves a rate: no level and no longer wait would show them."""
    spins = load_recipe("gyroscope-six-point")
    found = diagnosis_of(spins, simulate(SimulationJob(spins, ("A", "B"), seed=3)).table)
    spots = BlindSpots.of_diagnosis(found)
    assert not {"base-tilt", "lever-arm"} & set(spots.causes)
    assert not {"base-tilt", "lever-arm", "local-gravity"} & set(found.not_testable)
    assert not any("level" in remedy for remedy in spots.remedies)


def test_a_short_shared_column_is_none_of_a_long_one() -> None:
    """A turn of 100 deg/s is a hundred thousand noises long, what goes round the table one: both are known."""
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((2, 8, 3)) * [1e5, 1.0, 1e-3]
    basis, logdet = _orthonormal(columns)
    assert basis.shape[-1] == 3
    np.testing.assert_allclose(logdet, np.linalg.slogdet(np.einsum("umi,umj->ij", columns, columns))[1], rtol=1e-9)
    twice, same = _orthonormal(columns[..., [0, 1, 2, 1]] * [1.0, 1.0, 1.0, 0.0])
    assert twice.shape[-1] == 3
    np.testing.assert_allclose(same, logdet, rtol=1e-9)
