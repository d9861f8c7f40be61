"""Which causes these data cannot tell from a found one: d·√κ < 3.3 (docs/diagnosis.md).

The found cause leaves a signal s in the white readings. What another cause could not imitate with any coefficients
is (I − P)s; its length is d·√κ. Two causes are named apart with 95 % confidence when that is at least 3.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.diagnosis.candidates.bank import UNITS_AT_ONCE, Candidate
from station.diagnosis.candidates.nuisance import AcceptedCause, accept_candidate, accepted_columns
from station.diagnosis.linear.eigen import eigenvectors
from station.diagnosis.linear.evidence import visible_directions
from station.diagnosis.linear.grid import RowLayout
from station.diagnosis.linear.projection import ResidualSpace
from station.domain.core.types import Floats

#: d·√κ for 95 % and for 99 % right of two.
SEPARATION_95, SEPARATION_99 = 3.29, 4.65
#: Turns in which coefficients and the error of a covariate are fitted to a signal.
ERROR_ROUNDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class SignatureAxes:
    """Orthogonal axes (U, M, K) along which a cause moves white readings by one coefficient of size 1, and their
    squared lengths m (U, K), or (1, K) where one set reaches over all units (not own)."""

    vectors: Floats
    m: Floats
    own: bool

    @property
    def length(self) -> float:
        """d of coefficients of rms 1."""
        return float(np.sqrt(self.m.sum()))

    @property
    def inverse(self) -> Floats:
        """1/m, 0 where nothing is seen."""
        return _inverse(self.m)


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedSignal:
    """What a found cause leaves: data (U, M), the axes it is made of, and its length d."""

    data: Floats
    axes: SignatureAxes
    d: float


def _inverse(m: Floats) -> Floats:
    return np.where(m > 0, 1 / np.where(m > 0, m, 1.0), 0.0)


def signature_axes(candidate: Candidate, layout: RowLayout, space: ResidualSpace, hit: Floats) -> SignatureAxes:
    """What a candidate can move. hit (groups): 1 where a group acts."""
    rows, place = accepted_columns(accept_candidate(candidate.even, hit > 0, 1.0), layout)
    columns = space.project(rows)
    normal = columns.transpose(0, 2, 1) @ columns
    cross = None if place.own else np.einsum("umk,umc->kc", columns, space.shared_basis)
    m, E = _directions(normal, cross)
    return SignatureAxes(columns @ E, m, place.own)


def _directions(normal: Floats, cross: Floats | None) -> tuple[Floats, Floats]:
    """Eigenvalues (U, K) and vectors (U, K, K) of each unit's normal matrix, or (1, K) and (1, K, K) of that of all,
    whose product with the shared known columns is `cross` (K, c); 0 where nothing is seen."""
    if cross is not None:
        normal = normal.sum(0, keepdims=True) - cross @ cross.T
    m, E = eigenvectors(normal)
    visible = visible_directions(m)
    return np.where(visible, m, 0.0), E * visible[:, None, :]


def estimate_signal(candidate: Candidate, layout: RowLayout, space: ResidualSpace, hit: Floats) -> EstimatedSignal:
    """The estimated signal of a candidate."""
    axes = signature_axes(candidate, layout, space, hit)
    u = np.einsum("umk,um->uk", axes.vectors, space.residual)
    data = np.einsum("umk,uk->um", axes.vectors, axes.inverse * (u if axes.own else u.sum(0)))
    d2 = float(np.sum(data**2)) - float(np.count_nonzero(axes.m))
    return EstimatedSignal(data, axes, float(np.sqrt(max(d2, 0.0))))


def followed_share(found: EstimatedSignal, other: SignatureAxes) -> float:
    """The share of the signal that another cause can imitate, less what as many numbers of noise would."""
    total = float(np.sum(found.data**2))
    if total <= 0:
        return 0.0
    inside = total - _squares_outside(found.data[..., None], other, each=False)
    return inside / total - float(np.count_nonzero(other.m)) / max(float(np.count_nonzero(found.axes.m)), 1.0)


def distinct_share(found: SignatureAxes, other: SignatureAxes) -> float:
    """κ: the share of a cause that another cannot imitate, over all directions of its coefficients."""
    total = float(found.m.sum())
    return max(_squares_outside(found.vectors, other, each=found.own), 0.0) / total if total > 0 else 1.0


def _squares_outside(vectors: Floats, other: SignatureAxes, *, each: bool) -> float:
    """Sum of squares of vectors (U, M, k) outside the axes of another cause. each: every unit's part is a vector of
    its own."""
    along = other.vectors.transpose(0, 2, 1) @ vectors
    inside = along**2 if other.own or each else along.sum(0, keepdims=True) ** 2
    return float(np.sum(vectors**2) - np.sum(other.inverse[..., None] * inside))


def separations(
    found: EstimatedSignal, others: Sequence[tuple[Candidate, Floats]], layout: RowLayout, space: ResidualSpace
) -> dict[str, float]:
    """d·√κ of a found signal against each of the other causes, by name, freed of what noise adds to it."""
    return {c.name: _separation(found, c, hit, layout, space) for c, hit in others}


def has_covariate_error(candidate: Candidate) -> bool:
    """Whether some columns of a candidate are what its covariate may be off by."""
    return candidate.plain is not None and candidate.plain.axes < candidate.axes


def _separation(
    found: EstimatedSignal, other: Candidate, hit: Floats, layout: RowLayout, space: ResidualSpace
) -> float:
    """d·√κ against one. What an error of its covariate does is no column of any size."""
    if other.plain is None or not has_covariate_error(other):
        return float(np.sqrt(max(_apart(found, accept_candidate(other.even, hit > 0, 1.0), layout, space), 0.0)))
    apart = _apart(found, accept_candidate(other.plain, hit > 0, 1.0), layout, space)
    gained = _gained_by_error(found, other, other.plain.axes, layout, space)
    return float(np.sqrt(max(apart - gained, 0.0)))


def _gained_by_error(
    found: EstimatedSignal, other: Candidate, axes: int, layout: RowLayout, space: ResidualSpace
) -> float:
    """How much nearer a cause c · x comes to a signal as c · (x + Σ z·mode), by its coefficients c and what its
    covariate may be off by, z, which costs z²: least squares of one and the other in turns. The first `axes` columns of
    the candidate are x, each mode has as many."""
    rows, gained = other.rows(layout), 0.0
    for units in layout.grid.parts(UNITS_AT_ONCE):
        columns = space.project(rows.of_units(units), units)
        gained += float(np.sum(nearer_by_error(found.data[units], columns, axes)))
    return gained


def nearer_by_error(signal: Floats, columns: Floats, axes: int) -> Floats:
    """The same (...) of signals (..., M) of one unit each, from its white columns (..., M, axes · (1 + modes))."""
    x = columns[..., :axes]
    modes = columns[..., axes:].reshape(*columns.shape[:-1], -1, axes)
    z = np.zeros((*signal.shape[:-1], modes.shape[-2]))
    rest = []
    for _ in range(ERROR_ROUNDS):
        course = x + np.einsum("...k,...mka->...ma", z, modes)
        c = np.einsum("...am,...m->...a", np.linalg.pinv(course, rcond=1e-9), signal)
        left = signal - np.einsum("...ma,...a->...m", course, c)
        rest.append(np.sum(left**2, axis=-1) + np.sum(z**2, axis=-1))
        along = np.einsum("...mka,...a->...mk", modes, c)
        wanted = np.einsum("...mk,...m->...k", along, signal - np.einsum("...ma,...a->...m", x, c))
        squares = along.swapaxes(-1, -2) @ along + np.eye(z.shape[-1])
        z = np.linalg.solve(squares, wanted[..., None])[..., 0]
    return np.asarray(rest[0] - np.min(rest, axis=0))


def _apart(found: EstimatedSignal, other: AcceptedCause, layout: RowLayout, space: ResidualSpace) -> float:
    """d²·κ against one, some units at a time: of its white columns only small products are kept."""
    rows, place = accepted_columns(other, layout)
    unit = found.axes.vectors * np.sqrt(found.axes.inverse)[:, None, :]
    both = np.concatenate([found.data[..., None], unit], axis=2)
    normal, along, cross = list[Floats](), list[Floats](), np.zeros((rows.visit.shape[-1], space.shared_basis.shape[2]))
    for units in layout.grid.parts(UNITS_AT_ONCE):
        turned = space.project(rows.of_units(units), units).swapaxes(1, 2)
        normal.append(turned @ turned.swapaxes(1, 2))
        along.append(turned @ both[units])
        cross += (turned @ space.shared_basis[units]).sum(0)
    m, E = _directions(np.concatenate(normal), None if place.own else cross)
    inside = E.swapaxes(1, 2) @ np.concatenate(along)
    data, noise = inside[..., :1], inside[..., 1:]
    if not place.own:
        data = data.sum(0, keepdims=True)
        noise = noise if found.axes.own else noise.sum(0, keepdims=True)
    inverse = _inverse(m)[..., None]
    apart = float(np.sum(found.data**2) - np.sum(inverse * data**2))
    return apart - float(np.sum(unit**2) - np.sum(inverse * noise**2))
