"""Causes and kernels on one axis, or in one unit."""

from dataclasses import replace

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.candidates.bank import candidates
from station.diagnosis.candidates.input_kernels import functions_of_input
from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.extent import Extent, best_extent, extents, ranks_beside_scan
from station.diagnosis.search.other_starts import AHEAD_NATS
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.rank import rank_causes
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.walk_marginal import score_over_walks
from station.domain.core.types import Floats
from station.model.effects.asymmetry import Asymmetry
from station.model.effects.cross_axis import CrossAxis
from station.model.model_file import Model
from station.model.simulate import SimulationJob, simulate

UNITS, SIZE = 6, 5e-4


def six_faces(acts: Floats) -> ScoringProblem:
    """Six faces by six units, whose gains differ from side to side where they act (units, 3)."""
    recipe = load_recipe("six-point")
    table = simulate(SimulationJob(recipe, tuple(f"SN{i}" for i in range(UNITS)), seed=11)).table
    # Alike everywhere but for the sign: of sizes drawn at random one unit may have nearly all.
    coefficient = SIZE * np.random.default_rng(2).choice([-1.0, 1.0], (UNITS, 3)) * acts
    reading = table.reading + coefficient[table.unit.code] * np.abs(table.reading)
    return initial_problem(reduce_samples(recipe, replace(table, reading=reading)), FloorAllowance.of(recipe, Model()))


def best_of_asymmetry(problem: ScoringProblem) -> Extent | None:
    return best_extent(problem, candidates(Asymmetry.example(), problem.view), problem.fit().floor)


@pytest.mark.parametrize(("acts", "where"), [(np.eye(3)[1], 1), (np.eye(UNITS)[4][:, None], 3 + 4), (1.0, None)])
def test_a_cause_is_looked_at_where_it_acts(acts: Floats, where: int | None) -> None:
    problem = six_faces(np.broadcast_to(acts, (UNITS, 3)))
    found = best_of_asymmetry(problem)
    if where is None:
        assert found is None
    else:
        assert found is not None
        assert np.array_equal(found.weight, extents(problem.view)[where].weight)


def test_beside_a_jump_of_one_unit_a_drift_of_that_unit_pays_for_no_other() -> None:
    recipe = load_recipe("six-point")
    table = simulate(SimulationJob(recipe, tuple(f"SN{i}" for i in range(UNITS)), seed=11)).table
    drift = np.where(table.unit.code == 4, 5e-5 * (table.time_s - 10.0), 0.0)
    reading = table.reading + drift[:, None] * np.eye(3)[1]
    problem = initial_problem(
        reduce_samples(recipe, replace(table, reading=reading)), FloorAllowance.of(recipe, Model())
    )
    banks = [bank.named({"step", "bias-drift"}) for bank in CandidateBanks(problem.view).of(problem.view, ())]
    banks = [bank for bank in banks if bank.candidates]
    floor = problem.fit().floor
    ranks = rank_causes(problem, banks, score_over_walks(problem, banks, floor), KERNEL_NAMES)
    beside = ranks_beside_scan(problem, banks, ranks, floor)
    assert ranks["step"].evidence > ranks["bias-drift"].evidence + AHEAD_NATS
    assert beside["bias-drift"].evidence > beside["step"].evidence + AHEAD_NATS


def test_what_turns_axes_into_each_other_is_on_no_axis_alone() -> None:
    view = six_faces(np.zeros((UNITS, 3))).view
    of_axis, of_unit = extents(view)[0], extents(view)[4]
    for one in candidates(CrossAxis.example(), view):
        assert of_axis.of(one) is None
        cut = of_unit.of(one)
        assert cut is not None
        assert np.array_equal(np.any(cut.visit, axis=(1, 2)), view.scene.visits.unit.code == 1)


def test_forms_of_the_last_digits_of_a_pose_are_none() -> None:
    """Six faces, turned there by quaternions of twelve digits: what an axis feels of the others is no form of it."""
    view = six_faces(np.zeros((UNITS, 3))).view
    visits, error = view.scene.visits, 1e-12 * np.random.default_rng(3).standard_normal((len(view.stimulus), 3, 3))
    rounded = replace(view.scene, visits=replace(visits, nest_R=visits.nest_R + error))
    there = replace(view, reduced=replace(view.reduced, scene=rounded))
    assert not np.array_equal(there.stimulus, view.stimulus)
    forms = [list(functions_of_input(x.nominal_stimulus)) for x in (view, there)]
    for one, other in zip(*forms, strict=True):
        assert np.array_equal(one != 0.0, other != 0.0)
