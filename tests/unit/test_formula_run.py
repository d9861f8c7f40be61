"""The run that parts formulas: a rival's constants are free in the longer campaign, as in the next diagnosis."""

import numpy as np
import pytest

from station.diagnosis.discovery.term_fit import TermFit, candidate_of
from station.diagnosis.planning.formula_run import _promise_of, _rated, share_beyond
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.plan import PlannedCampaign, PlannedRuns, plan_campaign
from station.diagnosis.planning.promise import TiedCauses
from station.diagnosis.planning.proposal import best_proposal
from station.diagnosis.search.distinguishability import SignatureAxes, distinct_share
from station.domain.core.types import Floats
from station.model.formula.term import Term
from station.model.formula.text import formula_text
from tests.blind.recipes import recipe


@pytest.fixture(scope="module")
def plan() -> PlannedCampaign:
    return plan_campaign(recipe(), 4)


def axes(plan: PlannedCampaign, term: Term) -> SignatureAxes:
    return plan.axes(candidate_of(term, plan.problem.view))


@pytest.mark.parametrize(
    ("law", "rival", "field", "values"),
    [
        (("temperature", 15.0), "temperature-squared", "about_degC", np.linspace(-20, 60, 41)),
        (("decay", 20.0), "decay-since-power", "time_constant_s", np.geomspace(10, 40, 40)),
    ],
)
def test_a_rival_is_parted_only_by_what_none_of_its_constants_follows(
    plan: PlannedCampaign, law: tuple[str, float], rival: str, field: str, values: Floats
) -> None:
    def term(modulator: str, value: float) -> Term:
        return Term("own-squared", modulator, ("z",), "common", ((field, float(value)),))

    found = axes(plan, term(*law))
    shares = [distinct_share(found, axes(plan, term(rival, value))) for value in values]
    for start in values[[0, len(values) // 3, -1]]:
        assert share_beyond(plan, found, term(rival, start)) <= 1.05 * min(shares) + 1e-6


def test_curves_of_temperature_are_parted_beyond_the_temperatures_so_far(plan: PlannedCampaign) -> None:
    """A line and a square that look alike now are asked for where it is colder or warmer, and in no other run."""
    fits = [
        TermFit(Term("own-squared", m, ("z",), "common", (("about_degC", about),)), 0.5, 1, rms, 0.0, np.zeros((1, 1)))
        for m, about, rms in (("temperature", 15.0, 1e-4), ("temperature-squared", 3.0, 4e-6))
    ]
    campaign = MeasuredCampaign(recipe(), 4, 2, plan.problem.fit().floor)
    rated = list(_rated(campaign, PlannedRuns.measured(recipe()), [tuple(fits)]))
    best = best_proposal(rated)
    beyond = ("one run 20 °C warmer", "one run 10 °C colder")
    assert best is not None and best.change in beyond
    assert best.certainty > 0.95
    assert max(p.certainty for p in rated if p.change not in beyond) < 0.5


def test_a_run_that_promises_no_more_than_a_shorter_one_is_given_up(plan: PlannedCampaign) -> None:
    terms = [
        Term("own-squared", "temperature", ("z",), "common", (("about_degC", 15.0),)),
        Term("own-squared", "temperature-squared", ("z",), "common", (("about_degC", 3.0),)),
        Term("own-cubed", "constant", ("z",), "common", ()),
    ]
    tie = tuple(TermFit(term, 0.5, 1, 1e-4, 0.0, np.zeros((1, 1))) for term in terms)
    tied = (TiedCauses.of([formula_text(term) for term in terms], np.inf, {}),)
    whole = _promise_of(plan, [tie], tied, -np.inf)
    assert whole is not None
    for most in (0.0, 0.9 * whole.certainty, 1.1 * whole.certainty, 1.0):
        assert (_promise_of(plan, [tie], tied, most) is None) == (whole.certainty <= most)
    assert _promise_of(plan, [tie], tied, 0.9 * whole.certainty) == whole
