"""What a diagnosis holds at once does not follow the number of laws and units that it goes through."""

import tracemalloc
from typing import Any

import numpy as np
import pytest

from station.diagnosis.candidates import projected_bank
from station.diagnosis.candidates.nuisance import accept_candidate
from station.diagnosis.candidates.projected_bank import project_bank
from station.diagnosis.candidates.rival_laws import rival_laws
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear import noise_floor, projection
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.parted_space import PartedSpace
from station.diagnosis.linear.projection import DataColumns, ResidualSpace
from station.diagnosis.search import distinguishability, form_check, scoring
from station.diagnosis.search.candidate_banks import CandidateBanks, all_candidates
from station.diagnosis.search.distinguishability import SignatureAxes, estimate_signal, signature_axes
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import score_bank
from station.domain.core.types import Floats, Labels
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe


@pytest.fixture(scope="module")
def problem() -> Any:
    table, _ = hide(recipe(2), None, 3, units=3, floor=WHITE)
    return initial_problem(reduce_samples(recipe(2), table), FloorAllowance.of(recipe(2), Model()))


def few_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(form_check, "COURSES_AT_ONCE", 1)
    monkeypatch.setattr(form_check, "FEWEST_LAWS_AT_ONCE", 3)


def test_laws_looked_at_in_portions_are_those_of_all_at_once(problem: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    floor, laws = problem.fit().floor, list(rival_laws(problem.view))
    # As narrow as to leave some out, so that the best so far is not the best of all.
    monkeypatch.setattr(form_check, "PROMISING_NATS", 1.0)
    whole = [law.name for law in form_check._promising(problem, [], laws, floor)]
    few_at_once(monkeypatch)
    assert [law.name for law in form_check._promising(problem, [], laws, floor)] == whole
    assert 0 < len(whole) < len(laws)


def test_laws_that_are_far_behind_are_not_held(problem: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    floor = problem.fit().floor
    everything = sum(law.columns.still.nbytes for law in rival_laws(problem.view))
    monkeypatch.setattr(form_check, "PROMISING_NATS", 0.0)
    few_at_once(monkeypatch)
    kept, peak = traced(lambda: form_check._promising(problem, [], rival_laws(problem.view), floor))
    assert len(kept) == 0
    assert peak < 0.75 * everything, (peak, everything)


def traced(call: Any) -> tuple[Any, int]:
    """What a call returns, and the most memory that it held, bytes."""
    tracemalloc.start()
    try:
        return call(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_levels_that_group_alike_hold_one_code(problem: Any) -> None:
    codes = [c.code for c in all_candidates(problem.view)]
    assert len({id(code) for code in codes}) == len({code.tobytes() for code in codes}) < len(codes) / 10


def test_a_scored_bank_holds_no_row_of_its_space(problem: Any) -> None:
    floor, banks = problem.fit().floor, [bank.only([0]) for bank in CandidateBanks(problem.view).of(problem.view, ())]
    rows = problem.space(floor, moving=True).basis.nbytes
    tracemalloc.start()
    try:
        scored = score_bank(problem, banks, floor)
        held = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert [c.moving for c in scored.candidates] == [False, True]
    assert held < rows / 2, (held, rows)


def test_what_is_not_held_of_a_scan_is_found_again(problem: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a scan, whose groups are many, neither log-determinants nor likelihoods are kept; it is judged some units at a
    time."""
    floor = problem.fit().floor
    scored = score_bank(problem, CandidateBanks(problem.view).of(problem.view, ()), floor).projected[0]
    i = next(i for i, c in enumerate(scored.bank.candidates) if c.pattern == "scan" and c.of == "run")
    found = scored.found[i]
    monkeypatch.setattr(projected_bank, "EIGENVALUES_AT_ONCE", 1)
    (kept,) = project_bank(scored.bank.only([i]), problem.view.layout, [problem.space(floor, moving=False)])
    assert kept.evidence[0] == pytest.approx(found.evidence, rel=1e-12)
    spectrum = found.spectrum
    assert spectrum.known_logdet is None
    expected = np.log1p(spectrum.m[..., None] * spectrum.rho).sum(axis=-2)
    np.testing.assert_allclose(spectrum.logdet, expected, rtol=1e-12)
    odds = log_mean_exp(scored.likelihood(found))
    spread = found.spectrum.spread(odds[None])
    assert log_mean_exp(spread)[0] == pytest.approx(found.evidence, rel=1e-12)


@pytest.mark.parametrize("name", ["nest-tilt", "quadratic", "step"])
def test_causes_are_as_far_apart_some_units_at_a_time(problem: Any, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    space, every = problem.space(problem.fit().floor, moving=False), all_candidates(problem.view)
    others = [(c, np.ones(len(c.names))) for c in every if c.name == name and not c.moving][:3]
    cubic = next(c for c in every if c.name == "cubic")
    found = estimate_signal(cubic, problem.view.layout, space, np.ones(len(cubic.names)))
    seen = list[int]()
    project = ResidualSpace.project

    def noted(self: ResidualSpace, rows: DataColumns, units: slice = slice(None)) -> Floats:
        seen.append(len(rows.visit))
        return project(self, rows, units)

    monkeypatch.setattr(ResidualSpace, "project", noted)
    monkeypatch.setattr(distinguishability, "UNITS_AT_ONCE", 2)
    for one in others:
        apart = distinguishability.separations(found, [one], problem.view.layout, space)[name]
        assert seen == [2, 1]
        axes = signature_axes(one[0], problem.view.layout, space, one[1])
        assert apart == pytest.approx(plainly(found, axes), rel=1e-9)
        seen.clear()
    assert others


def plainly(found: Any, other: SignatureAxes) -> float:
    """d·√κ by the axes of all units at once."""
    unit = found.axes.vectors * np.sqrt(found.axes.inverse)[:, None, :]
    apart = distinguishability._squares_outside(found.data[..., None], other, each=False)
    return float(np.sqrt(max(apart - distinguishability._squares_outside(unit, other, each=found.axes.own), 0.0)))


def test_a_column_whose_names_are_all_used_is_not_copied() -> None:
    column = Labels(("A", "B", "C"), np.array([2, 0, 1, 1], np.int32))
    assert column.used().code is column.code
    fewer = column[np.array([0, 2])].used()
    assert fewer.names == ("B", "C") and fewer.code.tolist() == [1, 0]
    assert fewer.code.dtype == np.int32
    nothing = column[:0].used()
    assert nothing.names == () and not len(nothing.code)


@pytest.mark.parametrize("moving", [False, True])
def test_a_space_made_some_units_at_a_time_scores_as_the_whole_does(
    problem: Any, moving: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor, bank = problem.fit().floor, CandidateBanks(problem.view).of(problem.view, ())[moving]
    (whole,) = project_bank(bank, problem.view.layout, [problem.space(floor, moving=moving)])
    monkeypatch.setattr(projected_bank, "UNITS_AT_ONCE", 2)
    monkeypatch.setattr(scoring, "FEW_UNITS", 2)
    parted = problem.setting.scored_space(floor, moving=moving)
    assert isinstance(parted, PartedSpace)
    (found,) = project_bank(bank, problem.view.layout, [parted])
    np.testing.assert_allclose(found.evidence, whole.evidence, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.readings.fits, whole.readings.fits, rtol=1e-12)
    assert found.readings.size.dof == whole.readings.size.dof


def test_a_bank_without_candidates_leaves_the_readings_their_sum_of_squares(
    problem: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor, bank = problem.fit().floor, CandidateBanks(problem.view).of(problem.view, ())[0].only([])
    (whole,) = project_bank(bank, problem.view.layout, [problem.space(floor, moving=False)])
    monkeypatch.setattr(scoring, "FEW_UNITS", 2)
    (found,) = project_bank(bank, problem.view.layout, [problem.setting.scored_space(floor, moving=False)])
    np.testing.assert_allclose(found.readings.fits, whole.readings.fits, rtol=1e-12)


def test_candidates_of_a_kind_may_be_looked_at_one_by_one(problem: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    floor, bank = problem.fit().floor, CandidateBanks(problem.view).of(problem.view, ())[0]
    space = problem.space(floor, moving=False)
    (together,) = project_bank(bank, problem.view.layout, [space])
    monkeypatch.setattr(projected_bank, "EIGENVALUES_AT_ONCE", 1)
    (alone,) = project_bank(bank, problem.view.layout, [space])
    np.testing.assert_allclose(alone.evidence, together.evidence, rtol=1e-9, atol=1e-9)


def test_a_floor_is_the_same_from_units_one_by_one(problem: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bound = problem.upper
    together = problem.fit(upper=bound)
    monkeypatch.setattr(noise_floor, "UNITS_AT_ONCE", 1)
    alone = problem.fit(upper=bound)
    np.testing.assert_allclose(alone.floor.variances, together.floor.variances, rtol=1e-7, atol=1e-20)
    np.testing.assert_allclose(alone.covariance, together.covariance, rtol=1e-6, atol=1e-30)


def test_a_space_is_made_some_units_at_a_time(problem: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of many units what stays of each is held, and what it takes to get there is not."""
    accepted = next(c for c in all_candidates(problem.view) if c.of == "common" and c.moving and c.pattern == "shared")
    beside = problem.with_accepted([accept_candidate(accepted, np.ones(len(accepted.names), bool), 1e-3)])
    assert beside.known.shared.visit.shape[-1] and beside.known.shared_precision.all()
    covariance = problem.structure.covariance(problem.fit().floor.variances)
    seen = covariance, beside.known, *beside.readings(moving=True)
    whole, peak = traced(lambda: projection.residual_space(*seen))
    monkeypatch.setattr(projection, "UNITS_AT_ONCE", 1)
    parted, less = traced(lambda: projection.residual_space(*seen))
    assert less < 0.75 * peak, (less, peak)
    for name in ("logdet", "rest", "dof", "shared_logdet"):
        assert getattr(parted, name) == pytest.approx(getattr(whole, name), rel=1e-10)
    np.testing.assert_allclose(parted.residual, whole.residual, atol=1e-9)
    np.testing.assert_array_equal(parted.live, whole.live)
