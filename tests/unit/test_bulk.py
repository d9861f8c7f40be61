"""Many units solved together: the bits of each alone, and the short way as right as the long one."""

from dataclasses import replace

import numpy as np
import pytest

from station.domain.core.types import Floats, Outcome, ReducedVisits
from station.domain.evaluation import pipeline
from station.domain.methods import coefficients, method, scatter
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

LINEAR = ("one-point", "three-point", "six-point", "n-point")
NOISE = 1e-3
UNITS = 40
#: So tight that each sort of reason occurs.
LIMITS = {"offset": 0.01, "residual": 0.003, "tilt_deg": 0.3, "noise": 1.4e-3, "temperature_degC": (20.0, 24.5)}
PROCESS = {"offset": [0.0, 0.02], "of_results": True}
RULES: tuple[dict[str, object], ...] = (
    {"rule": "simple"},
    {"rule": "guard-band", "process": PROCESS},
    {"rule": "false-accept", "false_accept": 0.02, "process": {"offset": [0.001, 0.02]}},
)


def fleet(recipe: Recipe, rng: np.random.Generator) -> dict[str, ReducedVisits]:
    """Units of all sorts: calm, with a stop that was bumped, with loose poses, with stops that do not count alike."""
    theta = tumble.units(rng, UNITS)
    if recipe.method == "three-point":
        # It takes cross-axis gains for scatter.
        theta[:, coefficients.CROSS] = 0.0
    mean = tumble.readings(theta, tumble.truths(recipe))
    table = tumble.table(recipe, mean, NOISE, 20, rng)
    found = {r.serial: r.visits for r in pipeline.calibrate(recipe, table, tumble.TODAY)}
    return {s: mishap(stops, i % 8, rng) for i, (s, stops) in enumerate(found.items()) if stops is not None}


def mishap(stops: ReducedVisits, kind: int, rng: np.random.Generator) -> ReducedVisits:
    v = len(stops)
    if kind == 0:
        return replace(stops, mean=stops.mean + 0.05 * (np.arange(v) == v // 2)[:, None])
    if kind == 1:
        return replace(stops, mean=stops.mean + 0.01 * rng.standard_normal((v, 3)))
    if kind == 2:
        return replace(stops, cov=stops.cov * rng.uniform(0.5, 2.0, (v, 1, 1)))
    return stops


def numbers(result: pipeline.CalibrationResult) -> list[Floats]:
    found, budget = result.calibration, result.budget
    assert found is not None and budget is not None
    fitted = [found.offset, found.matrix, found.covariance, found.residual, found.tilt_deg, found.tilt_std_deg]
    return [*fitted, found.disturbed.astype(float), *budget.parts.values(), budget.dof]


@pytest.mark.parametrize("name", LINEAR)
def test_each_unit_has_the_bits_that_it_has_alone(
    name: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    recipe = tumble.recipe(name)
    units = fleet(recipe, rng)
    alone = [pipeline.calibrate_reduced(recipe, {serial: stops})[0] for serial, stops in units.items()]
    for portion in (1, 7, 6144):
        monkeypatch.setattr(scatter, "PORTION", portion * len(next(iter(units.values()))))
        together = pipeline.calibrate_reduced(recipe, units)
        assert [r.serial for r in together] == list(units)
        for one, same in zip(alone, together, strict=True):
            pairs = zip(numbers(one), numbers(same), strict=True)
            assert all(np.array_equal(a, b) for a, b in pairs), (portion, one.serial)
            assert one.verdict == same.verdict


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: str(rule["rule"]))
@pytest.mark.parametrize("name", ["one-point", "n-point"])
def test_each_unit_is_judged_in_bulk_as_it_is_alone(
    name: str, rule: dict[str, object], rng: np.random.Generator
) -> None:
    shown = {"gain": 0.01, "cross_axis": 0.01} if name != "one-point" else {}
    recipe = tumble.recipe(name, limits={**LIMITS, **shown, **rule})
    degC = rng.uniform(23.0, 25.0, UNITS)
    units = {
        serial: replace(stops, temperature_degC=np.full(len(stops), T))
        for (serial, stops), T in zip(fleet(recipe, rng).items(), degC, strict=False)
    }
    alone = [pipeline.calibrate_reduced(recipe, {serial: stops})[0] for serial, stops in units.items()]
    together = pipeline.calibrate_reduced(recipe, units)
    assert [found.verdict for found in together] == [found.verdict for found in alone]
    assert {found.verdict.outcome for found in alone} >= {Outcome.FAIL}
    checks = {reason.check for found in alone for reason in found.verdict.reasons}
    assert len(checks) >= (2 if name == "one-point" else 4)
    for found in together:
        accepted = all(one.accepted for one in found.decisions)
        assert accepted == (not {reason.check for reason in found.verdict.reasons} - {"temperature", "fit"})


@pytest.mark.parametrize("name", LINEAR)
def test_the_short_way_and_the_long_one_differ_by_rounding_alone(name: str, rng: np.random.Generator) -> None:
    """Normal equations of v rows and k columns lose v·k roundings, magnified by the design's condition squared."""
    recipe = tumble.recipe(name)
    problem = method.fit_problem(recipe, list(fleet(recipe, rng).values()))
    kind = method.of(recipe)
    short, long = kind.together(problem), kind.fit(problem)
    assert short is not None
    calm = short.consistent
    assert calm.sum() >= 0.5 * UNITS
    rows, _ = kind.design(problem.true[0], recipe, problem.nuisance)
    bound = rows.size * np.finfo(float).eps * np.linalg.cond(rows) ** 2
    size = np.abs(problem.mean[calm]).max() + 1.0
    assert np.abs(short.theta - long.theta)[calm].max() <= bound * size
    assert np.abs(short.residual - long.residual)[calm].max() <= 4 * bound * size
    assert np.abs(short.jacobian - long.jacobian)[calm].max() <= bound


def test_every_unit_is_in_one_part_once(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = tumble.recipe("n-point")
    problem = method.fit_problem(recipe, list(fleet(recipe, rng).values()))
    monkeypatch.setattr(scatter, "PORTION", 9 * problem.mean.shape[1])
    parts = list(scatter.solve(method.of(recipe), problem))
    assert len(parts) == 1 + -(-UNITS // 9)
    assert np.array_equal(np.sort(np.concatenate([p.units for p in parts])), np.arange(UNITS))
    for part in parts:
        assert np.array_equal(part.problem.mean[part.rows], problem.mean[part.units])


def test_portions_of_a_table_come_to_the_same_as_the_whole(rng: np.random.Generator) -> None:
    recipe = tumble.recipe("six-point")
    mean = tumble.readings(tumble.units(rng, 7), tumble.truths(recipe))
    table = tumble.table(recipe, mean, NOISE, 20, rng)
    whole = list(pipeline.calibrate(recipe, table, tumble.TODAY))
    portions = (table[table.unit.code // 3 == i] for i in range(3))
    found = list(pipeline.calibrate_portions(recipe, portions, tumble.TODAY))
    assert [r.serial for r in found] == [r.serial for r in whole]
    for one, same in zip(whole, found, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(numbers(one), numbers(same), strict=True)), one.serial
