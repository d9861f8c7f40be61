"""The chance of a plan by simulated diagnoses: what the sets hold, and what is counted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.diagnosis.candidates.bank import cause_library
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.planning.bench import WarmingBench
from station.diagnosis.planning.chance import PROMISED_SETS, PlanSimulator, SimulatedChance, shared_out
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.next_readings import NextReadings
from station.diagnosis.planning.plan import PlannedRuns
from station.diagnosis.planning.proposal import promised, propose, rated_runs
from station.diagnosis.planning.run_menu import run_menu
from station.diagnosis.planning.suspects import CauseHypothesis, CauseTie, suspects_of, usual_shapes
from station.model.simulate import SimulationJob, simulate
from station.wiring.jobs import load_job

SETS = 200


def with_one_more(campaign: MeasuredCampaign, words: str) -> PlannedRuns:
    now = PlannedRuns.measured(campaign.recipe)
    return next(longer for text, longer in run_menu(campaign, now) if text.startswith(words))


@given(st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=9), st.integers(0, 300))
def test_sets_are_shared_out_by_weight_to_the_next_whole_number(weights: list[float], count: int) -> None:
    each = shared_out(np.array(weights), count)
    assert each.sum() == count
    assert np.all(np.abs(each - count * np.array(weights) / sum(weights)) < 1)


@given(st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_an_interval_holds_its_share_and_stays_a_chance(counts: tuple[int, int]) -> None:
    chance = SimulatedChance(*counts)
    low, high = chance.interval
    assert 0.0 <= low <= chance.share <= high <= 1.0


def test_sets_keep_what_was_measured_and_scatter_about_what_is_planned_as_white_noise_does() -> None:
    recipe = load_job("six-point")[0].recipe
    table = simulate(SimulationJob(recipe, ("SN1", "SN2"), 5)).table
    campaign = MeasuredCampaign(recipe, 2, 2, NoiseFloor(7e-5, 0.0, 0.0), samples=table)
    plan = campaign.gone_on(with_one_more(campaign, "one run motors off"))
    drift = usual_shapes(plan, "bias-drift")[0]
    readings = NextReadings(plan.problem, plan.floor, np.zeros((3, 3)), measured=1)
    drawn = readings.sets(drift, 1e-12, SETS, np.random.default_rng(1))
    old = plan.problem.readings(moving=True)[0]
    assert np.allclose(drawn.visits[:, 0], old.visit[:, 0], atol=1e-6)
    assert not np.allclose(drawn.visits[:, 1, :, 0], drawn.visits[:, 1, :, 1])
    # A new reading is off what the old ones predict by a normal number of its standard deviation: each adds 1 to the
    # sum of squares, which calibrations are fitted in, on the average.
    space = plan.problem.space(plan.floor, moving=False)
    U, R, m = drawn.visits.shape[:3]
    white = space.covariance.runs.whiten(drawn.visits.astype(float)).reshape(U, R * m, SETS)
    both = np.concatenate([plan.problem.known.own.visit, old.visit], axis=-1)
    both[:, 1:] = 0.0
    alone = space.covariance.runs.whiten(both)
    alone = alone.reshape(U, R * m, -1)
    rest = sum(float(np.linalg.lstsq(a[:, :-1], a[:, -1], rcond=None)[1].sum()) for a in alone)
    padded = np.zeros((U, space.basis.shape[1], SETS))
    padded[:, : R * m] = white
    added = np.sum(space.free(padded) ** 2, axis=(0, 1)) - rest
    new = U * m
    assert added.mean() == pytest.approx(new, abs=4 * np.sqrt(2 * new / SETS))


def test_a_plan_is_likelier_the_stronger_its_causes_are_and_sure_of_strong_ones() -> None:
    recipe = load_job("six-point")[0].recipe
    tilt = next(e for e in cause_library(recipe) if e.id == "nest-tilt")
    campaign = MeasuredCampaign(recipe, units=4, nests=2, floor=NoiseFloor(1e-4, 0.0, 0.0))
    runs = with_one_more(campaign, "one run once more in the next nest")
    shares = []
    for d in (4.0, 40.0):
        tie = CauseTie(CauseHypothesis(tilt, "nest", 1e-3), ("package-rotation",), d)
        lines_up = [suspects_of(campaign, tie)]
        found = PlanSimulator.of(campaign, runs, lines_up).simulated(lines_up, PROMISED_SETS)
        shares.append(found.chance.share)
    assert shares[0] < 0.8
    assert shares[1] > 0.95
    assert found.parted["nest-tilt", "package-rotation"] > 0.95


def test_no_run_is_proposed_for_a_visit_that_was_disturbed_once() -> None:
    """In one position no further run can show it again."""
    recipe = load_job("one-point")[0].recipe
    disturbed = next(e for e in cause_library(recipe) if e.id == "disturbed-visit")
    campaign = MeasuredCampaign(recipe, units=1, nests=1, floor=NoiseFloor(1e-4, 0.0, 0.0))
    tie = CauseTie(CauseHypothesis(disturbed, "visit", 1e-3), ("temperature-rate",), 20.0)
    assert propose(campaign, [tie]) is None


def test_what_chose_a_run_is_not_made_again_to_promise_by() -> None:
    recipe = load_job("six-point")[0].recipe
    tilt = next(e for e in cause_library(recipe) if e.id == "nest-tilt")
    warmed = WarmingBench(since_power_s=np.array([10.0, 60.0]), more_degC_s=np.zeros(2))
    campaign = MeasuredCampaign(recipe, units=1, nests=1, floor=NoiseFloor(1e-4, 0.0, 0.0), bench=warmed)
    assert campaign.on_drifting_bench is campaign.on_drifting_bench is not None
    ties = [CauseTie(CauseHypothesis(tilt, "nest", 1e-3), ("package-rotation",), 20.0)]
    once = promised(campaign, next(rated_runs(campaign, ties)), ties)
    again = promised(campaign, once, ties)
    assert list(again.simulators.values()) == list(once.simulators.values()) != []
    assert again.chance == once.chance
