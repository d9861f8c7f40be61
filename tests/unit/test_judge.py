"""Limits and the decision rule: what is accepted, why not, and how often wrongly."""

from typing import Literal

import numpy as np
import pytest
from scipy.stats import norm, t

from station.domain.core.types import Calibration, Floats, Outcome, ReducedVisits, Verdict
from station.domain.methods import decision, decision_rule, risk
from station.domain.methods.coverage import ErrorDistribution
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.blocks import Limits
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

OFFSET = 0.05


def unit(offset: Floats | list[float], std: float, dof: float = 1e9) -> tuple[Calibration, Budget]:
    """A unit with offsets (3) known to `std`, and nothing else uncertain."""
    covariance = np.zeros((12, 12))
    covariance[range(3), range(3)] = std**2
    nothing = np.zeros((1, 3))
    found = Calibration(
        method="one-point",
        unit="g",
        offset=np.asarray(offset, float),
        matrix=np.eye(3),
        covariance=covariance,
        positions=("z-up",),
        residual=nothing,
        tilt_deg=np.zeros(1),
        tilt_std_deg=np.zeros(1),
        disturbed=np.zeros(1, bool),
        residual_rms=0.0,
    )
    return found, Budget({"noise": covariance}, covariance, np.full(12, dof), 0.0, {})


def within(limits: Limits, offset: float, std: float, dof: float = 1e9) -> decision_rule.LimitedCoefficients:
    found, budget = unit([offset, 0.0, 0.0], std, dof)
    return decision_rule.limited_coefficients(limits, [found], [budget])


def verdict_on(recipe: Recipe, offset: list[float], std: float) -> Verdict:
    found, budget = unit(offset, std)
    (verdict,) = decision_rule.judge(recipe, [decision_rule.JudgedUnit(found, budget, _stops())])
    return verdict


def known(t: decision_rule.LimitedCoefficients) -> risk.Measured:
    """Coefficients that err by themselves, of a process of which nothing is stated."""
    units, count = t.deviation.shape
    correlation = np.broadcast_to(np.eye(count), (units, count, count))
    return risk.Measured(t.deviation, t.error, correlation, risk.Prior.unknown(units, count))


def test_the_guard_band_of_each_rule() -> None:
    """JCGM 106: simple w = 0; guard band w = U = k·u; false accept w = z·u."""
    error = ErrorDistribution.plain(np.array([0.01]), np.array([1e9]))
    assert decision.guard_band(Limits(offset=1.0), error).tolist() == [0.0]
    assert decision.guard_band(Limits(offset=1.0, rule="guard-band"), error) == pytest.approx(
        [0.01 * norm.ppf(0.975)], rel=1e-5
    )
    rule = Limits(offset=1.0, rule="false-accept", false_accept=0.01)
    assert decision.guard_band(rule, error) == pytest.approx([0.01 * norm.ppf(0.99)], rel=1e-5)


def test_the_guard_band_knows_that_the_noise_is_an_estimate() -> None:
    """With ν = 5 the band is Student's quantile."""
    rule = Limits(offset=1.0, rule="false-accept", false_accept=0.01)
    found = decision.guard_band(rule, ErrorDistribution.plain(np.array([0.01]), np.array([5.0])))
    assert found == pytest.approx([0.01 * t.ppf(0.99, 5)], rel=1e-6)


def test_probability_of_conformance_by_hand() -> None:
    """One coefficient at 0.04 ± 0.01 within ±0.05: Φ(1) − Φ(−9); the two at zero add nothing."""
    found = within(Limits(offset=OFFSET), 0.04, 0.01)
    outside = norm.cdf(-1) + norm.cdf(-9) + 4 * norm.cdf(-5)
    assert risk.beyond(known(found), found.limit) == pytest.approx([outside], rel=1e-5)


def test_a_value_in_the_guard_band_fails_although_it_is_within_the_limit() -> None:
    recipe = tumble.recipe("one-point", limits={"offset": OFFSET, "rule": "guard-band"})
    verdict = verdict_on(recipe, [0.04, 0, 0], 0.006)
    assert verdict.outcome is Outcome.FAIL
    assert verdict.false_accept == 0
    assert verdict.false_reject == pytest.approx(norm.cdf(0.01 / 0.006), rel=1e-3)
    (reason,) = verdict.reasons
    assert "offset x is +0.04 g" in reason.sentence and "guard band 0.012" in reason.sentence
    simple = tumble.recipe("one-point", limits={"offset": OFFSET})
    assert verdict_on(simple, [0.04, 0, 0], 0.006).outcome is Outcome.PASS


def test_a_limit_that_the_uncertainty_eats_up_is_said_to_be_undecidable() -> None:
    recipe = tumble.recipe("one-point", limits={"offset": OFFSET, "rule": "guard-band"})
    verdict = verdict_on(recipe, [0, 0, 0], 0.03)
    assert len(verdict.reasons) == 3
    assert all("cannot decide it" in r.sentence for r in verdict.reasons)


def _stops() -> ReducedVisits:
    rng = np.random.default_rng(1)
    own = tumble.recipe("one-point")
    table = tumble.table(own, np.array([[[0.0, 0.0, 1.0]]]), 1e-4, 20, rng)
    found = tumble.calibrate_unit(own, table, tumble.TODAY)
    assert found.visits is not None
    return found.visits


@pytest.mark.parametrize(("rule", "stated"), [("guard-band", 0.025), ("false-accept", 0.01)])
def test_100000_units_at_the_limit_are_not_accepted_more_often_than_stated(
    rng: np.random.Generator, rule: Literal["guard-band", "false-accept"], stated: float
) -> None:
    """Units just out of limits, noise estimated with few degrees of freedom: the hardest case for the guard band."""
    limits = Limits(offset=OFFSET, rule=rule, false_accept=0.01 if rule == "false-accept" else None)
    n, u, dof = 100_000, 0.004, 12
    measured = OFFSET + u * rng.standard_normal(n)
    std = u * np.sqrt(rng.chisquare(dof, n) / dof)
    guard = decision.guard_band(limits, ErrorDistribution.plain(std, np.full(n, float(dof))))
    accepted = (np.abs(measured) <= OFFSET - guard).mean()
    assert accepted < stated + 3 * np.sqrt(stated / n)


def test_100000_units_of_a_population_fail_as_often_as_their_verdicts_say(rng: np.random.Generator) -> None:
    """Over a wide population the mean stated probability of a false accept is the rate of false accepts."""
    limits = Limits(offset=OFFSET)
    n, u = 100_000, 0.01
    true = rng.uniform(-0.15, 0.15, n)
    measured = true + u * rng.standard_normal(n)
    accepted = np.abs(measured) <= OFFSET
    stated = 1 - (norm.cdf((OFFSET - measured) / u) - norm.cdf((-OFFSET - measured) / u))
    some = np.flatnonzero(accepted)[:2000]
    one_by_one = [
        float(risk.beyond(known(w), w.limit)[0]) for w in (within(limits, float(measured[i]), u) for i in some)
    ]
    assert one_by_one == pytest.approx(stated[some], abs=1e-4)
    rate = (np.abs(true[accepted]) > OFFSET).mean()
    assert rate == pytest.approx(stated[accepted].mean(), abs=4 * np.sqrt(rate / accepted.sum()))


def test_every_reason_is_told_not_the_first_only(rng: np.random.Generator) -> None:
    limits = {"offset": 0.001, "gain": 0.001, "cross_axis": 0.001, "noise": 1e-5, "temperature_degC": [20, 30]}
    recipe = tumble.recipe("six-point", limits=limits)
    theta = np.array([[0.05, 0, 0, 1.05, 0.02, 0, 0, 1, 0, 0, 0, 1]])
    table = tumble.table(recipe, tumble.readings(theta, tumble.truths(recipe)), 1e-3, 40, rng)
    table = type(table)(
        **{n: getattr(table, n) for n in table.__slots__ if n != "values"},
        values={"temperature_degC": np.full(len(table), 35.0)},
    )
    found = {r.check for r in tumble.calibrate_unit(recipe, table, tumble.TODAY).verdict.reasons}
    assert {"offset", "gain", "cross-axis", "noise", "temperature"} <= found
