"""Evidence against plain linear algebra on dense matrices."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.linear.evidence import (
    AMPLITUDE_RATIOS,
    HIT_SHARES,
    DataSets,
    EigenSpectrum,
    Pattern,
    log_mean_exp,
    spectrum,
)
from station.diagnosis.linear.projection import (
    DataColumns,
    FloorCovariance,
    NuisanceColumns,
    ResidualSpace,
    residual_space,
)
from station.diagnosis.linear.run_filter import RunFilter
from station.diagnosis.search.finding import is_unknown
from station.diagnosis.search.null_simulation import copy_orders
from station.diagnosis.search.scoring import evidence_by_cause
from station.domain.core.types import Floats

U, M = 3, 20
NO_COLUMNS = CauseColumns.of(np.zeros((1, 3, 0)))


def a_covariance(units: int) -> FloorCovariance:
    """White rows."""
    return FloorCovariance(RunFilter.of_white_rows(units, M), np.ones((units, M), bool), 0.0)


def a_known(rng: np.random.Generator, shared: int) -> NuisanceColumns:
    """One known column of each unit's own, and some in common."""
    own, common = rng.standard_normal((U, 1, M, 1)), rng.standard_normal((U, 1, M, shared))
    return NuisanceColumns(
        DataColumns(own), np.zeros((U, 1)), np.zeros((U, 1)), DataColumns(common), np.zeros(shared), np.zeros(shared)
    )


def tiled(known: NuisanceColumns, times: int) -> NuisanceColumns:
    """The same of so many times the units."""
    return known.of_units(np.tile(np.arange(U), times))


def a_space(rng: np.random.Generator, shared: int) -> ResidualSpace:
    """White rows of three units with one known column each, and some known ones in common."""
    known = a_known(rng, shared)
    return residual_space(a_covariance(U), known, DataColumns(rng.standard_normal((U, 1, M, 1))), U * M)


def random_columns(observed: ResidualSpace, rng: np.random.Generator, count: int) -> Floats:
    """Columns of a cause as the space sees them."""
    return observed.project(DataColumns(rng.standard_normal((U, 1, M, count))))


def dense(observed: ResidualSpace, Z: Floats) -> Floats:
    """L(ρ) with everything written out: known columns projected out, V = I + ρ Z Zᵀ."""
    rows = observed.data.shape[1]
    own = np.zeros((U * rows, U))
    for u in range(U):
        own[u * rows : (u + 1) * rows, u] = observed.basis[u, :, 0]
    X = np.concatenate([own, observed.shared_basis.reshape(U * rows, -1)], axis=1)
    y = observed.data.reshape(-1)
    rho = AMPLITUDE_RATIOS / spectrum_mean(observed, Z)
    found = []
    for r in (0.0, *rho):
        V = np.eye(len(y)) + r * Z @ Z.T
        inverse = np.linalg.inv(V)
        normal = X.T @ inverse @ X
        left = y - X @ np.linalg.solve(normal, X.T @ inverse @ y)
        rest = float(left @ inverse @ left)
        found.append(-0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(normal)[1] + observed.dof * np.log(rest)))
    return np.asarray(np.array(found[1:]) - found[0], float)


def spectrum_mean(observed: ResidualSpace, Z: Floats) -> float:
    """The mean eigenvalue by which the bank scales amplitudes; own causes are scaled before shared ones are known."""
    if Z.shape[1] == 2:
        P = observed.shared_basis.reshape(len(Z), -1)
        Z = Z - P @ np.linalg.lstsq(P, Z, rcond=None)[0] if P.shape[1] else Z
    return float(np.mean(np.linalg.eigvalsh(Z.T @ Z)))


def found(
    observed: ResidualSpace, columns: Floats, pattern: Pattern, most: float = np.inf
) -> tuple[EigenSpectrum, Floats, DataSets]:
    """The spectrum of columns (U, M, K), the components of the space's own readings, and these."""
    cross, data = (
        columns.transpose(0, 2, 1) @ observed.shared_basis,
        columns.transpose(0, 2, 1) @ observed.data[..., None],
    )
    normal = columns.transpose(0, 2, 1) @ columns
    if pattern == "shared":
        normal = normal.sum(0) - cross.sum(0) @ cross.sum(0).T
        cross, data = cross.sum(0), data.sum(0)
    m, E = np.linalg.eigh(normal)
    sets = DataSets.of(observed, observed.data[None])
    can = spectrum(observed.size, m, E.swapaxes(-1, -2) @ cross, pattern, most)
    return can, can.components((E.swapaxes(-1, -2) @ data)[..., 0][None], sets), sets


def test_of_two_runs_the_one_is_off_by_as_much_as_the_other_is_not() -> None:
    """A unit's offset is free: either run's own offset explains all of it, and both together no more."""
    odds = np.full((1, 4, 2), 30.0)
    counted = log_mean_exp(EigenSpectrum.spread(odds))[0]
    assert 4 * (30 - 5) < counted < 4 * 30
    assert EigenSpectrum.spread(np.zeros((1, 4, 2))) == pytest.approx(0.0, abs=1e-12)


@given(st.lists(st.floats(-3.0, 60.0), min_size=2, max_size=3))
def test_one_of_few_groups_at_most_is_hit(odds: list[float]) -> None:
    """Against every way to hit none or one of them."""
    each = np.array(odds)
    for k, share in enumerate(HIT_SHARES):
        chances = np.array([(1 - share) ** len(odds), *[share * (1 - share) ** (len(odds) - 1)] * len(odds)])
        wanted = np.log(np.sum(chances * np.exp([0.0, *odds])) / chances.sum())
        assert EigenSpectrum.spread(each[None, None])[0, k] == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("shared", [0, 2])
@pytest.mark.parametrize("pattern", ["own", "shared"])
def test_the_likelihood_is_that_of_dense_matrices(pattern: Pattern, shared: int) -> None:
    rng = np.random.default_rng(shared + 10)
    observed = a_space(rng, shared)
    columns = random_columns(observed, rng, 2)
    can, u, sets = found(observed, columns, pattern)
    Z = columns.reshape(-1, 2)
    if pattern == "own":
        rows = columns.shape[1]
        Z = np.zeros((U * rows, 2 * U))
        for k in range(U):
            Z[k * rows : (k + 1) * rows, 2 * k : 2 * k + 2] = columns[k]
    wanted = dense(observed, Z)
    assert can.likelihood(can.terms(u, sets), sets)[0] == pytest.approx(wanted, abs=1e-6)
    assert can.likelihood_of(u, sets)[0] == pytest.approx(wanted, abs=1e-6)


@given(st.integers(0, 99), st.integers(1, 5))
def test_likelihoods_are_the_same_by_axes_of_all_units_and_by_those_of_each(seed: int, shared: int) -> None:
    """A column that the units share may be one of the cause's own, which is then told by nothing."""
    rng = np.random.default_rng(seed)
    observed = a_space(rng, shared)
    columns = random_columns(observed, rng, 2)
    columns[..., :1] = observed.shared_basis[..., :1] if seed % 3 == 0 else columns[..., :1]
    can, u, sets = found(observed, columns, "own")
    usual = slice(0, 30 if seed % 3 == 0 else None)  # Beyond, the normal matrix of the known columns is singular.
    each = can.likelihood(can.terms(u, sets), sets)
    assert can.likelihood_of(u, sets)[0, usual] == pytest.approx(each[0, usual], abs=1e-6)


@pytest.mark.parametrize("shared", [0, 2])
@pytest.mark.parametrize("pattern", ["own", "shared"])
def test_copies_of_the_units_are_as_good_as_the_units(pattern: Pattern, shared: int) -> None:
    """Three times the same units with the same readings: once written out, once as copies that are added up."""
    rng = np.random.default_rng(shared + 20)
    known, readings, columns = (
        a_known(rng, shared),
        rng.standard_normal((U, 1, M, 1)),
        rng.standard_normal((U, 1, M, 2)),
    )
    few, many = (
        residual_space(a_covariance(n * U), tiled(known, n), DataColumns(np.tile(readings, (n, 1, 1, 1))), n * U * M)
        for n in (1, 3)
    )
    whole, u, sets = found(many, many.project(DataColumns(np.tile(columns, (3, 1, 1, 1)))), pattern)
    part = few.times(3)
    assert part.dof == many.dof
    assert part.logdet == pytest.approx(many.logdet)
    Z = part.project(DataColumns(columns))
    normal, cross, data = (Z.transpose(0, 2, 1) @ x for x in (Z, part.shared_basis, part.data[..., None]))
    if pattern == "shared":
        normal, cross, data = 3 * normal.sum(0), 3 * cross.sum(0), data.sum(0)
        normal = normal - cross @ cross.T
    m, E = np.linalg.eigh(normal)
    can = spectrum(part.size, m, E.swapaxes(-1, -2) @ cross, pattern)
    one = DataSets.of(part, part.data[None])
    terms = can.terms(can.components((E.swapaxes(-1, -2) @ data)[..., 0][None], one), one)
    orders = np.zeros((3, 1), int)
    added = np.asarray(sum(terms[order] for order in orders))
    assert can.judged(added, one.sum_over_copies(orders)) == pytest.approx(whole.evidence(u, sets), abs=1e-6)
    assert one.sum_over_copies(orders).fits == pytest.approx(sets.fits)


def test_evidence_favours_the_true_cause_and_not_noise() -> None:
    rng = np.random.default_rng(3)
    observed = a_space(rng, 0)
    right, wrong = (random_columns(observed, rng, 1) for _ in range(2))
    data = observed.data + 8 * (right / np.linalg.norm(right, axis=1, keepdims=True))[..., 0]
    scores = [score(replace(observed, data=data), columns) for columns in (right, wrong)]
    assert scores[0] > 8
    assert scores[1] < 2


def test_an_amplitude_beyond_what_is_thinkable_is_no_evidence() -> None:
    rng = np.random.default_rng(4)
    observed = a_space(rng, 0)
    faint = 1e-6 * random_columns(observed, rng, 1)
    there = replace(observed, data=observed.data + 2e6 * faint[..., 0])
    for most, low, high in ((np.inf, 5.0, np.inf), (1.0, -1.0, 0.1)):
        assert low < score(there, faint, most) < high


def score(observed: ResidualSpace, columns: Floats, most: float = np.inf) -> float:
    """Log evidence of a cause of each unit's own."""
    can, u, sets = found(observed, columns, "own", most)
    return float(can.evidence(u, sets)[0])


@pytest.mark.parametrize(("copies", "sets"), [(2, 128), (31, 128), (128, 128)])
def test_no_null_set_is_dealt_the_same_chance_twice(copies: int, sets: int) -> None:
    """A set that met itself would have its signal doubled: what is shared by all units would get a false tail."""
    orders = copy_orders(sets, copies, np.random.default_rng(1))
    assert all(len(set(column)) == copies for column in orders.T)
    assert all(sorted(order) == list(range(sets)) for order in orders)


@pytest.mark.parametrize(
    ("kernel", "cause", "unknown"),
    [(3.2, 0.2, True), (3.2, 2.0, False), (9.0, 2.0, True), (0.9, 0.2, False), (0.9, -5.0, True)],
)
def test_a_kernel_ahead_of_causes_that_explain_nothing_is_something_unknown(
    kernel: float, cause: float, unknown: bool
) -> None:
    assert is_unknown(kernel, cause) == unknown


def test_the_evidence_of_a_cause_is_the_mean_over_its_candidates() -> None:
    rng = np.random.default_rng(4)
    names = ["a", "b", "a", "c", "b", "a"]
    items = [Candidate(n, None, "unit", "own", np.zeros(1, np.int32), ("u",), NO_COLUMNS) for n in names]
    evidence = 50.0 * rng.standard_normal((7, len(names)))
    by_cause = evidence_by_cause(items, evidence)
    for name in "abc":
        own = [i for i, n in enumerate(names) if n == name]
        assert by_cause[name] == pytest.approx(log_mean_exp(evidence[:, own]), rel=1e-12)
    assert evidence_by_cause([], evidence[:, :0]) == {}
