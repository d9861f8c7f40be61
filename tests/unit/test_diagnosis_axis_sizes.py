"""Axes that scatter and wander by their own sizes: the sizes come back, and a healthy one of them alarms nobody."""

from dataclasses import replace

import numpy as np
import pytest

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear import axis_sizes, noise_floor
from station.diagnosis.linear.axis_sizes import AxisSizes, of_axes, own_sizes
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.linear.projection import residual_space
from station.diagnosis.search.alarm import NullDistribution, bootstrap
from station.diagnosis.search.axes_apart import search_in_floor
from station.diagnosis.search.problem import FloorAllowance, initial_problem, sharing_scatter
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe, six_faces
from tests.unit.test_diagnosis_floor import drawn, offsets, structure

UPPER = np.array([np.inf, 0.0, 1.0])


def fitted_to(noise: list[float], walk: list[float], seed: int) -> tuple[AxisSizes | None, FittedFloor]:
    """Own sizes found in readings of a floor that has them, and the floor common to all axes."""
    rng = np.random.default_rng(seed)
    grid, made, _ = structure(rng)
    true = of_axes(made, np.array(noise), np.array(walk))
    rows, known = drawn(grid, true, np.array([1.0, 0.0, 0.05]), rng), offsets(grid)
    fitted = noise_floor.fit(made, known, rows, grid.data, UPPER)
    return own_sizes(fitted, known, (rows, grid.data), UPPER, 4.0), fitted


def test_the_sizes_of_each_axis_come_back() -> None:
    found, fitted = fitted_to([0.5, 0.5, 2.0], [1.0, 0.1, 0.1], 3)
    assert found is not None
    assert found.gain > 20
    white = found.structure.white.reshape(-1, 3)[0] / fitted.parts.white.reshape(-1, 3)[0]
    # Of 276 numbers of an axis a variance is known to a twelfth.
    assert white == pytest.approx([0.5, 0.5, 2.0], rel=0.35)
    walk = (found.structure.walk / np.where(fitted.parts.walk == 0, np.nan, fitted.parts.walk)) ** 2
    assert np.nanmax(walk, axis=(0, 1, 2, 3))[0] == 1.0
    assert np.all(np.nanmax(walk, axis=(0, 1, 2, 3))[1:] < 0.6)


def test_axes_of_one_size_have_none_of_their_own() -> None:
    found = [fitted_to([1.0, 1.0, 1.0], [1.0, 1.0, 1.0], seed)[0] for seed in range(6)]
    # Four numbers more gain two nats on the average, more than six of them once in sixty.
    assert sum(x is not None and x.gain > 6.5 for x in found) <= 1


def test_the_root_of_each_factor_leads_up_and_to_one_at_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(axis_sizes, "COMMON_VISITS", 0.0)
    rng = np.random.default_rng(8)
    grid, made, _ = structure(rng)
    rows, known, at = drawn(grid, made, np.array([1.0, 0.3, 0.1]), rng), offsets(grid), np.ones(7)
    logliks, factor = list[float](), np.zeros(7)
    for _ in range(30):
        shaped, variances = axis_sizes._shaped(made, at)
        space = residual_space(shaped.covariance(variances), known, rows, grid.data)
        factor = axis_sizes._factor(shaped, space, at, at)
        logliks.append(space.loglik)
        at = at * np.sqrt(factor)
    assert np.all(np.diff(logliks) > -1e-9)
    assert factor == pytest.approx(1.0, abs=0.1)


def test_lengths_have_no_axes() -> None:
    rng = np.random.default_rng(4)
    grid, made, _ = structure(rng)
    rows, known = drawn(grid, made, np.array([1.0, 0.0, 0.0]), rng), offsets(grid)
    fitted = noise_floor.fit(made, known, rows, grid.data, UPPER)
    lengths = replace(made, walk=made.walk[..., :1, :])
    assert own_sizes(replace(fitted, parts=lengths), known, (rows, grid.data), UPPER, 0.0) is None


def test_an_axis_that_scatters_further_than_the_others_alarms_nobody() -> None:
    """Beside samples that are equally noisy one axis is off by another .4 mg at each stop, the others by .06."""
    faces, rng = six_faces("listed"), np.random.default_rng(4)
    made, _ = hide(faces, None, 4, units=5)
    stop = np.cumsum(np.diff(made.visit, prepend=-1) != 0) - 1
    off = rng.standard_normal((stop[-1] + 1, 3)) * [6e-5, 6e-5, 4e-4]
    reduced = reduce_samples(faces, replace(made, reading=made.reading + off[stop]))
    problem = initial_problem(reduced, FloorAllowance.of(faces, Model()))
    # Own sizes are looked for only where something alarms.
    first = search_in_floor(problem, null_of).first
    noise = np.array(first.problem.structure.sizes[:3])
    assert noise[2] > 4 * noise[:2].max()
    assert not first.alarms


def test_what_swings_on_one_axis_alone_is_no_scatter_of_that_axis() -> None:
    """One axis swings and comes to rest again: it goes as far as a floor of which each axis has its own sizes, but
    follows the time."""
    tilts = recipe(1)
    made, _ = hide(tilts, None, 4, units=1, floor=WHITE)
    share = made.time_s / made.time_s.max()
    swings = 5e-4 * np.sin(2 * np.pi * 2.3 * share + 1.0) * np.exp(-0.5 * ((share - 0.5) / 0.2) ** 2)
    reading = made.reading + swings[:, None] * np.eye(3)[0]
    problem = initial_problem(reduce_samples(tilts, replace(made, reading=reading)), FloorAllowance.of(tilts, Model()))
    found = search_in_floor(problem, usual_tails).first
    assert found.alarms
    assert max(found.evidence, key=lambda name: found.evidence[name]) == "time"


def usual_tails(_: ScoringProblem, __: FittedFloor, around: WalkMarginal) -> NullDistribution:
    """As if each log evidence fell off beyond nothing as one does."""
    names = {c.name for c in around.candidates}
    return NullDistribution(
        {n: np.linspace(-2.0, 0.0, 33) for n in names}, dict.fromkeys(names, 0.0), dict.fromkeys(names, 1.0), 4.0
    )


def null_of(problem: ScoringProblem, fitted: FittedFloor, now: WalkMarginal) -> NullDistribution:
    """A coarse null distribution."""
    return bootstrap(problem, fitted, now, 1, 128)


def test_axes_that_move_together_alarm_nobody_and_share_it_in_the_floor() -> None:
    """Beside samples that share nothing all axes of a unit are off by much the same at each stop."""
    faces, rng = six_faces("listed"), np.random.default_rng(6)
    made, _ = hide(faces, None, 6, units=5)
    stop = np.cumsum(np.diff(made.visit, prepend=-1) != 0) - 1
    off = 4e-4 * rng.standard_normal((stop[-1] + 1, 1)) + 6e-5 * rng.standard_normal((stop[-1] + 1, 3))
    reduced = reduce_samples(faces, replace(made, reading=made.reading + off[stop]))
    problem = initial_problem(reduced, FloorAllowance.of(faces, Model()))
    found = sharing_scatter(problem)
    assert found is not None
    shared, gain = found
    assert gain > 10
    correlation = shared.view.reduced.visit_correlation
    assert correlation is not None
    assert correlation[np.triu_indices(3, 1)].min() > 0.7
    # What the contrasts within the dwells share is left as the samples have it.
    assert shared.view.layout.apart is None
    assert not search_in_floor(problem, null_of).first.alarms


def test_axes_that_share_nothing_are_given_nothing() -> None:
    made, _ = hide(six_faces("listed"), None, 7, units=5)
    problem = initial_problem(reduce_samples(six_faces("listed"), made), FloorAllowance())
    found = sharing_scatter(problem)
    # Three numbers more gain 1.5 nats on the average, more than 6 once in 130.
    assert found is None or found[1] < 6.0
