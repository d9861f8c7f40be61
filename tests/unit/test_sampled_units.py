"""What a sample of a fleet's units leaves out changes nothing of what all of them say."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.candidates.rival_laws import rival_laws
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search import (
    distinguishability,
    finding,
    first_look,
    form_check,
    other_starts,
    rank,
    search_state,
    unit_sample,
    walk_marginal,
)
from station.diagnosis.search.alarm import NullDistribution
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import evidence_by_cause, score_bank
from station.diagnosis.search.search_state import CauseSearch
from station.diagnosis.search.unit_sample import sampled_units
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe

UNITS = 12


@pytest.fixture(scope="module")
def fleet() -> Any:
    table, _ = hide(recipe(2), KNOWN["quadratic"], 3, units=UNITS, floor=WHITE)
    return initial_problem(reduce_samples(recipe(2), table), FloorAllowance.of(recipe(2), Model()))


def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No sample of any fleet."""
    monkeypatch.setattr(unit_sample, "LEAST_SHARE", UNITS + 1)


def test_samples_are_spread_and_share_no_unit(fleet: Any) -> None:
    one, two = (sampled_units(fleet.setting, 3, which) for which in (0, 1))
    assert one is not None and two is not None
    unit = fleet.view.layout.unit
    chosen = [np.unique(unit[sample.visits]).tolist() for sample in (one, two)]
    assert [[u // 4 for u in units] for units in chosen] == [[0, 1, 2], [0, 1, 2]]
    assert not set(chosen[0]) & set(chosen[1])
    assert one.share == UNITS / 3
    assert sampled_units(fleet.setting, UNITS // unit_sample.LEAST_SHARE + 1) is None


@pytest.mark.parametrize("nests", [2, 3, 4, 5, 8, 10])
def test_samples_of_units_that_take_turns_have_some_of_every_nest(nests: int) -> None:
    for units in (160, 200, 320, 400, 1000):
        assert np.unique(unit_sample.spread_units(units, 40) % nests).size == nests


def test_what_a_sample_shows_for_sure_is_behind_in_all_units_as_often_as_is_said() -> None:
    """Differences of a unit of mean D and variance 2D; the bound fails with the chance of SURE_ERRORS, never here."""
    rng = np.random.default_rng(7)
    sample, share = 16, 25.0
    each = rng.normal(3.0, np.sqrt(6.0), (2000, sample))
    some = unit_sample.UnitSample(None, np.zeros(0, bool), share)  # type: ignore[arg-type]
    assert np.all(some.surely(each.sum(1)) < 3.0 * sample * share)
    assert np.all(some.at_most(each.sum(1)) > 3.0 * sample * share)
    assert np.all(np.diff(some.surely(np.arange(40.0, 90.0))) > 0)
    # At its bound what all units say is as much more than the sample says as is no chance any more.
    said = np.array([0.0, 20.0, 500.0])
    most = some.at_most(said) / share
    np.testing.assert_allclose(most - unit_sample.SURE_ERRORS * np.sqrt(2 * most), said, atol=1e-9)


def test_a_first_look_leaves_out_shapes_of_what_is_far_behind(fleet: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_look, "FLOOR_UNITS", 3)
    # Few units say for sure that little is behind.
    monkeypatch.setattr(unit_sample, "SURE_ERRORS", 0.2)
    banks, floor = CandidateBanks(fleet.view).of(fleet.view, ()), fleet.fit().floor
    look = first_look.sampled_look(fleet, banks, floor)
    assert look is not None
    contenders = look.contenders()
    assert contenders is not None
    some, every = (score_bank(fleet, each, floor) for each in (contenders, banks))
    assert len(some.candidates) < len(every.candidates) == sum(c.stands_for for c in some.candidates)
    levels = [{(c.name, c.of, c.pattern) for c in at.candidates} for at in (some, every)]
    assert levels[0] == levels[1]
    assert sum(c.pattern == "scan" for c in some.candidates) == sum(c.pattern == "scan" for c in every.candidates)
    after, before = ({n: e[0] for n, e in evidence_by_cause(s.candidates, s.readings().evidence).items()}
                     for s in (some, every))  # fmt: skip
    far = look._far_behind()
    for kind in (set(before) & set(KERNEL_NAMES), set(before) - set(KERNEL_NAMES)):
        leader = max(kind, key=lambda name: before[name])
        assert leader not in far
        assert all(before[name] == pytest.approx(after[name], rel=1e-9, abs=1e-9) for name in kind - far)
        assert all(after[name] < before[name] + 1e-9 for name in kind & far)
    # A floor at its bound may be the cause.
    assert first_look.sampled_look(fleet, banks, replace(floor, turn=1.0)) is None
    alone(monkeypatch)
    assert first_look.sampled_look(fleet, banks, floor) is None


@pytest.mark.parametrize(("threshold", "drawings"), [(-1.0, 1), (1e9, 2)])
def test_chance_is_drawn_for_all_candidates_and_silence_is_that_of_all(
    fleet: Any, monkeypatch: pytest.MonkeyPatch, threshold: float, drawings: int
) -> None:
    """A first look in which nothing alarms is not one that left anything out."""
    monkeypatch.setattr(first_look, "FLOOR_UNITS", 3)
    monkeypatch.setattr(unit_sample, "SURE_ERRORS", 0.2)
    # Nor does any law alarm, which has a level of its own.
    monkeypatch.setattr(search_state, "LAW_LEVEL", 1e-300)
    drawn = list[Any]()

    def null_of(problem: Any, fitted: Any, like: Any) -> NullDistribution:
        drawn.append([(c.name, c.of, c.pattern, i in like.slow) for i, c in enumerate(like.candidates)])
        return NullDistribution({}, {}, {}, threshold)

    search = CauseSearch(fleet, null_of)
    whole = [
        (c.name, c.of, c.pattern)
        for bank in CandidateBanks(fleet.view).of(fleet.view, search.undetectable)
        for c in bank.candidates
    ]
    assert len(drawn) == drawings
    assert all(one == drawn[0] and [key[:3] for key in one] == whole for one in drawn)
    looked_at = len(search.first.now.candidates)
    assert looked_at < len(whole) if drawings == 1 else looked_at == len(whole)


def test_walks_without_hope_leave_nothing_in_the_average(fleet: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    # So large a walk as no quiet campaign shows.
    wide = replace(fleet, upper=np.array([np.inf, *fleet.upper[1:] * np.array([1.0, 900.0])]))
    best = score_bank(wide, CandidateBanks(wide.view).of(wide.view, ()), wide.fit().floor)
    monkeypatch.setattr(walk_marginal, "FLOOR_UNITS", 3)
    some = walk_marginal.marginalise_walks(wide, best)
    alone(monkeypatch)
    every = walk_marginal.marginalise_walks(wide, best)
    assert some.slow == every.slow
    assert (every.hopeless, len(every.walk_stages)) == (0, len(walk_marginal.WALK_FRACTIONS))
    assert some.hopeless == len(every.walk_stages) - len(some.walk_stages) > 0
    for one, two in ((some.totals(), every.totals()), (some.without(), every.without())):
        np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-7)
    assert some.evidence() == pytest.approx(every.evidence(), rel=1e-7, abs=1e-7)


def test_causes_without_hope_under_a_floor_are_behind_what_they_were(
    fleet: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rank, "FLOOR_UNITS", 3)
    banks, floor = CandidateBanks(fleet.view).of(fleet.view, ()), fleet.fit().floor
    # So large a walk speaks against all but what a walk hides.
    at = replace(floor, walk=3.0 * floor.noise)
    first = walk_marginal.WalkMarginal(score_bank(fleet, banks, floor), (), ())
    # Causes that are as near as to have any hope.
    best = {c.name: rank.RankedCause(c.name, 1.0, c, first.best) for c in first.candidates}
    kept = {c.name for bank in rank._hopeful(fleet, banks, at, [first], best) for c in bank.candidates}
    now = walk_marginal.WalkMarginal(score_bank(fleet, banks, at), (), ())
    before, after = (evidence_by_cause(m.candidates, m.totals()[None]) for m in (first, now))
    left_out = set(before) - kept
    assert left_out
    assert all(after[name][0] < before[name][0] for name in left_out)
    alone(monkeypatch)
    assert rank._hopeful(fleet, banks, at, [first], best) is banks


def test_causes_far_behind_the_leader_are_so_under_the_floor_that_it_asks_for(
    fleet: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rank, "FLOOR_UNITS", 3)
    banks, floor = CandidateBanks(fleet.view).of(fleet.view, ()), fleet.fit().floor
    first = walk_marginal.WalkMarginal(score_bank(fleet, banks, floor), (), ())
    best: dict[str, rank.RankedCause] = {}
    rank.keep_best(best, first, first.without())
    leader = max(best.values(), key=lambda r: r.evidence)
    at = replace(floor, noise=0.8 * floor.noise)
    kept = {c.name for bank in rank._hopeful(fleet, banks, at, [first], best) for c in bank.candidates}
    now = walk_marginal.WalkMarginal(score_bank(fleet, banks, at), (), ())
    after = evidence_by_cause(now.candidates, (now.totals() - now.without())[None])
    left_out = set(after) - kept
    assert leader.name == "quadratic" and leader.name in kept and left_out
    most = max(after[leader.name][0], leader.evidence) - unit_sample.HOPELESS_NATS
    assert all(after[name][0] < most for name in left_out)


def test_causes_far_from_the_found_one_in_a_sample_are_not_looked_at_in_all_units(
    fleet: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(finding, "FLOOR_UNITS", 3)
    problem = fleet
    at = score_bank(problem, CandidateBanks(problem.view).of(problem.view, ()), problem.fit().floor)
    best: dict[str, rank.RankedCause] = {}
    first = walk_marginal.WalkMarginal(at, (), ())
    rank.keep_best(best, first, first.without())
    causes = rank.causes_of(best)
    accepted, floor = finding.accepted_at_best(problem, best["quadratic"])
    looked_at, separations = list[int](), distinguishability.separations

    def noted(found: Any, others: Any, layout: Any, space: Any) -> Any:
        looked_at.append(len(others))
        return separations(found, others, layout, space)

    monkeypatch.setattr(finding, "separations", noted)
    near, d = finding._indistinguishable(problem, causes, accepted, floor)
    sampled, some = looked_at
    looked_at.clear()
    alone(monkeypatch)
    every, whole = finding._indistinguishable(problem, causes, accepted, floor)
    assert (near, d) == (every, whole)
    assert looked_at == [sampled] and some < sampled / 2


def test_partners_far_behind_in_a_sample_are_not_the_best(fleet: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(other_starts, "FLOOR_UNITS", 3)
    search: Any = SimpleNamespace(banks=CandidateBanks(fleet.view), undetectable=())
    at = score_bank(fleet, search.banks.of(fleet.view, ()), fleet.fit().floor)
    ranks: dict[str, rank.RankedCause] = {}
    first = walk_marginal.WalkMarginal(at, (), ())
    rank.keep_best(ranks, first, first.without())
    looked_at = list[Any]()

    def noted(problem: Any, banks: Any, floor: Any) -> Any:
        looked_at.append([c for bank in banks for c in bank.candidates])
        return score_bank(problem, banks, floor)

    monkeypatch.setattr(other_starts, "score_bank", noted)
    start = next(c for c in at.candidates if c.name == "index-error" and at.shows(c))
    cause = rank.RankedCause(start.name, 1.0, start, at)

    def pair(found: Any, least: float) -> Any:
        partner = other_starts._Partner(fleet, cause, found, ranks, least)
        return other_starts._best_pair(cause, partner.evidence(search))

    nothing: Any = SimpleNamespace(accepted=None)
    value, names = pair(nothing, 0.0)
    # Nothing explains so much.
    assert pair(nothing, 1e9)[0] == -np.inf and len(looked_at) == 1
    # The same columns as those of the cause that was found first are no other partner.
    found = ranks["quadratic"].best
    assert found is not None
    pair(SimpleNamespace(accepted=SimpleNamespace(candidate=found)), 0.0)
    assert not any((c.effect, c.of) == (found.effect, found.of) for c in looked_at[1])
    alone(monkeypatch)
    whole, whole_names = pair(nothing, 1e9)
    assert value == pytest.approx(whole, rel=1e-9)
    assert names == whole_names == ("index-error", "quadratic")
    kept, _, every = ({c.name for c in some} for some in looked_at)
    assert kept < every and not every & set(KERNEL_NAMES)


def test_laws_far_behind_in_samples_are_not_looked_at_in_all_units(fleet: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    floor, looked_at = fleet.fit().floor, list[int]()
    causes = [
        c for bank in CandidateBanks(fleet.view).of(fleet.view, ()) for c in bank.candidates if c.name == "quadratic"
    ]
    causes = [replace(c, name=f"cause/{i}") for i, c in enumerate(causes)]
    under = form_check._under

    def counted(problem: Any, items: Any, at: Any) -> Any:
        looked_at.append(len(items))
        return under(problem, items, at)

    monkeypatch.setattr(form_check, "_under", counted)
    monkeypatch.setattr(form_check, "SAMPLE_UNITS", 3)
    near = [law.name for law in form_check._promising(fleet, causes, rival_laws(fleet.view), floor)]
    some = sum(looked_at)
    looked_at.clear()
    alone(monkeypatch)
    assert [law.name for law in form_check._promising(fleet, causes, rival_laws(fleet.view), floor)] == near
    assert 0 < some < sum(looked_at) / 2
