"""What the diagnosis computes for many at once is what it is for each alone."""

import os
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.cli.app import main
from station.diagnosis.candidates import projected_bank
from station.diagnosis.candidates import solve as solving
from station.diagnosis.candidates.bank import FEW_UNITS, build_bank
from station.diagnosis.candidates.column_blocks import column_blocks
from station.diagnosis.candidates.projected_bank import project_bank, visible_candidates
from station.diagnosis.data.faults import spectral_lines, tone_search
from station.diagnosis.data.faults.white_dwells import TransientFilter, WhiteDwells
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear import projection
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import score_bank, score_in_noise
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe


@pytest.fixture(scope="module")
def problem() -> Any:
    table, _ = hide(recipe(2), None, 3, units=2, floor=WHITE)
    return initial_problem(reduce_samples(recipe(2), table), FloorAllowance.of(recipe(2), Model()))


def test_a_candidate_of_the_bank_shows_what_it_shows_alone(problem: Any) -> None:
    space, layout = problem.space(problem.fit().floor, moving=False), problem.view.layout
    bank = CandidateBanks(problem.view).of(problem.view, ())[0]
    (whole,) = project_bank(bank, layout, [space])
    patterns = set()
    for c, found in zip(bank.candidates, whole.found, strict=True):
        if c.scans_visits:
            continue
        Z = space.project(c.rows(layout))
        groups = found.spectrum.m.shape[1] if c.pattern == "scan" else 1
        parts = Z.reshape(*Z.shape[:2], groups, -1)
        normal = np.einsum("umgi,umgj->ugij", parts, parts)
        m = {"own": normal[:, 0], "shared": normal[:, 0].sum(0), "scan": normal}[c.pattern]
        # What a calibration takes up is rounding beside what was there.
        length = float(np.sum(space.covariance.whiten(c.rows(layout), 0) ** 2))
        np.testing.assert_allclose(found.spectrum.m, np.linalg.eigvalsh(m), rtol=1e-9, atol=1e-7 * length)
        patterns.add(c.pattern)
    assert patterns == {"own", "shared", "scan"}


def test_what_the_calibration_takes_up_explains_nothing(problem: Any) -> None:
    """An offset of each unit is its calibration's, whatever is read: what rounding leaves of it is no evidence."""
    space, layout = problem.space(problem.fit().floor, moving=False), problem.view.layout
    offset = next(
        c for c in CandidateBanks(problem.view).of(problem.view, ())[0].candidates if c.name == "turn-on-offset"
    )
    code, names = problem.view.scene.group("unit")
    bank = build_bank([replace(offset, of="unit", pattern="own", code=code, names=names)], layout, moving=False)
    (found,) = project_bank(bank, layout, [space])
    assert visible_candidates(found, 1.0) == (False,)
    assert found.evidence[0] == pytest.approx(0.0, abs=1e-3)


def test_a_floor_is_fitted_once_for_a_problem(problem: Any) -> None:
    assert problem.fit() is problem.fit()
    assert problem.fit(problem.fit().floor) is not problem.fit()


@pytest.mark.parametrize("apart", [1.0, 1e-2, 1e-5, 0.0])
def test_a_basis_is_one_however_near_its_columns_are(apart: float) -> None:
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((3, 40, 4))
    columns[:, :, 3] = columns[:, :, 0] + apart * columns[:, :, 3]
    basis, rank, logdet = projection._basis(columns)
    assert rank == (12 if apart else 9)
    unit = basis.swapaxes(1, 2) @ basis
    np.testing.assert_allclose(np.linalg.eigvalsh(unit)[:, 1:], 1.0, atol=1e-11)
    np.testing.assert_allclose(basis @ (basis.swapaxes(1, 2) @ columns), columns, atol=1e-10)
    if apart:
        expected = np.linalg.slogdet(columns.swapaxes(1, 2) @ columns)[1].sum()
        assert logdet == pytest.approx(expected, rel=1e-5 if apart < 1e-3 else 1e-11)


def test_a_basis_of_each_unit_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """What acts in other units is a column of zeros in this one, and takes no singular values; nor does a unit for the
    sake of a neighbour whose columns are hardly apart."""
    rng = np.random.default_rng(4)
    columns = rng.standard_normal((3, 40, 4))
    columns[0, :, [1, 3]] = 0.0
    each = [projection._basis(one[None][..., np.any(one, axis=0)]) for one in columns]
    decomposed: list[int] = []
    svd = np.linalg.svd

    def counted(rows: Any, full_matrices: bool) -> Any:
        decomposed.append(len(rows))
        return svd(rows, full_matrices=full_matrices)

    monkeypatch.setattr(np.linalg, "svd", counted)
    basis, rank, logdet = projection._basis(columns)
    assert (rank, decomposed) == (10, [])
    assert logdet == pytest.approx(sum(one[2] for one in each), rel=1e-12)
    for mine, (own, *_) in zip(basis, each, strict=True):
        np.testing.assert_allclose(mine @ mine.T, own[0] @ own[0].T, atol=1e-13)
    columns[2, :, 1] = columns[2, :, 0] * (1 + 1e-9)
    assert projection._basis(columns)[1] == 9
    assert decomposed == [1]


def test_medians_of_many_windows_are_those_of_each() -> None:
    rng = np.random.default_rng(2)
    values = rng.exponential(size=(60, 3))
    far = np.abs(np.arange(60)[:, None] - np.arange(60))
    near = (far > 2) & (far <= 9)
    near[5] = False
    found = spectral_lines._medians(values, near)
    each = [np.median(values[n], axis=0) if n.any() else np.full(3, np.inf) for n in near]
    np.testing.assert_array_equal(found, each)


@pytest.mark.parametrize(("before", "after"), [(None, "1"), ("3", "3")])
def test_the_linear_algebra_has_one_thread_unless_told(
    before: str | None, after: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", before or "")
    if before is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    with pytest.raises(SystemExit):
        main(["--version"])
    assert os.environ["OPENBLAS_NUM_THREADS"] == after


def test_a_column_of_next_to_nothing_is_not_inverted() -> None:
    """One over its square is no number; warnings are errors here."""
    found = solving._inverse(np.diag([1e-320, 4.0]))
    np.testing.assert_allclose(found, np.diag([0.0, 0.25]))


@pytest.mark.parametrize("walk", [0.0, 1e-5])
def test_columns_by_axis_and_by_run_score_as_whole_ones_do(walk: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of more than few units, one of which has a run less, as no rows are laid out for all of them before."""
    table, _ = hide(recipe(2), None, 5, units=FEW_UNITS + 1, floor=WHITE)
    table = table[(table.unit.code != 3) | (table.run == 0)]
    problem = initial_problem(reduce_samples(recipe(2), table), FloorAllowance.of(recipe(2), Model()))
    banks, floor = CandidateBanks(problem.view).of(problem.view, ()), replace(problem.fit().floor, walk=walk)
    split = column_blocks(banks[0], problem.view.layout, whole=False)
    assert any(b.by_run and b.one_axis for b in split) and not all(b.one_axis for b in split)
    found = score_bank(problem, banks, floor).readings()
    monkeypatch.setattr(
        projected_bank, "column_blocks", lambda bank, layout, whole: column_blocks(bank, layout, whole=True)
    )
    whole = score_bank(problem, banks, floor).readings()
    np.testing.assert_allclose(found.evidence, whole.evidence, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.fits, whole.fits, rtol=1e-12)


@pytest.mark.parametrize("factor", [0.7, 1.0, 3.0])
def test_a_bank_in_larger_noise_is_what_it_is_scored_to_be(problem: Any, factor: float) -> None:
    turned = replace(problem.fit().floor, turn=5e-5, walk=2e-6)
    floors = [turned, NoiseFloor(*(factor * np.sqrt(turned.variances)))]
    banks = CandidateBanks(problem.view).of(problem.view, ())
    assert floors[1].is_multiple_of(floors[0]) and not replace(turned, walk=0.0).is_multiple_of(turned)
    first, whole = (score_bank(problem, banks, at, keep=at is turned) for at in floors)
    some = [i for i, c in enumerate(first.candidates) if c.name != "quadratic"]
    found = score_in_noise(problem, first.only(some), floors[1])
    whole = whole.only(some)
    assert found.projected[0].kept is not None and found.candidates == whole.candidates
    np.testing.assert_allclose(found.readings().evidence, whole.readings().evidence, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.readings().fits, whole.readings().fits, rtol=1e-12)
    for one, two in zip(found.projected, whole.projected, strict=True):
        for a, b in zip(one.found, two.found, strict=True):
            np.testing.assert_allclose(one.likelihood(a), two.likelihood(b), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("jitter_s", [0.0, 1e-4])
def test_the_power_of_even_dwells_is_that_of_each_wave(jitter_s: float, rng: np.random.Generator) -> None:
    """One stop is shorter than the others; of stamps that scatter too much, and of frames that are lost, the waves are
    made one by one."""
    stops, samples, rate = 20, 60, 100.0
    curve, late = np.ones((stops, samples, 4)), jitter_s * rng.standard_normal((stops, samples))
    late[:, 0] = curve[3, 40:] = 0.0
    time = 3.0 * np.arange(stops)[:, None] + np.arange(samples) / rate + late
    white = rng.standard_normal((stops, samples, 3)) * curve[..., :1]
    empty = TransientFilter(curve, np.zeros((stops, 3)), ())
    dwells = WhiteDwells(white, white, time, rng.uniform(0.5, 1.0, stops), rate, empty)
    tried = np.arange(3, samples) * rate / (2 * samples)
    even = tone_search._even_power(dwells, tried, dwells.weight)
    assert even is not None
    np.testing.assert_allclose(even, tone_search._uneven_power(dwells, tried, dwells.weight), rtol=1e-4)
    lost = replace(dwells, time_s=time + (np.arange(samples) > 30) / rate)
    assert tone_search._even_power(lost, tried, dwells.weight) is None


def test_columns_that_tell_the_same_count_once_for_the_noise() -> None:
    """Known columns of which some are sums of others: a floor twice as large makes each direction half as long, and no
    direction that is not there."""
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((3, 40, 9))
    columns[:, :, 6:] = columns[:, :, :3] @ rng.standard_normal((3, 3))
    _, rank, logdet = projection._basis(columns)
    assert rank == 18
    assert projection._basis(columns / 2)[2] == pytest.approx(logdet - 2 * rank * np.log(2))
