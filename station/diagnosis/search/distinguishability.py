"""Which causes these data cannot tell from a found one: d·√κ < 3.3 (docs/diagnosis.md).

The found cause leaves a signal s in the white readings. What another cause could not imitate with any coefficients
is (I − P)s; its length is d·√κ. Two causes are named apart with 95 % confidence when that is at least 3.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.nuisance import accept_candidate, accepted_columns
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.evidence import visible_directions
from station.diagnosis.linear.projection import ResidualSpace
from station.domain.core.types import Floats

#: d·√κ for 95 % and for 99 % right of two.
SEPARATION_95, SEPARATION_99 = 3.29, 4.65


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
        return np.where(self.m > 0, 1 / np.where(self.m > 0, self.m, 1.0), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedSignal:
    """What a found cause leaves: data (U, M), the axes it is made of, and its length d."""

    data: Floats
    axes: SignatureAxes
    d: float


def signature_axes(candidate: Candidate, view: ResidualView, space: ResidualSpace, hit: Floats) -> SignatureAxes:
    """What a candidate can move. hit (groups): 1 where a group acts."""
    rows, place = accepted_columns(accept_candidate(candidate, hit > 0, 1.0), view)
    columns = space.project(rows)
    normal = columns.transpose(0, 2, 1) @ columns
    if not place.own:
        cross = np.einsum("umk,umc->kc", columns, space.shared_basis)
        normal = normal.sum(0, keepdims=True) - cross @ cross.T
    m, E = np.linalg.eigh(normal)
    visible = visible_directions(m)
    return SignatureAxes(columns @ (E * visible[:, None, :]), np.where(visible, m, 0.0), place.own)


def estimate_signal(candidate: Candidate, view: ResidualView, space: ResidualSpace, hit: Floats) -> EstimatedSignal:
    """The estimated signal of a candidate."""
    axes = signature_axes(candidate, view, space, hit)
    u = np.einsum("umk,um->uk", axes.vectors, space.residual)
    data = np.einsum("umk,uk->um", axes.vectors, axes.inverse * (u if axes.own else u.sum(0)))
    d2 = float(np.sum(data**2)) - float(np.count_nonzero(axes.m))
    return EstimatedSignal(data, axes, float(np.sqrt(max(d2, 0.0))))


def separation_from(found: EstimatedSignal, other: SignatureAxes) -> float:
    """d·√κ of a found signal against another cause, freed of what noise adds to it."""
    unit = found.axes.vectors * np.sqrt(found.axes.inverse)[:, None, :]
    apart = _squares_outside(found.data[..., None], other, each=False)
    return float(np.sqrt(max(apart - _squares_outside(unit, other, each=found.axes.own), 0.0)))


def followed_share(found: EstimatedSignal, other: SignatureAxes) -> float:
    """How much of a signal another cause can imitate, less what it would of as many numbers of noise."""
    total = float(np.sum(found.data**2))
    if total <= 0:
        return 0.0
    inside = total - _squares_outside(found.data[..., None], other, each=False)
    return inside / total - float(np.count_nonzero(other.m)) / max(float(np.count_nonzero(found.axes.m)), 1.0)


def distinct_share(found: SignatureAxes, other: SignatureAxes) -> float:
    """κ: which share of a cause another cannot imitate, over all directions of its coefficients."""
    total = float(found.m.sum())
    return max(_squares_outside(found.vectors, other, each=found.own), 0.0) / total if total > 0 else 1.0


def _squares_outside(vectors: Floats, other: SignatureAxes, *, each: bool) -> float:
    """Sum of squares of vectors (U, M, k) outside the axes of another cause. each: every unit's part is a vector of
    its own."""
    along = other.vectors.transpose(0, 2, 1) @ vectors
    inside = along**2 if other.own or each else along.sum(0, keepdims=True) ** 2
    return float(np.sum(vectors**2) - np.sum(other.inverse[..., None] * inside))


def separations(
    found: EstimatedSignal, others: Sequence[tuple[Candidate, Floats]], view: ResidualView, space: ResidualSpace
) -> dict[str, float]:
    """d·√κ against each of the other causes, by name."""
    return {c.name: separation_from(found, signature_axes(c, view, space, hit)) for c, hit in others}
