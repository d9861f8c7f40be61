"""The floor: variances come back as they were put in, the bounds hold, and known columns cost what they must."""

from dataclasses import replace

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.data import preflight
from station.diagnosis.data.reduce import clip_outliers, reduce_samples
from station.diagnosis.linear import noise_floor as floors
from station.diagnosis.linear.grid import VisitGrid
from station.diagnosis.linear.projection import DataColumns, NuisanceColumns, residual_space
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.model.effects.bias_walk import BiasWalk
from station.model.model_file import Model
from station.model.simulate import SimulationJob, parse_effects, simulate
from station.model.timeline import noise_density_of
from tests.blind.bench import hide
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe, six_faces
from tests.blind.test_placed_by_hand import skewed_and_square

UNITS, RUNS, STOPS, K = 4, 3, 24, 3


def structure(rng: np.random.Generator) -> tuple[VisitGrid, floors.FloorStructure, np.ndarray]:
    """A campaign of random directions, the same in every unit."""
    slot = np.arange(UNITS * RUNS * STOPS).reshape(UNITS, RUNS, STOPS)
    a = rng.standard_normal((RUNS * STOPS, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    turn = np.zeros((RUNS * STOPS, 3, 3))
    turn[:, 0, 1], turn[:, 0, 2], turn[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
    turn = np.tile(turn - turn.transpose(0, 2, 1), (UNITS, 1, 1))
    n = slot.size
    steps = np.tile(np.arange(1.0, STOPS + 1), UNITS * RUNS)
    grid = VisitGrid(slot, K)
    made = floors.floor_structure(grid, np.ones(n), turn, steps, np.tile(np.eye(3), (n, 1, 1)))
    return grid, made, np.tile(a, (UNITS, 1))


def offsets(grid: VisitGrid) -> NuisanceColumns:
    """One offset a unit and axis."""
    columns = grid.spread(np.tile(np.eye(3), (grid.slot.size, 1, 1)))
    none = DataColumns(columns[..., :0])
    return NuisanceColumns(
        DataColumns(columns), np.zeros((UNITS, 3)), np.zeros((UNITS, 3)), none, np.zeros(0), np.zeros(0)
    )


def drawn(grid: VisitGrid, made: floors.FloorStructure, variances: np.ndarray, rng: np.random.Generator) -> DataColumns:
    """Readings with exactly this floor."""
    return DataColumns(made.covariance(variances).runs.coloured(rng.standard_normal((UNITS, RUNS, STOPS * K, 1))))


@pytest.mark.parametrize("variances", [(4.0, 0.0, 0.0), (1.0, 4.0, 0.0), (1.0, 0.0, 0.5), (1.0, 2.0, 0.3)])
def test_the_estimate_is_unbiased_and_its_deviation_covers(variances: tuple[float, ...]) -> None:
    rng = np.random.default_rng(5)
    grid, made, _ = structure(rng)
    known, true, upper = offsets(grid), np.array(variances), np.full(3, np.inf)
    found, std = [], []
    for _ in range(12):
        fitted = floors.fit(made, known, drawn(grid, made, true, rng), grid.data, upper)
        found.append(fitted.floor.variances)
        std.append(np.sqrt(np.diag(fitted.covariance)))
    error = np.mean(found, axis=0) - true
    # Twelve campaigns; at the border 0 an estimate can only be too large.
    allowed = 4 * np.mean(std, axis=0) / np.sqrt(12) + 0.6 * np.mean(std, axis=0) * (true == 0)
    assert np.all(np.abs(error) < allowed)


def test_the_best_floor_is_found_from_wherever_the_search_begins() -> None:
    """A start at the bounds, in noise that is far too large, led off the box, and the cut step no way up."""
    table, _ = hide(six_faces("listed"), skewed_and_square, 1, units=5)
    problem = initial_problem(reduce_samples(six_faces("listed"), table), FloorAllowance())
    best, most = problem.fit(), np.sqrt(problem.upper[1:])
    for noise in (0.1, 1.0, 2.0, 10.0):
        for turn, walk in ((0, 0), (0, 1), (1, 0), (1, 1)):
            start = floors.NoiseFloor(noise * best.floor.noise, turn * float(most[0]), walk * float(most[1]))
            assert problem.fit(start).space.loglik == pytest.approx(best.space.loglik, abs=1e-2)


def test_a_floor_asked_for_again_is_the_one_made_before(monkeypatch: pytest.MonkeyPatch) -> None:
    _, made, _ = structure(np.random.default_rng(6))
    asked = [np.array([1.0, 0.5, 0.1 * i]) for i in range(floors.KEPT_COVARIANCES + 1)]
    every = [made.covariance(variances) for variances in asked]
    assert made.covariance(asked[-1].copy()) is every[-1]
    # No more than the last ones are kept, and none of another member's.
    again = made.covariance(asked[0])
    assert again is not every[0] and np.array_equal(again.runs.inverse, every[0].runs.inverse)
    assert len(replace(made, member=made.member[:1]).covariance(asked[0]).live) == 1
    monkeypatch.setattr(floors, "MOST_KEPT_NUMBERS", 0)
    assert made.covariance(asked[-1]) is not every[-1]


def test_no_variance_leaves_its_bounds() -> None:
    rng = np.random.default_rng(6)
    grid, made, _ = structure(rng)
    rows = drawn(grid, made, np.array([1.0, 9.0, 1.0]), rng)
    fitted = floors.fit(made, offsets(grid), rows, grid.data, np.array([np.inf, 4.0, 0.1]))
    assert fitted.floor.turn <= 2.0 + 1e-12
    assert fitted.floor.walk**2 <= 0.1 + 1e-12


@pytest.mark.parametrize("visits", [7, floors.MANY_VISITS, floors.MANY_VISITS + 5])
def test_what_a_walk_makes_of_rows_is_their_square_in_it(visits: int) -> None:
    """Sums over few visits are products of matrices, over many they are made one by one, as `walked` makes all."""
    rng = np.random.default_rng(3)
    grid, n = VisitGrid(np.arange(2 * visits).reshape(2, 1, visits), K), 2 * visits
    turn, steps = rng.standard_normal((n, 3, 3)), np.tile(np.arange(1.0, visits + 1), 2)
    made = floors.floor_structure(grid, np.ones(n), turn, steps, np.tile(np.eye(3), (n, 1, 1)))
    rows = rng.standard_normal((2, 1, visits * K, 4))
    square = np.einsum("urmc,urmc->c", rows, made.times(rows)[..., 2, :])
    assert made.walked(rows, slice(None)) == pytest.approx(square, rel=1e-10)


def test_a_fitted_floor_leaves_as_much_as_there_are_numbers() -> None:
    rng = np.random.default_rng(7)
    grid, made, _ = structure(rng)
    fitted = floors.fit(
        made, offsets(grid), drawn(grid, made, np.array([3.0, 1.0, 0.2]), rng), grid.data, np.full(3, np.inf)
    )
    assert fitted.space.dof == UNITS * RUNS * STOPS * K - UNITS * 3
    assert fitted.space.rest == pytest.approx(fitted.space.dof, rel=1e-3)


def test_known_columns_leave_nothing_of_themselves() -> None:
    rng = np.random.default_rng(8)
    grid, made, _ = structure(rng)
    known = offsets(grid)
    observed = residual_space(
        made.covariance(np.array([1.0, 0.5, 0.1])), known, drawn(grid, made, np.ones(3), rng), grid.data
    )
    assert np.abs(observed.project(known.own)).max() < 1e-9


def test_a_prior_lies_between_knowing_and_not_knowing() -> None:
    rng = np.random.default_rng(9)
    grid, made, _ = structure(rng)
    rows = DataColumns(drawn(grid, made, np.array([1.0, 0.0, 0.0]), rng).visit + 5.0)
    covariance = made.covariance(np.array([1.0, 0.0, 0.0]))
    free = offsets(grid)
    rests = []
    for precision in (0.0, 1.0, 1e9):
        known = NuisanceColumns(
            free.own, np.full((UNITS, 3), precision), free.per_unit_target, free.shared, np.zeros(0), np.zeros(0)
        )
        rests.append(residual_space(covariance, known, rows, grid.data).rest)
    assert rests[0] < rests[1] < rests[2]


@pytest.mark.parametrize("seed", [1, 5])
def test_six_stops_a_unit_are_not_fitted_more_closely_than_their_samples_scatter(seed: int) -> None:
    """Six faces and one run part σ and repeatability only by luck; a floor near 0 judged every gain by chance."""
    six = load_recipe("six-point")
    table = simulate(SimulationJob(six, ("A", "B", "C", "D"), seed, parse_effects(("cross-axis",), six))).table
    found = diagnosis_of(six, table)
    white = float(noise_density_of(six) / np.sqrt(2 * six.dwell.longest_s))
    assert white / 2.5 < found.floor.floor.noise < 3 * white
    (cause,) = found.causes
    assert cause.finding.name == "cross-axis"
    assert cause.gain.accepted
    assert cause.gain.rms_after < 1e-3


def test_an_outlier_among_few_is_clipped_and_motion_is_not() -> None:
    rng = np.random.default_rng(3)
    visit = np.repeat(np.arange(40), 25)
    late = np.tile(0.04 * np.arange(25), 40)
    noise = rng.standard_normal((1000, 1))
    few = late < 0.16
    outliers = np.zeros((1000, 1))
    outliers[[0, 26, 52, 78]] = 30.0
    calm = clip_outliers(noise + outliers, visit, np.ones(1), few)
    assert np.abs(calm[outliers != 0]).max() < 6
    for moving in (50 * np.exp(-late / 0.1), 50 * np.cos(2 * np.pi * 6 * late) * np.exp(-late / 0.2), 50 * late):
        observed = noise + moving[:, None]
        # Five standard deviations: one normal sample in twenty thousand.
        assert np.count_nonzero(clip_outliers(observed, visit, np.ones(1), few) != observed) <= 3


@pytest.mark.parametrize("loud", [1.0, 2.5])
def test_each_axis_has_the_noise_of_its_samples(loud: float) -> None:
    made = simulate(SimulationJob(recipe(1), ("A", "B"), 4)).table
    rng = np.random.default_rng(4)
    reading = made.reading + rng.standard_normal(made.reading.shape) * [4e-4, 4e-4, 4e-4 * loud]
    problem = initial_problem(reduce_samples(recipe(1), replace(made, reading=reading)), FloorAllowance())
    share = problem.view.reduced.axis_noise
    assert np.mean(share**2) == pytest.approx(1.0)
    if loud == 1.0:
        # 1,200 differences: chance alone parts the axes by some percent, of which hardly any is believed.
        assert share == pytest.approx(np.ones(3), abs=0.06)
        return
    assert share[2] / share[:2] == pytest.approx([loud, loud], rel=0.25)
    variance = problem.structure.visit_variance(np.array([1.0, 0.0, 0.0])).reshape(-1, 3)
    assert variance[:, 2] / variance[:, 0] == pytest.approx((share[2] / share[0]) ** 2 * np.ones(len(variance)))


@pytest.mark.parametrize("scattered", [True, False])
def test_a_visit_has_the_noise_of_its_samples_only_where_its_mean_scatters_with_it(scattered: bool) -> None:
    made = simulate(SimulationJob(recipe(1), ("A", "B"), 4)).table
    rng = np.random.default_rng(4)
    of = np.cumsum(np.diff(made.visit, prepend=made.visit[0]) != 0)
    shaken = 1e-3 * np.exp(rng.normal(0, 0.4, (of[-1] + 1, 3)))[of] * rng.standard_normal(made.reading.shape)
    if not scattered:
        # The same shaking, but it leaves every mean where it is.
        shaken -= np.stack([np.bincount(of, column) / np.bincount(of) for column in shaken.T], axis=1)[of]
    problem = initial_problem(reduce_samples(recipe(1), replace(made, reading=made.reading + shaken)), FloorAllowance())
    assert np.any(problem.view.reduced.axis_excess != 1.0) == scattered


@pytest.mark.parametrize("noisier", [0.2, 1.0, 10.0])
def test_the_bias_of_a_noisier_device_may_walk_further(noisier: float) -> None:
    usual = recipe(1)
    device = usual.device.model_copy(update={"noise_density": noisier * noise_density_of(usual)})
    allowed = FloorAllowance.of(usual.model_copy(update={"device": device}), Model())
    assert (allowed.turn, allowed.walk) == pytest.approx((1e-4, 1e-5 * max(1.0, noisier)))


def test_a_device_without_a_sheet_may_walk_as_far_as_any() -> None:
    allowed = FloorAllowance.of(load_recipe("hand-held"), Model())
    assert allowed.walk == pytest.approx(BiasWalk.parameter.high)


def test_what_wanders_with_the_noise_of_a_noisy_device_is_no_finding() -> None:
    """One whose samples scatter by 20 mg, and its bias from visit to visit by 1.5 mg; nobody stated its sheet."""
    usual = recipe(3)
    stated = usual.device.model_fields_set - {"noise_density", "lsb", "rate_hz"}
    silent = type(usual.device).model_validate(usual.device.model_dump(include=stated))
    made = simulate(SimulationJob(usual, ("A",), 4)).table
    rng, visit = np.random.default_rng(7), np.unique(made.run * 100 + made.visit, return_inverse=True)[1]
    walk = np.cumsum(1.5e-3 * rng.standard_normal((visit.max() + 1, 3)), axis=0)[visit]
    reading = made.reading + walk + 0.02 * rng.standard_normal(made.reading.shape)
    checked, table = preflight.inspect(usual.model_copy(update={"device": silent}), replace(made, reading=reading))
    kind = preflight.with_sheet(usual.model_copy(update={"device": silent}), checked)
    problem = initial_problem(reduce_samples(kind, table), FloorAllowance.of(kind, Model()))
    # Three standard deviations beyond the bound would be a finding.
    assert all(grown.gain < 4.5 for grown in problem.grown_floors.values())


def test_a_filtered_device_may_walk_as_much_further_as_its_means_scatter() -> None:
    made = simulate(SimulationJob(recipe(1), ("A", "B"), 4)).table
    rng = np.random.default_rng(4)
    white = 5e-3 * rng.standard_normal((len(made.reading) + 7, 3))
    # The mean of eight neighbours: from one sample to the next it moves by half of what it scatters.
    reading = made.reading + np.stack([np.convolve(axis, np.ones(8) / 8, "valid") for axis in white.T], axis=1)
    bare, smooth = (
        initial_problem(reduce_samples(recipe(1), replace(made, reading=r)), FloorAllowance()).upper
        for r in (made.reading, reading)
    )
    assert bare[2] == pytest.approx(1e-10, rel=0.5)
    assert smooth[2] > 2 * bare[2]
