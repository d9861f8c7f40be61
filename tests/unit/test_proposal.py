"""The next run of ties that a diagnosis may end in."""

from dataclasses import replace

import numpy as np
import pytest

from station.diagnosis.candidates.bank import FLOOR_CAUSES, cause_library
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.visit_means import visit_means
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.planning.bench import WarmingBench, bench_of, warming_bench_of
from station.diagnosis.planning.chance import SimulatedChance
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.next_readings import NextReadings
from station.diagnosis.planning.next_run import next_run
from station.diagnosis.planning.plan import PlannedCampaign, PlannedRuns
from station.diagnosis.planning.promise import Promise, TiedCauses
from station.diagnosis.planning.proposal import Proposal, _runs_of_causes, _together, propose, rated_runs
from station.diagnosis.planning.run_menu import made_for, run_menu
from station.diagnosis.planning.suspects import CauseHypothesis, CauseTie, Suspects, suspects_of_all, usual_shapes
from station.diagnosis.search.distinguishability import nearer_by_error
from station.domain.core.types import SampleTable
from station.model.simulate import SimulationJob, simulate
from station.model.simulated_line import SimulatedLine
from station.wiring.jobs import load_job
from tests.blind.bench import hide
from tests.blind.hidden import KNOWN
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe


@pytest.mark.parametrize("variance", FLOOR_CAUSES)
def test_a_tie_with_a_variance_of_the_floor_is_no_pair_to_part(variance: str) -> None:
    """A slow cause and a bias that walks can look alike; a variance has no shape that a run could be planned for."""
    recipe = load_job("six-point")[0].recipe
    effect = next(e for e in cause_library(recipe) if e.id == "offset-temperature")
    found = CauseHypothesis(effect, "unit", 1e-3)
    campaign = MeasuredCampaign(recipe, units=2, nests=2, floor=NoiseFloor(1e-4, 0.0, 0.0))
    proposal = propose(campaign, [CauseTie(found, (variance,))])
    assert proposal is None


def test_causes_that_scatter_is_tied_with_are_parted_from_one_another() -> None:
    """Scatter leads where a warm-up, a creep and a drift are weak, each as likely: a run parts them all the same."""
    d = diagnosis_of(recipe(1), hide(recipe(1), KNOWN["warm-up"], 4, units=4, d=14.0)[0])
    found = next(c for c in d.causes if "warm-up" in (c.finding.name, *c.finding.indistinguishable_from))
    members = tuple(dict.fromkeys((found.finding.name, *found.finding.indistinguishable_from)))
    assert len(set(members) - set(FLOOR_CAUSES)) > 1
    tied = (*(m for m in members if m != "bias-walk"), "repeatability")
    scatter = replace(found.finding, name="bias-walk", accepted=None, indistinguishable_from=tied, d=0.0)
    document, proposal = next_run(replace(d, causes=(replace(found, finding=scatter, estimate=None),)))
    assert document is not None and proposal is not None
    assert set(proposal.separates) <= set(members) - set(FLOOR_CAUSES)
    assert proposal.certainty > 0.5


def once_measured(units: int) -> tuple[MeasuredCampaign, SampleTable]:
    """Six faces, gone through once in a room of 31 °C that nobody plans."""
    recipe = load_job("six-point")[0].recipe
    job = SimulationJob(recipe, tuple(f"SN{i}" for i in range(units)), 5, line=SimulatedLine(room_degC=31.0))
    table = simulate(job).table
    return MeasuredCampaign(recipe, units, 2, NoiseFloor(7e-5, 0.0, 0.0), samples=table), table


def with_one_more(campaign: MeasuredCampaign, words: str) -> PlannedCampaign:
    now = PlannedRuns.measured(campaign.recipe)
    return campaign.gone_on(next(longer for text, longer in run_menu(campaign, now) if text.startswith(words)))


def test_a_signal_within_the_error_of_a_covariate_is_one_of_the_cause() -> None:
    """s = 3(x + z·mode), z = .5: at most z² of it is left; of two units each by itself."""
    columns = np.random.default_rng(7).standard_normal((2, 40, 2))
    signal = 3 * columns[..., 0] + 1.5 * columns[..., 1] * [[1.0], [0.0]]
    x = columns[..., 0]
    beyond = np.sum(
        (signal - x * np.sum(x * signal, axis=1, keepdims=True) / np.sum(x**2, axis=1)[:, None]) ** 2, axis=1
    )
    gained = nearer_by_error(signal, columns, 1)
    assert beyond[0] > 10
    assert 0 <= beyond[0] - gained[0] <= 0.5**2
    assert gained[1] == pytest.approx(0.0, abs=1e-12)
    assert nearer_by_error(signal[0], columns[0], 1) == pytest.approx(gained[0], rel=1e-9)


def test_a_plan_holds_what_was_measured_as_it_was_and_units_go_on_to_the_next_nest() -> None:
    campaign, table = once_measured(units=2)
    scene = with_one_more(campaign, "one run once more in the next nest").problem.view.scene
    assert scene.temperature_degC is not None
    old = scene.visits.run == 0
    measured = visit_means(table, 6 * table.unit.code + table.visit)
    assert scene.time_s[old] == pytest.approx(measured.time_s, abs=1e-6)
    # A smooth course through the old and the new: no further from what was read than the thermometer is, .02 degC.
    assert scene.temperature_degC[old] == pytest.approx(measured.values["temperature_degC"], abs=3 * 0.02)
    code, _ = scene.visits.group("nest", 1)
    assert len(np.unique(code)) == 2
    for unit in range(2):
        mine = scene.visits.unit.code == unit
        assert np.all(code[mine & ~old] == 1 - code[mine & old][0])


def test_a_slow_run_is_as_much_more_certain_as_it_is_longer() -> None:
    campaign, _ = once_measured(units=1)
    plan = with_one_more(campaign, "one run slow")
    count, run = plan.problem.view.reduced.count.sum(1), plan.problem.view.scene.visits.run
    assert count[run == 1].mean() / count[run == 0].mean() == pytest.approx(10.0, rel=0.02)


def test_faces_alone_are_gone_on_with_by_tilts_half_way_between_them() -> None:
    campaign, _ = once_measured(units=1)
    menu = dict(run_menu(campaign, PlannedRuns.measured(campaign.recipe)))
    recipe = menu["one run with 12 tilts between the faces"].recipe
    felt = np.array([recipe.true_vector(p) for p in recipe.positions[6:]])
    strength = recipe.reference.strength()
    assert np.sort(np.abs(felt), axis=1) == pytest.approx(np.tile([0, 1, 1], (12, 1)) * strength / np.sqrt(2), abs=1e-9)
    assert len(np.unique(np.round(felt, 6), axis=0)) == 12
    # Six points are faces; the longer recipe must run.
    assert recipe.method == "n-point"
    longer = replace(campaign, recipe=recipe)
    slow = menu["one run with 12 tilts between the faces, slow (dwells of 10 s)"]
    assert slow.recipe.dwell.time_s == 10
    assert not any("tilts" in text for text, _ in run_menu(longer, PlannedRuns.measured(recipe)))
    # A rate is felt along the spindle, however the part stands.
    turning = PlannedRuns.measured(load_job("gyroscope-six-point")[0].recipe)
    assert not any("tilts" in text for text, _ in run_menu(campaign, turning))


def test_a_rate_of_temperature_has_a_run_in_which_it_changes_its_sign() -> None:
    campaign, _ = once_measured(units=1)
    now = PlannedRuns.measured(campaign.recipe)
    assert not any("cooled again" in text for text, _ in run_menu(campaign, now, {"warm-up"}))
    swinging = next(r for text, r in run_menu(campaign, now, {"temperature-rate"}) if "cooled again" in text)
    scene = campaign.gone_on(swinging, exact=True).problem.view.scene
    new = scene.visits.run == 1
    assert scene.temperature_degC is not None and scene.temperature_rate is not None
    # The usual bench warms by 2.5 °C in ten minutes: in a third of one half a degree is three times as fast.
    assert np.ptp(scene.temperature_degC[new]) == pytest.approx(0.5, abs=0.1)
    assert np.sign(scene.temperature_rate[new]).tolist() == [1, 1, 1, -1, -1, -1]
    # So does the simulated bench.
    told = simulate(SimulationJob(swinging.recipe, ("a",), 5)).scene
    warm = np.bincount(told.visit, told.require("temperature_degC")) / np.bincount(told.visit)
    assert np.sign(np.diff(warm[6:]))[[0, 1, -2, -1]].tolist() == [1, 1, -1, -1]


def test_the_run_made_for_a_tied_cause_is_looked_at_once_whatever_the_bound_ranks_first() -> None:
    campaign, _ = once_measured(units=1)
    now = PlannedRuns.measured(campaign.recipe)
    tied = [Suspects((), TiedCauses((), (), np.inf), ("temperature-rate", "warm-up"))]
    found = _runs_of_causes(campaign, now, tied, None)
    assert {made_for(p.recipe.runs[-1]) for p in found} == {"temperature-rate"}
    assert _runs_of_causes(campaign, found[0].campaign, tied, None) == []
    assert _runs_of_causes(campaign, now, [replace(tied[0], members=("bias-drift", "warm-up"))], None) == []


def test_a_plan_reads_the_thermometer_as_badly_as_it_was_read() -> None:
    """Its visits are off by .2 °C, ten times as much as any simulated thermometer."""
    campaign, table = once_measured(units=4)
    off = 0.2 * np.random.default_rng(3).standard_normal((4, 6))[table.unit.code, table.visit]
    read = replace(table, values={**table.values, "temperature_degC": table.values["temperature_degC"] + off})
    scene = with_one_more(replace(campaign, samples=read), "one run motors off").problem.view.scene
    assert scene.temperature_degC is not None
    planned = scene.temperature_degC[scene.visits.run == 1].reshape(4, 6)
    # The room is even: what is left of a line is the thermometer's, 16 numbers, and the estimate from as many bends.
    at = np.vander(np.arange(6.0), 2)
    left = planned.T - at @ np.linalg.lstsq(at, planned.T, rcond=None)[0]
    assert 0.05 < np.sqrt(np.sum(left**2) / 16) < 0.6


def test_a_visit_that_is_off_is_taken_to_be_the_one_that_reads_so() -> None:
    """Of six measured visits one is off by 50 times its noise: no other is the disturbed one in what is simulated."""
    campaign, table = once_measured(units=1)
    off = np.where(table.visit == 3, 50 * campaign.floor.noise, 0.0)[:, None] * [0.0, 1.0, 0.0]
    plan = with_one_more(replace(campaign, samples=replace(table, reading=table.reading + off)), "one run reversed")
    (candidate,) = (c for c in usual_shapes(plan, "disturbed-visit") if c.effect is None)
    readings = NextReadings(plan.problem, plan.floor, np.zeros((3, 3)), measured=1)
    rng = np.random.default_rng(1)
    assert {int(np.argmax(readings.hit(candidate, 1e-3, rng))) for _ in range(50)} == {3}


def test_one_unit_on_six_faces_has_a_run_beside_a_visit_that_may_be_off() -> None:
    """Here a visit that may read anything leads, of no effect's form."""
    recipe = load_job("six-point")[0].recipe
    asymmetry = next(e for e in cause_library(recipe) if e.id == "asymmetry")
    job = SimulationJob(recipe, ("SN0001",), 5, (replace(asymmetry, size=6e-4),))
    d = diagnosis_of(recipe, simulate(job).table)
    assert any("disturbed-visit" in (c.finding.name, *c.finding.indistinguishable_from) for c in d.causes)
    document, proposal = next_run(d)
    assert document is not None and proposal is not None
    assert proposal.certainty > 0.5


def test_what_one_nest_cannot_tell_is_planned_for_in_another() -> None:
    """Turned in the seat, a nest's tilt parts from the part's, and is tied with errors of the positions, which one run
    did not show: the promise knows it, and another nest parts these."""
    campaign, _ = once_measured(units=1)
    tilt = next(e for e in cause_library(campaign.recipe) if e.id == "nest-tilt")
    table = simulate(SimulationJob(campaign.recipe, ("SN0",), 5, (replace(tilt, size=2e-3),))).table
    campaign = replace(campaign, nests=1, samples=table, hidden=("index-error",))
    tie = CauseTie(CauseHypothesis(tilt, "nest", 2e-3), ("package-rotation",))
    turned = next(p for p in rated_runs(campaign, [tie]) if "turned 180" in p.change)
    assert set(turned.leaves) == {"nest-tilt", "index-error"}
    assert turned.certainty == pytest.approx(0.5, abs=0.01)
    found = propose(campaign, [tie])
    assert found is not None and found.another_nest
    assert found.certainty > 0.9


def test_a_cause_follows_the_temperature_and_not_what_its_thermometer_is_off_by() -> None:
    campaign, table = once_measured(units=4)
    off = 0.2 * np.random.default_rng(3).standard_normal((4, 6))[table.unit.code, table.visit]
    read = replace(table, values={**table.values, "temperature_degC": table.values["temperature_degC"] + off})
    now = PlannedRuns.measured(campaign.recipe)
    longer = next(runs for text, runs in run_menu(campaign, now) if text.startswith("one run motors off"))
    scene = replace(campaign, samples=read).gone_on(longer, exact=True).problem.view.scene
    assert scene.temperature_degC is not None
    planned = scene.temperature_degC[scene.visits.run == 1].reshape(4, 6)
    # Beside a thermometer that is off by .2 °C from visit to visit a bench warms along a smooth course.
    assert np.abs(np.diff(planned, 2, axis=1)).max() < 0.005


@pytest.mark.parametrize("heating_degC", [0.3, 6.0])
def test_a_short_run_says_how_much_a_bench_warms(heating_degC: float) -> None:
    """Six tilts in a quarter of a minute: the time constant is anyone's, what it warms by is not."""
    recipe = load_job("six-point")[0].recipe
    line = SimulatedLine(heating_degC=heating_degC, heating_tau_s=300.0, wander_degC=0.0)
    table = simulate(SimulationJob(recipe, ("a", "b"), 5, line=line)).table
    found = bench_of(reduce_samples(recipe, table).scene)
    begin = found.heating_degC / found.heating_tau_s
    assert 100.0 < found.heating_tau_s < 1600.0
    assert begin == pytest.approx(heating_degC / 300.0, abs=0.4 * heating_degC / 300.0 + 0.004)


def test_a_bench_goes_on_as_it_was_measured_and_not_as_one_exponential_does() -> None:
    """A room that warms as fast all along: in a next run, too, for as long as this one was, and little beyond."""
    recipe = load_job("six-point")[0].recipe
    scene = reduce_samples(recipe, simulate(SimulationJob(recipe, ("a", "b"), 5)).table).scene
    assert scene.since_power_s is not None
    since = np.sort(scene.since_power_s)
    bench = warming_bench_of(replace(scene, temperature_rate=np.full(len(scene), 0.02)))
    within = np.linspace(since[0], since[-1], 50)
    rate = np.gradient(bench.warmed_degC(within), within)
    assert rate == pytest.approx(0.02, abs=1e-3)
    late = bench.warmed_degC(since[-1] + bench.line.heating_tau_s * np.array([20.0, 21.0]))
    assert late[1] == pytest.approx(late[0], abs=1e-6)
    # It may as well be the room's drift, which no power-on begins anew.
    drifting = replace(bench, goes_on=True)
    assert drifting.warmed_degC(within) == pytest.approx(bench.warmed_degC(within))
    assert np.diff(drifting.warmed_degC(since[-1] + np.array([0.0, 600.0]))) == pytest.approx(12.0)


def test_one_run_is_planned_on_with_a_room_that_drifts_as_well() -> None:
    """A chance is that of both benches; several runs say what begins anew with each power-on."""
    campaign, _ = once_measured(units=1)
    seen = WarmingBench(since_power_s=np.array([2.0, 9.0]), more_degC_s=np.zeros(2))
    drifting = replace(campaign, bench=seen).on_drifting_bench
    assert campaign.on_drifting_bench is None and drifting is not None and drifting.bench.goes_on
    assert replace(campaign, recipe=recipe(2), bench=seen).on_drifting_bench is None
    now = PlannedRuns.measured(campaign.recipe)
    one, other = (
        Proposal(now, "", 1.0, Promise((), {}, {("a", "b"): chance}), SimulatedChance(round(8 * chance), 8))
        for chance in (1.0, 0.25)
    )
    both = _together(one, other)
    assert both.chance == SimulatedChance(10, 16)
    assert both.promise.simulated == {("a", "b"): 0.625}


def test_ties_of_very_many_causes_are_planned_for_the_likeliest_alone() -> None:
    """What could be anything is parted by no run, and each pair of causes costs as much as the first."""
    campaign, _ = once_measured(units=3)
    library = {e.id: e for e in cause_library(campaign.recipe)}
    names = ["disturbed-visit", *(name for name in sorted(library) if name != "disturbed-visit")][:15]
    found = CauseHypothesis(library[names[0]], "visit", 1e-3)
    likely = {name: 1.0 / (i + 1) for i, name in enumerate(names)}
    lines_up = suspects_of_all(campaign, [CauseTie(found, tuple(reversed(names[1:])), 12.0, likely)] * 6)
    assert len(lines_up) == 2
    assert set(lines_up[0].members) == set(names[:6])
