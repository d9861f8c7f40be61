"""What every calibration method keeps to, for every kind of sensor; a new file in the folder is tested untold."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from station import plugins
from station.domain.core.types import Floats, SampleTable
from station.domain.evaluation import pipeline
from station.domain.methods import method, scatter
from station.domain.planning import design
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError, StationError
from tests.fakes import tumble
from tests.fakes.tumble import TODAY, coefficients

METHODS = plugins.names(method.PACKAGE)
SENSORS = tuple(tumble.TRUTHS)
#: Truth of a method that keeps some coefficients nominal: a unit that has them nominal.
STORED = {"one-point": np.eye(3), "three-point": None}


def size(sensor: str) -> float:
    """Length of the stimulus, in the sensor's unit."""
    return float(np.linalg.norm(tumble.truths(tumble.recipe("six-point", sensor)), axis=1).max())


def suited(name: str, theta: Floats) -> Floats:
    """Units whose coefficients the method leaves alone are nominal."""
    theta = theta.copy()
    if name == "one-point":
        theta[:, 3:] = np.eye(3).ravel()
    if name == "three-point":
        theta[:, [4, 5, 6, 8, 9, 10]] = 0.0
    return theta


def calibrated(recipe: Recipe, table: SampleTable) -> list[Any]:
    found = list(pipeline.calibrate(recipe, table, TODAY))
    assert all(r.calibration is not None for r in found)
    return found


def bench(name: str, sensor: str) -> Recipe:
    """A recipe for the method; of a magnetometer in an askew field the faces are not faces, so it stands upright."""
    more: dict[str, Any] = {}
    if sensor == "magnetometer":
        more = {"reference": {"source": "field", "vector": [0.0, 0.0, 48.0], **tumble.EXACT, "field_std_deg": 0}}
    reference = more.get("reference", tumble.TRUTHS[sensor]["reference"])
    # What the methods leave alone is nominal here, and poses are exact.
    few = {"pose_std_deg": 0} if name in ("one-point", "three-point") else {}
    nominal = {"gain_std": 0, "cross_std": 0, "g_sensitivity": 0}
    more |= {"reference": reference | few, "device": nominal | {"rounding": "nearest"}}
    return tumble.recipe(name, sensor, **more)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("name", METHODS)
def test_it_is_unbiased_and_its_covariance_covers(name: str, sensor: str, rng: np.random.Generator) -> None:
    recipe, m, count = bench(name, sensor), size(sensor), 240
    theta = suited(name, tumble.units(rng, count, m))
    mean = tumble.readings(theta, tumble.truths(recipe))
    found = calibrated(recipe, tumble.table(recipe, mean, 0.001 * m, 60, rng))
    error = np.array([coefficients(r) for r in found]) - theta
    std = np.array([r.budget.std() for r in found])
    wide = np.array([r.budget.expanded() for r in found])
    free = std[0] > 0
    assert (error[:, ~free] == 0).all()
    z = error[:, free] / std[:, free]
    # Means of `count` standard normal numbers: four standard errors.
    assert np.abs(z.mean(axis=0)).max() < 4 / np.sqrt(count)
    # U holds, beside noise, the scatter that so few residuals leave possible: it may cover more, not much more.
    share = (np.abs(error) < wide)[:, free].mean()
    assert 0.95 - 4 * np.sqrt(0.0475 / (count * free.sum() / 3)) - 0.01 < share < 0.99


@pytest.mark.parametrize("name", METHODS)
def test_its_derivative_is_that_of_its_answer(name: str, rng: np.random.Generator) -> None:
    recipe = bench(name, "accelerometer")
    problem = problem_of(recipe, rng)
    kind = method.of(recipe)
    jacobian = kind.fit(problem).jacobian[0]
    step, v = 1e-6, problem.mean.shape[1]
    for at in ((0, 0), (v - 1, 1), (v // 2, 2)):
        moved = [kind.fit(nudged(problem, at, s * step)).theta[0] for s in (1, -1)]
        assert (moved[0] - moved[1]) / (2 * step) == pytest.approx(jacobian[:, at[0], at[1]], abs=2e-3)


def problem_of(recipe: Recipe, rng: np.random.Generator) -> method.FitProblem:
    theta = tumble.units(rng, 1)
    table = tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), 1e-4, 40, rng)
    (result,) = calibrated(recipe, table)
    return method.fit_problem(recipe, [result.visits])


def nudged(problem: method.FitProblem, at: tuple[int, int], step: float) -> method.FitProblem:
    from dataclasses import replace

    mean = problem.mean.copy()
    mean[0, at[0], at[1]] += step
    return replace(problem, mean=mean)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("name", METHODS)
def test_permuting_visits_changes_nothing(name: str, sensor: str, rng: np.random.Generator) -> None:
    recipe, m = bench(name, sensor), size(sensor)
    theta = tumble.units(rng, 1, m)
    table = tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), 0.001 * m, 30, rng)
    visits = np.unique(table.visit)
    order = rng.permutation(len(visits))
    rows = np.concatenate([np.flatnonzero(table.visit == v) for v in order])
    moved = table[rows]
    renumbered = SampleTable(
        unit=moved.unit,
        run=moved.run,
        visit=np.repeat(np.arange(len(order), dtype=np.int32), 30),
        position=moved.position,
        time_s=table.time_s,
        reading=moved.reading,
        labels=moved.labels,
    )
    (one,), (other,) = calibrated(recipe, table), calibrated(recipe, renumbered)
    assert coefficients(other) == pytest.approx(coefficients(one), rel=1e-9, abs=1e-9 * m)
    assert other.calibration.covariance == pytest.approx(one.calibration.covariance, rel=1e-6, abs=1e-18 * m * m)


@pytest.mark.parametrize("name", [n for n in METHODS if n in ("n-point", "norm", "six-point")])
@given(turn=st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: float(np.linalg.norm(q)) > 0.1))
@settings(max_examples=15, deadline=None)
def test_turning_all_positions_turns_the_answer(name: str, turn: tuple[float, ...]) -> None:
    """The same readings with truths turned by R: the matrix is turned by R from the right, the offset stays."""
    rng = np.random.default_rng(5)
    recipe = bench(name, "accelerometer")
    problem = problem_of(recipe, rng)
    from dataclasses import replace

    R = Rotation.from_quat(turn).as_matrix()
    kind = method.of(recipe)
    one = kind.fit(problem)
    other = kind.fit(replace(problem, true=problem.true @ R.T))
    assert other.theta[:, :3] == pytest.approx(one.theta[:, :3], abs=1e-9)
    assert other.theta[:, 3:].reshape(-1, 3, 3) @ R == pytest.approx(one.theta[:, 3:].reshape(-1, 3, 3), abs=1e-9)


@pytest.mark.parametrize("name", METHODS)
@given(factor=st.floats(0.01, 1000))
@settings(max_examples=10, deadline=None)
def test_units_cancel(name: str, factor: float) -> None:
    """Readings and stimulus in another unit: offsets scale with it, ratios do not."""
    from dataclasses import replace

    recipe = bench(name, "accelerometer")
    problem = problem_of(recipe, np.random.default_rng(5))
    scaled = replace(
        problem,
        mean=problem.mean * factor,
        cov=problem.cov * factor**2,
        quantisation=problem.quantisation * factor**2,
        rounding=problem.rounding * factor**2,
        true=problem.true * factor,
        magnitude=problem.magnitude * factor,
    )
    kind = method.of(recipe)
    one, other = kind.fit(problem), kind.fit(scaled)
    if name == "one-point":
        assert other.theta[:, :3] / factor == pytest.approx(one.theta[:, :3], abs=1e-9)
        return
    assert other.theta[:, :3] / factor == pytest.approx(one.theta[:, :3], abs=1e-8)
    assert other.theta[:, 3:] == pytest.approx(one.theta[:, 3:], abs=1e-8)


@pytest.mark.parametrize("name", METHODS)
def test_one_unit_alone_gives_the_same_bits_as_many(name: str, rng: np.random.Generator) -> None:
    recipe = bench(name, "accelerometer")
    theta = tumble.units(rng, 6)
    mean = tumble.readings(theta, tumble.truths(recipe))
    mean[2, 0] += 0.05  # one unit that needs the slow path
    table = tumble.table(recipe, mean, 0.001, 40, rng)
    together = calibrated(recipe, table)
    for i, one in enumerate(together):
        (alone,) = calibrated(recipe, table[table.unit.code == i])
        assert np.array_equal(coefficients(alone), coefficients(one))
        assert np.array_equal(alone.calibration.covariance, one.calibration.covariance)
        assert alone.verdict == one.verdict


@pytest.mark.parametrize("name", METHODS)
def test_what_cannot_be_determined_is_refused_before_anything_moves(name: str) -> None:
    """Two opposite positions, however often repeated, determine no method but the one-point offset."""
    ups = {f"p{i}": [0, 0, 1 if i % 2 else -1] for i in range(6)}
    if name == "one-point":
        with pytest.raises(RecipeError, match="one position"):
            design.check(tumble.recipe(name, ups=ups))
        return
    with pytest.raises(RecipeError):
        design.check(tumble.recipe(name, ups=ups))


@pytest.mark.parametrize("name", METHODS)
def test_its_own_recipe_is_accepted_and_forecast(name: str, rng: np.random.Generator) -> None:
    """What a recipe is forecast to know is what it comes to know."""
    from station.domain.planning.forecast import forecast

    sheet = {"rate_hz": 100, "noise_density": 2e-4, "offset_tempco": 0, "gain_tempco": 0}
    recipe = tumble.recipe(name, device=sheet)
    design.check(recipe)
    expected = forecast(recipe, pipeline.NO_ROUNDING).budget.std()
    theta = suited(name, tumble.units(rng, 30))
    noise = 2e-4 * np.sqrt(50)
    found = calibrated(recipe, tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), noise, 100, rng))
    std = np.median([r.budget.std() for r in found], axis=0)
    # One stop alone knows its noise less well than many, and is widened for it.
    assert std == pytest.approx(expected, rel=0.25 if name == "one-point" else 0.12)


@pytest.mark.parametrize("name", METHODS)
def test_a_fit_never_ends_in_a_traceback(name: str, rng: np.random.Generator) -> None:
    """Garbage readings: a verdict or a sentence, whatever they are."""
    recipe = bench(name, "accelerometer")
    v = len(tumble.truths(recipe))
    for mean in (np.zeros((1, v, 3)), 1e6 * rng.standard_normal((1, v, 3)), np.full((1, v, 3), 0.7)):
        table = tumble.table(recipe, mean, 0.0, 5, rng)
        try:
            (result,) = pipeline.calibrate(recipe, table, TODAY)
        except StationError as error:
            assert error.sentence
        else:
            assert result.verdict.outcome in ("FAIL", "ERROR")
            assert result.verdict.reasons


def test_scatter_is_a_fixed_point(rng: np.random.Generator) -> None:
    """With the scatter taken up, χ² is its degrees of freedom."""
    recipe = bench("n-point", "accelerometer")
    theta = tumble.units(rng, 5)
    mean = tumble.readings(theta, tumble.truths(recipe)) + 0.004 * rng.standard_normal((5, 18, 3))
    stops = [r.visits for r in calibrated(recipe, tumble.table(recipe, mean, 1e-4, 40, rng))]
    (part,) = scatter.solve(method.of(recipe), method.fit_problem(recipe, stops))
    lack = scatter.lack_of_fit(part.problem, part.fit)
    chi2 = (lack.between / (lack.of_between + part.problem.scatter_pose[:, None])).sum(axis=1)
    assert chi2 == pytest.approx(lack.dof_between, rel=0.02)
    assert np.sqrt(part.problem.scatter_pose) == pytest.approx(np.full(5, 0.004), rel=0.4)
