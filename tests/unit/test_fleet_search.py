"""What a sample of a fleet shows clearly is taken for all units; what it does not is looked for in all of them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.diagnosis.candidates.bank import Candidate, candidates_of_shape
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear.evidence import EigenSpectrum
from station.diagnosis.linear.projection import SpaceSize
from station.diagnosis.results.smallest_effect import _of
from station.diagnosis.search import fleet_search
from station.diagnosis.search.alarm import QUANTILE_GRID, NullDistribution
from station.diagnosis.search.cause_search import SearchResult, search_unchecked
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.unit_sample import spread_units
from station.domain.core.types import SampleTable
from station.model.effects.cubic import Cubic
from station.model.effects.hysteresis import Hysteresis
from station.model.effects.settling import Settling
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe

UNITS, SAMPLE = 12, 3


def problem_of(table: SampleTable) -> ScoringProblem:
    return initial_problem(reduce_samples(recipe(2), table), FloorAllowance.of(recipe(2), Model()))


@pytest.fixture(scope="module")
def hidden() -> SampleTable:
    return hide(recipe(2), KNOWN["quadratic"], 3, units=UNITS, floor=WHITE, d=60.0)[0]


@pytest.fixture(scope="module")
def fleet(hidden: SampleTable) -> ScoringProblem:
    return problem_of(hidden)


@pytest.fixture(scope="module")
def sampled(fleet: ScoringProblem) -> SearchResult:
    return search_unchecked(fleet.of_units(spread_units(UNITS, SAMPLE), fleet.fit().floor), null_of)


@pytest.fixture(autouse=True)
def few_units(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_search, "FLOOR_UNITS", SAMPLE)
    # What laws say of a finding is looked at in all units, as elsewhere.
    monkeypatch.setattr(fleet_search, "with_forms_checked", lambda found: found)


def null_of(problem: Any, fitted: Any, like: Any) -> NullDistribution:
    """Scores that chance brings beyond x nats about e^-x times."""
    names = {c.name for c in like.candidates}
    quantiles = dict.fromkeys(names, 6 * QUANTILE_GRID - 3)
    return NullDistribution(quantiles, dict.fromkeys(names, 3.0), dict.fromkeys(names, 1.0), 3.0)


class Whole(Exception):
    """Raised instead of a search in all units."""


@pytest.fixture
def not_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    def search_causes(*_: Any) -> Any:
        raise Whole

    monkeypatch.setattr(fleet_search, "search_causes", search_causes)


def test_some_units_of_a_problem_are_what_they_are_in_it(fleet: ScoringProblem) -> None:
    chosen = np.array([1, 2, 7, 11])
    floor = fleet.fit().floor
    some = fleet.of_units(chosen, floor)
    setting, stops = fleet.setting.of_units(chosen)
    rows, count = some.readings(moving=True)
    np.testing.assert_allclose(rows.visit, setting.data.visit, atol=1e-12)
    assert rows.dwell is not None and setting.data.dwell is not None
    np.testing.assert_allclose(rows.dwell, setting.data.dwell, atol=1e-9)
    np.testing.assert_allclose(some.known.own.visit, setting.known.own.visit, atol=1e-12)
    assert count == setting.readings(moving=True)[1]
    scene, whole = some.view.scene, fleet.view.scene
    assert scene.group("unit")[1] == tuple(whole.group("unit")[1][u] for u in chosen)
    # What a cause would do to them is the same, the step from one visit to the next and the samples' times included.
    for effect in (Hysteresis.example(), Settling.example()):
        mine, all_of_them = some.view.signature(effect), fleet.view.signature(effect)
        np.testing.assert_allclose(mine[0], all_of_them[0][stops], atol=1e-12)


@pytest.mark.usefixtures("not_whole")
def test_what_a_sample_finds_has_the_sizes_that_all_units_show(fleet: ScoringProblem) -> None:
    found = fleet_search.search_by_sample(fleet, null_of)
    (item,) = found.last.accepted
    assert [f.name for f in found.findings] == ["quadratic"] and found.findings[0].accepted is item
    assert found.first is fleet and found.share > 1 and item.coefficient.shape == (UNITS, 3)
    whole = search_unchecked(fleet, null_of)
    (same,) = whole.last.accepted
    assert (same.candidate.of, same.candidate.effect) == (item.candidate.of, item.candidate.effect)
    np.testing.assert_allclose(item.coefficient, same.coefficient, atol=1e-4 * float(np.abs(same.coefficient).max()))
    np.testing.assert_allclose(item.std, same.std, rtol=1e-3)
    assert found.last.fit().floor.noise == pytest.approx(whole.last.fit().floor.noise, rel=1e-4)


def shaken(table: SampleTable, units: list[int], size: float) -> SampleTable:
    """The table where the gain of the x axis of some units grows by its square."""
    more = np.isin(table.unit.code, units)[:, None] * size * table.reading**2 * np.array([1.0, 0.0, 0.0])
    return replace(table, reading=table.reading + more)


@pytest.mark.usefixtures("not_whole")
def test_a_cause_in_one_unit_of_all_is_found_in_it() -> None:
    quiet = hide(recipe(2), None, 5, units=UNITS, floor=WHITE)[0]
    odd = next(u for u in range(UNITS) if u not in spread_units(UNITS, SAMPLE))
    problem = problem_of(shaken(quiet, [odd], 2e-3))
    assert fleet_search.standing_out(problem.fit().space).tolist() == [odd]
    found = fleet_search.search_by_sample(problem, null_of)
    (item,) = found.last.accepted
    assert item.candidate.name == "quadratic" and np.abs(item.coefficient[:, 0]).argmax() == odd


@pytest.mark.usefixtures("not_whole")
def test_units_are_searched_whole_where_a_sample_shows_nothing_or_not_all(
    fleet: ScoringProblem, sampled: SearchResult
) -> None:
    with pytest.raises(Whole):
        fleet_search.search_by_sample(problem_of(hide(recipe(2), None, 5, units=UNITS, floor=WHITE)[0]), null_of)
    # What has another square in one unit that the sample has not is more than a part of the fleet's own.
    assert not fleet_search._shows_more(found_in_all(fleet, sampled), sampled)
    assert fleet_search._in_all_units(fleet, replace(sampled, findings=())) is None
    assert fleet_search._shows_more(fleet, sampled)


def test_a_tie_stays_where_all_units_have_it_and_else_all_are_searched(
    fleet: ScoringProblem, sampled: SearchResult
) -> None:
    (finding,) = sampled.findings
    assert finding.accepted is not None
    own, cubic = finding.accepted.candidate, candidates_of_shape(Cubic.example(), sampled.first.view)[0]

    def tied_with(*alike: Candidate) -> SearchResult | None:
        tied = replace(finding, alike=alike, indistinguishable_from=("another",))
        return fleet_search._in_all_units(fleet, replace(sampled, findings=(tied,)))

    same, alone = tied_with(own), fleet_search._in_all_units(fleet, sampled)
    assert same is not None and alone is not None
    assert same.findings[0].indistinguishable_from == ("another",)
    # Four times as many units leave about twice the length.
    assert same.findings[0].d == alone.findings[0].d > 1.5 * finding.d
    assert tied_with(cubic) is None and tied_with() is None


def found_in_all(fleet: ScoringProblem, found: SearchResult) -> ScoringProblem:
    whole = fleet_search._in_all_units(fleet, found)
    assert whole is not None
    return whole.last


def test_units_that_scatter_alike_do_not_stand_out() -> None:
    quiet = problem_of(hide(recipe(2), None, 8, units=UNITS, floor=WHITE)[0])
    assert fleet_search.standing_out(quiet.fit().space).size == 0


@pytest.mark.parametrize("pattern", ["own", "shared"])
def test_the_smallest_effect_of_a_sample_is_that_of_so_many_times_as_many_units(pattern: Any) -> None:
    """Eigenvalues of four times as many alike units: repeated where each has its own coefficients, else added up."""
    m = np.array([[4.0, 1.0], [3.0, 2.0]]) if pattern == "own" else np.array([4.0, 1.0])
    more = np.tile(m, (4, 1)) if pattern == "own" else 4 * m

    def seen(values: Any) -> EigenSpectrum:
        none = np.zeros((*values.shape, 0))
        return EigenSpectrum(pattern, SpaceSize(0.0, 9, 1), values, none, np.ones(()), np.ones(1), None)

    assert _of(seen(m), 4.0) == pytest.approx(_of(seen(more), 1.0), rel=1e-12)
