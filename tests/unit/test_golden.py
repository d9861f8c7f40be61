"""Where a golden unit stands: never run, as registered, drifted, too old, past its own due date."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import linregress, t

from station.domain.line_quality.golden import (
    LatestResult,
    RegisteredUnit,
    en_trends,
    golden_status,
    normalised_error,
)

GOLD = RegisteredUnit("G1", "golden", "six-point", "PASS", {"offset x": (0.02, 0.004)}, (), "2027-01-31")
BAD = RegisteredUnit("B1", "known-bad", "six-point", "FAIL", {}, ("stuck",), "")
SHOWN = LatestResult(1000.0, "PASS", {"offset x": 0.0235}, ())


def problem(
    expected: RegisteredUnit, shown: LatestResult | None, *, after_h: float = 1.0, today: str = "2026-11-21"
) -> str:
    return golden_status(expected, shown, 1000.0 + 3600 * after_h, today, 8.0).problem


def test_a_unit_that_comes_out_as_registered_is_well_until_it_is_due() -> None:
    assert problem(GOLD, SHOWN) == ""
    assert problem(GOLD, SHOWN, after_h=8.0) == ""
    assert "due every 8 h" in problem(GOLD, SHOWN, after_h=8.1)
    assert golden_status(GOLD, SHOWN, 1360.0, "2026-11-21", 8).age_s == 360.0


def test_a_unit_never_run_or_past_its_own_date_locks() -> None:
    assert "never run" in problem(GOLD, None)
    assert problem(GOLD, SHOWN, today="2027-01-31") == ""
    assert "past its due date" in problem(GOLD, SHOWN, today="2027-02-01")


def test_a_drifted_or_failing_golden_unit_locks() -> None:
    assert "offset x is 0.0245" in problem(GOLD, replace(SHOWN, values={"offset x": 0.0245}))
    assert "FAIL instead of PASS" in problem(GOLD, replace(SHOWN, outcome="FAIL"))
    assert "nothing" in problem(GOLD, replace(SHOWN, values={}))


def test_a_known_bad_unit_must_fail_for_its_own_reason() -> None:
    assert problem(BAD, LatestResult(1000.0, "FAIL", {}, ("noise", "stuck"))) == ""
    assert "PASS instead of FAIL" in problem(BAD, SHOWN)
    assert "stuck was not found wanting" in problem(BAD, LatestResult(1000.0, "FAIL", {}, ("noise",)))


def test_a_certified_unit_is_decided_by_both_uncertainties() -> None:
    """0.0035 apart: Eₙ = 0.0035/√(0.004² + 0.003²) = 0.7; 0.006 apart 1.2."""
    certified = RegisteredUnit("G1", "golden", "", "PASS", {"offset x": (0.02, 0.004)}, (), "", external=True)
    here = replace(SHOWN, expanded={"offset x": 0.003})
    assert normalised_error(0.0035, 0.004, 0.003) == 0.7
    assert problem(certified, here) == ""
    assert "Eₙ of offset x is +1.20" in problem(certified, replace(here, values={"offset x": 0.026}))


def attempts(values: list[float]) -> list[LatestResult]:
    """One a day, each with U = 0.003."""
    return [LatestResult(86400.0 * d, "PASS", {"offset x": v}, (), {"offset x": 0.003}) for d, v in enumerate(values)]


CERTIFIED = RegisteredUnit("G1", "golden", "", "PASS", {"offset x": (0.02, 0.004)}, (), "", external=True)


def test_a_drift_is_told_with_the_day_on_which_it_reaches_one(rng: np.random.Generator) -> None:
    """0.0001 a day is 0.02 of Eₙ a day: from 0 on 50 days."""
    values = 0.02 + 1e-4 * np.arange(20) + 2e-4 * rng.standard_normal(20)
    (found,) = en_trends(CERTIFIED, attempts(values.tolist()))
    scores = (values - 0.02) / 0.005
    assert [p.score for p in found.points] == pytest.approx(scores.tolist())
    line = linregress(np.arange(20), scores)
    assert found.drift_per_day == pytest.approx(line.slope)
    assert found.drift_half == pytest.approx(t.ppf(0.975, 18) * line.stderr)
    assert found.days_to_limit == pytest.approx((1 - line.intercept - 19 * line.slope) / line.slope)


def test_scatter_alone_is_no_drift() -> None:
    (found,) = en_trends(CERTIFIED, attempts([0.02, 0.021, 0.02, 0.021, 0.02, 0.021]))
    assert found.days_to_limit is None
    (few,) = en_trends(CERTIFIED, attempts([0.02, 0.021, 0.022]))
    assert few.days_to_limit is None and len(few.points) == 3
