"""Dwells that end when the coefficients are good enough: the plan, what it rests on, and the rule of the run."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.domain.core.types import Floats
from station.domain.noise import noise_document
from station.domain.noise.noise_prior import learn_prior
from station.domain.noise.running_noise import NoiseCurve, dwell_noise, family_length, likelihoods, noise_curve
from station.domain.planning import adaptive_dwell, nominal_visits
from station.domain.planning.adaptive_dwell import ROUNDS, DwellProgress
from station.domain.planning.allocation import NEAR
from station.domain.recipe.blocks import DwellRule
from station.domain.recipe.recipe import Recipe
from station.service.dwell_control import AdaptiveDwell, FixedDwell, control_for
from tests.fakes import tumble

DENSITY, RATE = 1e-4, 100.0
WHITE = DENSITY**2 / 2


def recipe(method: str = "six-point", until_std: float = 5e-5, **more: Any) -> Recipe:
    """Six faces or what the method wants, with a sheet of 100 ug/rtHz."""
    dwell = {"until_std": until_std, "min_s": 0.2, "max_s": 20}
    return tumble.recipe(method, **{"device": {"rate_hz": RATE, "noise_density": DENSITY}, "dwell": dwell, **more})


def known(density: Floats, stops: int = 0) -> NoiseCurve:
    """White noise of so much variance · s in each axis (f, 3)."""
    f = len(density)
    return NoiseCurve(np.ones(1), density[..., None] * RATE, np.full((f, 3, 1), 1e9), np.ones((f, stops, 3)))


def test_six_faces_share_the_time_evenly() -> None:
    """A gain is half the difference of two faces: variance D/(2T), so T = D/(2 std²) at each of the six."""
    assert adaptive_dwell.planned_dwells_s(recipe(), WHITE) == pytest.approx(np.full(6, 1.0), rel=2e-3)


def test_one_position_gives_an_offset_its_own_standard_deviation() -> None:
    assert adaptive_dwell.planned_dwells_s(recipe("one-point"), WHITE) == pytest.approx([WHITE / 5e-5**2], rel=1e-3)


def test_a_fixed_dwell_is_planned_as_it_stands() -> None:
    assert np.array_equal(adaptive_dwell.planned_dwells_s(recipe(dwell={"time_s": 0.7}), WHITE), np.full(6, 0.7))


def test_matrix_entries_count_by_what_they_do_at_the_strongest_stimulus() -> None:
    field = tumble.recipe("n-point", "magnetometer", dwell={"until_std": 0.1})
    std = adaptive_dwell.accuracy_target(field).std
    assert std[:3] == pytest.approx([0.1] * 3)
    assert std[3:] == pytest.approx([0.1 / np.hypot(20, 44)] * 9)


def test_what_a_method_does_not_estimate_is_not_waited_for() -> None:
    assert np.isinf(adaptive_dwell.accuracy_target(recipe("one-point")).std[3:]).all()


def test_hand_held_stops_are_planned_as_spread_evenly() -> None:
    held = tumble.recipe("norm", positions=[], reference={"source": "gravity", "magnitude": 1.0, "pose": "unknown"})
    assert len(nominal_visits.truths(held)) == 24
    assert np.linalg.norm(nominal_visits.truths(held), axis=1) == pytest.approx(np.ones(24))


def test_uneven_positions_are_shared_as_no_optimiser_betters() -> None:
    """n-point with a lopsided set: dwells and weights are found together."""
    rng = np.random.default_rng(3)
    ups = {f"p{i}": v / np.linalg.norm(v) for i, v in enumerate(rng.standard_normal((7, 3)))}
    wanted = recipe("n-point", ups=ups, dwell={"until_std": 1e-4, "min_s": 0.05, "max_s": 500})
    T = adaptive_dwell.planned_dwells_s(wanted, WHITE)
    X = np.column_stack([np.ones(7), nominal_visits.truths(wanted)])

    def worst(dwell_s: Floats) -> Floats:
        return np.asarray(np.diag(np.linalg.inv(X.T * (dwell_s / WHITE) @ X)) / 1e-4**2)

    assert worst(T).max() == pytest.approx(1.0, abs=0.01)
    found = minimize(
        np.sum,
        np.full(7, T.mean() * 1.5),
        bounds=[(0.05, 500)] * 7,
        constraints={"type": "ineq", "fun": lambda x: 1 - worst(x)},
        method="SLSQP",
    )
    assert found.success
    assert T.sum() <= found.fun * 1.02


def test_a_stop_left_too_early_is_made_up_for() -> None:
    aim = adaptive_dwell.accuracy_target(recipe("n-point"))
    even = np.full((1, len(aim)), 1.0)
    usual = adaptive_dwell.plan_dwells(
        aim, DwellProgress(known(np.full((1, 3), WHITE)), 0 * even, _none(), np.ones(1)), even, ROUNDS
    )
    short = 0 * even
    short[0, 0] = usual.dwell_s[0, 0] / 3
    again = adaptive_dwell.plan_dwells(
        aim, DwellProgress(known(np.full((1, 3), WHITE)), short, _none(), np.ones(1)), even, ROUNDS
    )
    assert again.dwell_s[0, 0] == short[0, 0]
    assert again.dwell_s[0, 1:].sum() > usual.dwell_s[0, 1:].sum()
    assert (again.std / aim.std).max() == pytest.approx(1.0, abs=0.01)


def test_the_noisiest_unit_decides_axis_by_axis() -> None:
    quiet, loud = known(np.array([[1.0, 5.0, 1.0]])), known(np.array([[2.0, 1.0, 1.0]]))
    assert adaptive_dwell.worst_curve([quiet, loud]).by_count[0, :, 0] == pytest.approx(
        np.array([2.0, 5.0, 1.0]) * RATE
    )
    assert adaptive_dwell.worst_curve([quiet], loud).by_count[0, :, 0] == pytest.approx(
        np.array([3.0, 6.0, 2.0]) * RATE
    )


def test_noise_is_learnt_from_scatter_never_from_means(rng: np.random.Generator) -> None:
    x = rng.standard_normal((3, 64, 3))
    same, moved = (
        noise_curve([dwell_noise(part, 64) for part in np.split(x + shift, 2, axis=1)], 64) for shift in (0.0, 7.0)
    )
    assert moved.by_count == pytest.approx(same.by_count, rel=1e-9)


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_the_learnt_density_is_right_on_average(rng: np.random.Generator, phi: float) -> None:
    """400 units of 8 dwells: ± 4 standard errors and a few percent for the shapes averaged over."""
    e = rng.standard_normal((400, 8, 300, 3))
    x = e.copy()
    for i in range(1, 300):
        x[:, :, i] = phi * x[:, :, i - 1] + np.sqrt(1 - phi**2) * e[:, :, i]
    dwells = [dwell_noise(x[:, stop, 100:], family_length(200)) for stop in range(8)]
    at, dof = noise_curve(dwells, family_length(200)).at(np.full((400, 1), 200.0))
    exact = (1 + phi) / (1 - phi) - 2 * phi * (1 - phi**200) / (200 * (1 - phi) ** 2)
    assert np.median(at) == pytest.approx(exact, rel=0.1)
    assert np.log(at / exact).std() == pytest.approx(np.sqrt(2 / np.median(dof)), rel=0.5)


def test_a_disturbed_stop_counts_by_itself(rng: np.random.Generator) -> None:
    x = rng.standard_normal((1, 5, 100, 3))
    x[:, 2] *= 10
    found = noise_curve([dwell_noise(x[:, stop], 128) for stop in range(5)], 128)
    assert found.by_count[0, :, -1] == pytest.approx(np.ones(3), rel=0.6)
    assert found.variance_ratio[0, 2].min() > 30
    assert (np.delete(found.variance_ratio[0], 2, axis=0) == 1).all()


def _none() -> Any:
    return np.zeros(0, np.intp)


def go(pace: AdaptiveDwell, stop: int | None, reading: Floats) -> float:
    """One stop as a run asks for it, readings coming at the rate; how long it lasted, s."""
    ask_s = pace.first_s(stop)
    while True:
        lasted_s, printed = ask_s, {"SN1": reading[: round(ask_s * RATE)]}
        ask_s = pace.until_s(stop, lasted_s, partial(dict, printed))
        if ask_s <= lasted_s:
            pace.ended(stop, lasted_s, partial(dict, printed))
            return lasted_s


def test_a_run_dwells_about_as_long_as_known_noise_would_need(rng: np.random.Generator) -> None:
    pace = AdaptiveDwell(recipe("n-point"))
    noise = DENSITY * np.sqrt(RATE / 2) * rng.standard_normal((len(pace.aim), 2000, 3))
    lasted_s = [go(pace, stop, noise[stop]) for stop in range(len(pace.aim))]
    bound_s = adaptive_dwell.planned_dwells_s(recipe("n-point"), WHITE).sum()
    assert 0.85 < sum(lasted_s) / bound_s < 1.45
    assert pace.document("SN1")["dwell_s"] == lasted_s
    assert go(pace, None, noise[0]) == pytest.approx(np.mean(lasted_s))


def test_a_run_that_knows_the_kind_dwells_as_known_noise_would_need(rng: np.random.Generator) -> None:
    """benchmarks/dwell.py: 1.06 of the bound after 50 units, 5 to 95 % of units 0.99 to 1.13; four such deviations."""
    wanted, root = recipe("n-point"), DENSITY * np.sqrt(RATE / 2)
    longest, stops = adaptive_dwell.prior_length(wanted), len(adaptive_dwell.accuracy_target(wanted))
    earlier = likelihoods(
        [dwell_noise(root * rng.standard_normal((50, 40, 3)), longest) for _ in range(stops)], longest
    )
    pace = AdaptiveDwell(wanted, earlier)
    for stop in range(stops):
        go(pace, stop, root * rng.standard_normal((2000, 3)))
    shown: Mapping[str, Any] = pace.document("SN1")
    prior = learn_prior(earlier, longest)
    assert prior is not None
    assert shown["prior"] == noise_document.of_prior(prior)
    assert 0.90 < sum(shown["dwell_s"]) / adaptive_dwell.planned_dwells_s(wanted, WHITE).sum() < 1.23
    (again,) = noise_document.all_likelihoods([shown])
    assert again.dof == sum(round(s * RATE) - 1 for s in shown["dwell_s"])


def test_noise_ten_times_the_sheets_is_dwelt_for_up_to_the_longest(rng: np.random.Generator) -> None:
    pace = AdaptiveDwell(recipe(dwell={"until_std": 5e-5, "min_s": 0.2, "max_s": 3.0}))
    assert 2.99 / NEAR < go(pace, 0, 10 * DENSITY * np.sqrt(RATE / 2) * rng.standard_normal((2000, 3))) <= 3.0


def test_a_stop_measured_again_counts_as_it_was_the_last_time(rng: np.random.Generator) -> None:
    pace, noise = AdaptiveDwell(recipe()), DENSITY * np.sqrt(RATE / 2) * rng.standard_normal((2, 2000, 3))
    go(pace, 0, 20 * noise[0])
    lasted_s = go(pace, 0, noise[1])
    assert lasted_s < 3.0
    assert pace.document("SN1")["dwell_s"] == [lasted_s, 0, 0, 0, 0, 0]


def test_a_unit_that_says_nothing_holds_nobody_up() -> None:
    assert go(AdaptiveDwell(recipe()), 0, np.zeros((0, 3))) == 0.2


def test_a_fixed_dwell_decodes_nothing() -> None:
    pace = control_for(recipe(dwell={"time_s": 0.7}), lambda: pytest.fail("asked for"))
    assert isinstance(pace, FixedDwell)
    assert pace.first_s(0) == pace.until_s(0, 0.7, lambda: pytest.fail("decoded")) == 0.7
    assert pace.document("SN1") == {}


SHIPPED = sorted(path.stem for path in (shipped_folder() / "recipes").glob("*.yaml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_recipe_can_be_planned(name: str) -> None:
    """Within its limits, to the wanted uncertainty or as near as the longest dwells come."""
    whole = load_recipe(name)
    strongest = max((float(np.linalg.norm(v)) for v in nominal_visits.truths(whole)), default=1.0) or 1.0
    dwell = DwellRule(until_std=2e-5 * strongest, min_s=0.2, max_s=5)
    requested = whole.model_copy(update={"dwell": dwell})
    aim = adaptive_dwell.accuracy_target(requested)
    density = (1e-4 * strongest) ** 2 / 2
    T = adaptive_dwell.initial_dwells_s(aim, density)
    assert T.shape == (len(aim),)
    assert ((T >= 0.2 - 1e-12) & (T <= 5 + 1e-12)).all()
    shown = adaptive_dwell.plan_dwells(
        aim, DwellProgress(known(np.full((1, 3), density)), T[None], _none(), np.ones(1)), T[None]
    )
    most = adaptive_dwell.plan_dwells(
        aim, DwellProgress(known(np.full((1, 3), density)), np.full((1, len(aim)), 5.0), _none(), np.ones(1)), T[None]
    )
    wanted = np.maximum(aim.std, np.sqrt(NEAR) * most.std[0])
    assert (shown.std[0][np.isfinite(aim.std)] <= 1.02 * wanted[np.isfinite(aim.std)]).all()
