"""What every kind of sensor keeps to; a new file in the folder is tested without being told."""

from typing import Any

import numpy as np
import pytest

from station import plugins
from station.domain.methods import contributions, method
from station.domain.recipe import assumptions, readings, references, sensor
from station.domain.recipe.blocks import DeviceSheet
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

KINDS = plugins.names(sensor.PACKAGE)
#: Kinds that read the components of their stimulus, and those that make something else of it, such as angles.
DIRECT = tuple(kind for kind in KINDS if readings.converting_kind(kind) is None)
CONVERTING = tuple(kind for kind in KINDS if kind not in DIRECT)


def bench(kind: str, **reference: Any) -> Recipe:
    """Twelve positions and six faces, with the stimulus the kind is used to."""
    own = {**tumble.TRUTHS[kind]["reference"], **reference}
    return tumble.recipe("n-point", kind, reference=own)


def stops(recipe: Recipe) -> tuple[tuple[str, ...], tuple[str, ...], Any]:
    names = tuple(p.name for p in recipe.positions)
    return names, ("home",) * len(names), tumble.truths(recipe)


@pytest.mark.parametrize("kind", KINDS)
def test_it_says_what_it_is(kind: str) -> None:
    found: Any = plugins.load(sensor.PACKAGE, kind)
    assert found.unit and found.quantity
    assert found.sources


@pytest.mark.parametrize("kind", DIRECT)
def test_a_recipe_in_another_unit_or_with_another_stimulus_is_refused(kind: str) -> None:
    own: Any = plugins.load(sensor.PACKAGE, kind)
    other = next(plugins.load(sensor.PACKAGE, k) for k in KINDS if k != kind)
    with pytest.raises(ValueError, match=f"unit .* does not go with sensor {kind}"):
        tumble.recipe("n-point", kind, unit=getattr(other, "unit"))  # noqa: B009
    wrong = next(s for s in ("gravity", "rate") if s not in own.sources)
    with pytest.raises(ValueError, match="does not excite"):
        tumble.recipe("n-point", kind, reference={"source": wrong})


@pytest.mark.parametrize("kind", DIRECT)
def test_its_errors_of_the_truth_are_patterns_over_the_stops(kind: str) -> None:
    recipe = bench(kind, magnitude_std=0.01)
    names, seats, true = stops(recipe)
    found = references.truth_errors(recipe, names, seats, true)
    assert found
    for patterns in found.values():
        assert patterns.ndim == 3
        assert patterns.shape[1:] == true.shape
        assert np.isfinite(patterns).all()


@pytest.mark.parametrize("kind", DIRECT)
def test_an_uncertain_magnitude_is_the_same_share_of_every_gain(kind: str, rng: np.random.Generator) -> None:
    """A stimulus wrong by 1 % makes every gain wrong by 1 %, and no offset."""
    plain, unsure = bench(kind), bench(kind)
    largest = float(np.linalg.norm(tumble.truths(plain), axis=1).max())
    unsure = bench(kind, magnitude_std=0.01 * largest)
    theta = tumble.units(rng, 1, largest)
    table = tumble.table(unsure, tumble.readings(theta, tumble.truths(unsure)), 1e-4 * largest, 40, rng)
    found = tumble.calibrate_unit(unsure, table, tumble.TODAY)
    assert found.budget is not None
    own = plugins.load(sensor.PACKAGE, kind)
    (name,) = [n for n in ("gravity", "field", "rate") if n in found.budget.parts]
    part = found.budget.std(name)
    assert found.calibration is not None
    assert getattr(own, "quantity")  # noqa: B009
    assert np.diagonal(part[3:].reshape(3, 3)) == pytest.approx(0.01 * np.diagonal(found.calibration.matrix), rel=1e-6)
    assert np.abs(part[:3]).max() < 1e-12 * largest


@pytest.mark.parametrize("kind", DIRECT)
def test_a_gold_reference_brings_its_own_uncertainty(kind: str, rng: np.random.Generator) -> None:
    size = float(np.linalg.norm(tumble.truths(bench(kind)), axis=1).max())
    gold = {"serial": "G1", "due": "2030-01-01", "offset_std": 0.002 * size, "gain_std": 0.001, "seat_std_deg": 0.05}
    recipe = tumble.recipe("n-point", kind)
    true = tumble.truths(recipe)
    recipe = tumble.recipe(
        "n-point",
        kind,
        reference={"source": "gold", "gold": gold, "magnitude": size},
        positions=[{"name": p.name, "up": "+z"} for p in recipe.positions],
    )
    names, seats, _ = stops(recipe)
    patterns = references.truth_errors(recipe, names, seats, true)["gold reference"]
    problem = _problem(recipe, true, rng, size)
    fit = method.of(recipe).fit(problem)
    part = contributions.patterns(fit, patterns)[0]
    std = np.sqrt(np.diagonal(part))
    assert std[:3] == pytest.approx(np.full(3, 0.002 * size), rel=1e-6)
    matrix = std[3:].reshape(3, 3)
    assert np.diagonal(matrix) == pytest.approx(np.full(3, 0.001), rel=1e-6)
    assert matrix[0, 1] == pytest.approx(np.deg2rad(0.05), rel=1e-6)


def sheets(kind: str) -> list[DeviceSheet]:
    """A data sheet for each number of axes and each definition that a converting kind knows."""
    own: Any = readings.converting_kind(kind)
    return [DeviceSheet(axes=n, convention=c) for n in own.axes for c in own.conventions]


@pytest.mark.parametrize("kind", CONVERTING)
def test_a_converted_reading_is_finite_and_nothing_where_there_is_no_axis(kind: str, rng: np.random.Generator) -> None:
    felt = rng.standard_normal((50, 3))
    for sheet in sheets(kind):
        found = readings.perfect(kind, sheet, felt)
        assert np.isfinite(found).all()
        assert not found[:, readings.axis_count(kind, sheet) :].any()
        assert found[:, 0].any()


@pytest.mark.parametrize("kind", CONVERTING)
def test_small_changes_of_what_is_felt_change_the_reading_to_first_order(kind: str, rng: np.random.Generator) -> None:
    """Against the difference itself; the second order of 1e-4 is below 1e-3 of it away from the poles."""
    felt = np.array([[0.3, 0.2, 0.9], [-0.2, 0.4, 0.8]])
    small = 1e-4 * rng.standard_normal((3, 2, 3))
    for sheet in sheets(kind):
        by_derivative = readings.reading_changes(kind, sheet, felt, small)
        itself = readings.perfect(kind, sheet, felt + small) - readings.perfect(kind, sheet, felt)
        np.testing.assert_allclose(by_derivative, itself, rtol=2e-3, atol=1e-5)


@pytest.mark.parametrize("kind", CONVERTING)
def test_a_method_that_cannot_calibrate_it_is_refused(kind: str) -> None:
    own: Any = readings.converting_kind(kind)
    wrong = next(m for m in plugins.names("station.domain.methods.calibrate") if m not in own.methods)
    base = {"schema": "station.recipe/1", "name": "r", "version": 1, "sensor": kind, "unit": own.unit}
    more = {"reference": {"source": own.sources[0]}, "positions": [{"name": "a", "up": "+z"}]}
    with pytest.raises(ValueError, match=f"method {wrong} does not go with sensor {kind}"):
        Recipe.model_validate({**base, **more, "method": wrong})


def _problem(recipe: Recipe, true: Any, rng: np.random.Generator, size: float) -> method.FitProblem:
    v = len(true)
    ideal = np.tile([0.0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1], (1, 1))
    return method.FitProblem(
        mean=tumble.readings(ideal, true),
        cov=np.tile(1e-8 * size**2 * np.eye(3), (1, v, 1, 1)),
        quantisation=np.zeros((1, v, 3)),
        rounding=np.zeros((1, v, 3)),
        dof=np.full((1, v, 3), 1e6),
        temperature_degC=np.full((1, v), np.nan),
        true=true[None],
        magnitude=np.linalg.norm(true, axis=1)[None],
        pose=np.arange(v),
        pose_std_rad=0.0,
        scatter_pose=np.zeros(1),
        scatter_visit=np.zeros(1),
        patterns=np.zeros((0, v, 3)),
        nuisance=np.zeros((v, 0)),
        model="matrix",
        pose_known=True,
    )


def test_a_gyroscope_without_a_site_does_not_know_the_earths_turning() -> None:
    """Without a site all of it is unknown; with one, the level part; with a heading, nothing."""
    rest = [{"name": "rest", "rate": [0, 0, 0]}]

    def unknown(**site: float) -> float:
        reference: dict[str, Any] = {"source": "rate"} | ({"site": site} if site else {})
        recipe = tumble.recipe("one-point", "gyroscope", positions=rest, reference=reference)
        patterns = references.truth_errors(recipe, ("rest",), ("home",), np.zeros((1, 3)))["Earth rate"]
        return float(np.sqrt((patterns**2).sum()))

    assert unknown() == pytest.approx(0.00417807, rel=1e-5)
    assert unknown(latitude_deg=60.0) == pytest.approx(0.00417807 * 0.5, rel=1e-5)
    assert unknown(latitude_deg=60.0, heading_deg=10.0) == 0


def test_g_sensitivity_of_a_gyroscope_stands_in_the_budget_where_it_cannot_be_fitted(rng: np.random.Generator) -> None:
    """One position: 0.02 deg/s/g on each axis go straight into the offsets."""
    sheet = {"g_sensitivity": 0.02}
    recipe = tumble.recipe("one-point", "gyroscope", positions=[{"name": "rest", "rate": [0, 0, 0]}], device=sheet)
    table = tumble.table(recipe, np.zeros((1, 1, 3)), 0.01, 50, rng)
    found = tumble.calibrate_unit(recipe, table, tumble.TODAY)
    assert found.budget is not None
    assert found.budget.std("g-sensitivity")[:3] == pytest.approx([0.02] * 3)


def test_a_stated_g_sensitivity_is_no_scatter_as_well(rng: np.random.Generator) -> None:
    """Six spins about upright axes: gravity pulls differently at each, which leaves residuals and moves no gain."""
    spins = [
        {"name": f"{axis}{sign}", "up": f"+{axis}", "rate": (100 * sign * np.eye(3)["xyz".index(axis)]).tolist()}
        for axis in "xyz"
        for sign in (1, -1)
    ]
    reference = {"source": "rate", "magnitude_std": 0.01, "nest_std_deg": 0.1}
    more: dict[str, Any] = {"positions": spins, "reference": reference}
    recipe = tumble.recipe("six-point", "gyroscope", device={"g_sensitivity": 0.02}, **more)
    pull = 0.02 * np.repeat(rng.standard_normal((3, 3)), 2, axis=0)
    found = tumble.calibrate_unit(
        recipe, tumble.table(recipe, (tumble.truths(recipe) + pull)[None], 0.01, 50, rng), tumble.TODAY
    )
    assert found.budget is not None
    assert found.budget.std("g-sensitivity")[:3] == pytest.approx([0.02 / np.sqrt(3)] * 3, rel=1e-3)
    assert found.budget.std()[[3, 7, 11]] == pytest.approx([1e-4] * 3, rel=0.2), "the table's speed alone"


def test_gravity_goes_round_a_level_spindle_and_leaves_nothing_in_the_mean(rng: np.random.Generator) -> None:
    """About a level axis only what lies along it stays, so that spins and rests give the coefficients without an error
    of the g-sensitivity; its budget holds none either."""
    level = dict(zip("xyz", ("+z", "+x", "+y"), strict=True))
    spins = [
        {"name": f"{a}{sign}", "up": level[a], "rate": (100 * sign * np.eye(3)["xyz".index(a)]).tolist()}
        for a in "xyz"
        for sign in (1, -1)
    ]
    rests = [{"name": f"rest{up}", "up": up, "rate": [0, 0, 0]} for up in ("+x", "-x", "+y", "-y", "+z", "-z")]
    more: dict[str, Any] = {"positions": [*spins, *rests], "reference": tumble.TRUTHS["gyroscope"]["reference"]}
    recipe = tumble.recipe("n-point", "gyroscope", **more)
    names, seats, true = stops(recipe)
    felt = method.nuisance(recipe, names, seats, true)
    assert np.abs(felt[:6]).max() < 1e-12
    pull = 0.1 * rng.standard_normal((3, 3))
    gravity = np.array([recipe.position(p).matrix()[2] for p in names]) * (np.arange(12) >= 6)[:, None]
    result = tumble.calibrate_unit(
        recipe, tumble.table(recipe, (true + gravity @ pull.T)[None], 1e-4, 50, rng), tumble.TODAY
    )
    np.testing.assert_allclose(tumble.coefficients(result), [*[0] * 3, *np.eye(3).ravel()], atol=1e-3)
    assert result.budget is not None and result.budget.std("g-sensitivity").max() < 1e-9


def test_a_table_that_stands_still_has_no_wrong_speed() -> None:
    """What is stated is its fastest speed's; the Earth's turning is known."""
    speeds = {"rest": 0.0, "slow": 10.0, "fast": 100.0}
    places = [{"name": name, "rate": [0, 0, speed]} for name, speed in speeds.items()]
    site = {"latitude_deg": 48.0, "altitude_m": 0.0, "heading_deg": 0.0}
    reference = {"source": "rate", "site": site, "magnitude_std": 0.01}
    recipe = tumble.recipe("n-point", "gyroscope", positions=places, reference=reference)

    def wrong(*names: str) -> list[float]:
        seats = ("home",) * len(names)
        felt = references.true_vectors(recipe, names, seats)
        return [
            float(v) for v in np.linalg.norm(references.truth_errors(recipe, names, seats, felt)["rate"][0], axis=1)
        ]

    assert wrong("rest", "slow", "fast") == pytest.approx([0.0, 0.001, 0.01])
    assert wrong("slow") == pytest.approx([0.001]), "of one position as of all"


def test_what_gravity_and_temperature_do_is_listed_as_assumed_unless_stated(rng: np.random.Generator) -> None:
    """A gyroscope of which nobody states it is taken to show 0.1 deg/s for 1 g; temperature coefficients of
    usual data sheets are said to be an assumption. Stated zeros are not."""
    keys = {"device.g_sensitivity", "device.offset_tempco", "device.gain_tempco"}
    rest = [{"name": "rest", "rate": [0, 0, 0]}]

    def listed(sensor: str, sheet: dict[str, float]) -> dict[str, bool]:
        turning: dict[str, Any] = {"positions": rest} if sensor == "gyroscope" else {}
        recipe = tumble.recipe("one-point", sensor, device=sheet, **turning)
        return {a.key: a.stated for a in assumptions.listing(recipe) if a.key in keys}

    assert listed("gyroscope", {}) == dict.fromkeys(keys, False)
    assert listed("gyroscope", {"g_sensitivity": 0, "offset_tempco": 0, "gain_tempco": 0}) == dict.fromkeys(keys, True)
    assert listed("accelerometer", {}) == dict.fromkeys(keys - {"device.g_sensitivity"}, False)
    recipe = tumble.recipe("one-point", "gyroscope", positions=rest, device={})
    found = tumble.calibrate_unit(recipe, tumble.table(recipe, np.zeros((1, 1, 3)), 0.01, 50, rng), tumble.TODAY)
    assert found.budget is not None
    assert found.budget.std("g-sensitivity")[:3] == pytest.approx([0.1] * 3)


def test_scatter_that_nothing_shows_is_listed_as_assumed() -> None:
    """Where errors of poses are stated, the axis along the stimulus decides, and one visit of each of six faces does
    not show what else moves it. Positions whose magnitude alone leaves readings over do."""

    def hidden(method: str = "six-point", **more: Any) -> bool:
        recipe = tumble.recipe(method, **more)
        return any(a.key == assumptions.HIDDEN_SCATTER and a.value > 0 for a in assumptions.listing(recipe))

    stated = {"source": "gravity", "magnitude": 1.0, "pose_std_deg": 0.3}
    assert hidden(reference=stated)
    assert not hidden("n-point", reference=stated)
    assert not hidden("n-point", model="offset-gain", reference=stated)
    assert not hidden(reference=stated, runs=[{}, {}])
    assert not hidden(reference=stated | {"pose_std_deg": 0})
    assert not hidden(reference=stated, reproducibility={"offset": 1e-4, "gain": 1e-4, "dof": 9})
    assert not hidden(reference={"source": "gravity", "magnitude": 1.0})
    assert hidden("one-point", reference={"source": "gravity", "magnitude": 1.0}), "0.096 deg, as nothing is left over"
    assert not hidden("norm", reference=stated), "a fit of magnitudes does not feel poses"
