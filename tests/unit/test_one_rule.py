"""One decision rule for every limit: coefficients, residual, tilt, noise, consistency and verification."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from station.domain.core import rotation
from station.domain.core.types import Floats, Outcome
from station.domain.evaluation import verification
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.evaluation.verification import VerifiedPosition
from station.domain.methods import decision_rule, risk
from station.domain.methods.decision import decide_limit
from station.domain.planning.forecast import forecast
from station.domain.recipe.blocks import Limits
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from tests.fakes import tumble

LIMITS = {"residual": 0.004, "tilt_deg": 0.5, "noise": 0.004, "consistency": 0.5, "offset": 0.5}
SITED = {"source": "gravity", "magnitude": 1.0, "magnitude_std": 1e-4, "nest_std_deg": 0.1, "base_std_deg": 0.05}
AT = np.array([0.6, 0.0, 0.8])


def calibrated(rng: np.random.Generator, method: str = "six-point", **more: Any) -> tuple[Recipe, CalibrationResult]:
    recipe = tumble.recipe(method, **more)
    table = tumble.table(recipe, tumble.readings(tumble.units(rng, 1), tumble.truths(recipe)), 1e-3, 50, rng)
    return recipe, tumble.calibrate_unit(recipe, table, tumble.TODAY)


def test_a_decision_by_hand() -> None:
    """0.08 ± 0.01 (k = 1) of 0.1: U = 0.0196; risk Φ(−2) + Φ(−18); accepted up to 0.1 − w."""
    found = decide_limit(Limits(rule="guard-band"), ("x", "g"), -0.08, 0.01, 0.1)
    assert found.expanded == pytest.approx(0.01 * norm.ppf(0.975), rel=1e-5) == found.guard
    assert found.false_accept == pytest.approx(norm.cdf(-2), rel=1e-4)
    assert found.accepted and found.margin == pytest.approx(0.02 - found.guard)
    assert not decide_limit(Limits(rule="guard-band"), ("x", "g"), 0.081, 0.01, 0.1).accepted
    assert decide_limit(Limits(), ("x", "g"), 0.081, 0.01, 0.1).accepted
    assert not decide_limit(Limits(), ("x", "g"), float("nan"), 0.01, 0.1).accepted


def test_every_limit_is_shown_with_value_u_guard_band_and_risk(rng: np.random.Generator) -> None:
    _, found = calibrated(rng, limits={**LIMITS, "rule": "guard-band"})
    shown = {d.what: d for d in found.decisions}
    assert {"residual", "tilt", "noise", "consistency", "offset x"} <= set(shown)
    for d in shown.values():
        assert d.expanded and d.guard == pytest.approx(d.expanded) and d.false_accept is not None
        assert d.margin == d.limit - d.guard - abs(d.value)
    assert found.verdict.outcome is Outcome.PASS
    # s of 50 readings is known to s/√98.
    assert shown["noise"].expanded == pytest.approx(1.96 * shown["noise"].value / 98**0.5, rel=0.2)


@pytest.mark.parametrize("kind", ["residual", "noise", "consistency"])
def test_the_guard_band_decides_where_the_plain_limit_would_not(kind: str) -> None:
    _, found = calibrated(np.random.default_rng(7), limits=LIMITS)
    value = next(d for d in found.decisions if d.what == kind)
    assert value.expanded
    limit = abs(value.value) + value.expanded / 2
    for rule, outcome in (("simple", Outcome.PASS), ("guard-band", Outcome.FAIL)):
        _, again = calibrated(np.random.default_rng(7), limits={kind: limit, "rule": rule})
        assert again.verdict.outcome is outcome


def errors_of_a_perfect_device(
    recipe: Recipe, found: CalibrationResult, rng: np.random.Generator
) -> list[VerifiedPosition]:
    """What verification finds where the device is right, and the stimulus wrong by as much as the recipe states."""
    out = []
    for _ in range(300):
        turn = rotation.from_vector(np.deg2rad(0.1) * rng.standard_normal(3))
        stand = rotation.from_vector(np.deg2rad(0.05) * rng.standard_normal(3))
        felt: Floats = (1 + 0.002 * rng.standard_normal()) * (
            turn @ rotation.shortest(np.array([0, 0, 1.0]), AT) @ stand
        )[:, 2]
        output = felt + 1e-3 * rng.standard_normal((50, 3))
        own = verification.measured_covariance(found, recipe, ("tilt", "home"), AT, output)
        out.append(VerifiedPosition("tilt", output.mean(axis=0), AT, 1.0, None, own))
    return out


def test_u_of_a_verification_error_is_that_of_dwell_pose_and_stimulus(rng: np.random.Generator) -> None:
    stated = {"magnitude": 1.0, "magnitude_std": 0.002, "nest_std_deg": 0.1, "base_std_deg": 0.05, "pose_std_deg": 0}
    verify = {"positions": [tumble.position("tilt", AT)], "limit": 0.01}
    recipe, found = calibrated(rng, reference={"source": "gravity", **stated}, verify=verify)
    errors = errors_of_a_perfect_device(recipe, found, rng)
    square = np.array([e.error**2 / np.trace(e.measured) for e in errors if e.measured is not None])
    # A sum of three unlike squares scatters by no more than one square alone, √2.
    assert square.mean() == pytest.approx(1, abs=4 * (2 / len(square)) ** 0.5)


def test_verification_decides_by_the_same_rule(rng: np.random.Generator) -> None:
    verify = {"positions": [tumble.position("tilt", AT)], "limit": 0.01}
    recipe, found = calibrated(rng, limits={"rule": "guard-band"}, verify=verify, reference=SITED)
    own = verification.measured_covariance(
        found, recipe, ("tilt", "home"), AT, AT + 1e-3 * rng.standard_normal((50, 3))
    )
    right = VerifiedPosition("tilt", AT + np.array([1e-3, 0, 0]), AT, 1.0, None, own)
    (d,) = verification.verify_decisions((right,), recipe)
    assert (d.what, d.limit) == ("verification tilt", 0.01)
    assert d.guard == pytest.approx(1.96 * right.std, rel=1e-4)
    assert verification.check((right,), recipe) == ()
    near = replace(right, mean=AT + np.array([0.0095, 0, 0]))
    (reason,) = verification.check((near,), recipe)
    assert "guard band" in reason.sentence
    assert verification.check((near,), tumble.recipe("six-point", verify=verify)) == ()


@pytest.mark.parametrize(
    ("method", "limits"),
    [("one-point", {"residual": 0.1}), ("one-point", {"tilt_deg": 1}), ("one-point", {"consistency": 1}),
     ("one-point", {"gain": 0.1}), ("three-point", {"cross_axis": 0.1})],
)  # fmt: skip
def test_limits_that_any_unit_keeps_are_refused(method: str, limits: dict[str, float]) -> None:
    with pytest.raises(RecipeError, match=next(iter(limits))):
        decision_rule.refuse_unestimated(tumble.recipe(method, limits=limits))


@pytest.mark.parametrize(
    ("mean", "guard", "error"),
    [(0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (-0.02, 0.02, 0.0), (0.01, 0.0, 0.006), (0.0, 0.01, -0.015)],
)
def test_global_risks_are_those_of_the_two_normal_values(mean: float, guard: float, error: float) -> None:
    """JCGM 106: true value and result are jointly normal; the rectangles by scipy's bivariate distribution."""
    std, u, limit = 0.02, 0.004, 0.05
    both = multivariate_normal([mean, mean + error], [[std**2, std**2], [std**2, std**2 + u**2]])

    def of(low: tuple[float, float], high: tuple[float, float]) -> float:
        return float(both.cdf(np.array(high), lower_limit=np.array(low)))

    room, far = limit - guard, mean + 9 * std
    consumer = of((limit, -room), (far, room)) + of((-far - 1, -room), (-limit, room))
    producer = of((-limit, room), (limit, far)) + of((-limit, -far - 1), (limit, -room))
    assert risk.global_risks((mean, std), u, limit, guard, error) == pytest.approx((consumer, producer), abs=2e-6)


def test_a_forecast_has_the_risks_of_a_stated_process_only() -> None:
    for process, known in (({"offset": [0, 0.02]}, True), (None, False)):
        (one,) = forecast(
            tumble.recipe("six-point", limits={"offset": 0.05, "process": process}), np.zeros(12)
        ).decisions
        assert (one.risks is not None) is known
