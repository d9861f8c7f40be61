"""Which causes these data cannot tell from a found one: d·√κ < 3.3 (method notes, section 1).

The found cause leaves a signal s in the white readings. What another cause could not imitate with any coefficients
is (I − P)s; its length is d·√κ. Two causes are named apart with 95 % confidence when that is at least 3.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.nuisance import accept, columns_of
from station.diagnosis.data.residuals import View
from station.diagnosis.linear.evidence import seen_of
from station.diagnosis.linear.projection import Space
from station.domain.core.types import Floats

#: d·√κ for 95 % and for 99 % right of two.
APART_95, APART_99 = 3.29, 4.65


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
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
class Signal:
    """What a found cause leaves: data (U, M), the axes it is made of, and its length d."""

    data: Floats
    axes: Axes
    d: float


def axes_of(candidate: Candidate, view: View, space: Space, hit: Floats) -> Axes:
    """What a candidate can move. hit (groups): 1 where a group acts."""
    rows, place = columns_of(accept(candidate, hit > 0, 1.0), view)
    columns = space.see(rows)
    normal = columns.transpose(0, 2, 1) @ columns
    if not place.own:
        cross = np.einsum("umk,umc->kc", columns, space.border)
        normal = normal.sum(0, keepdims=True) - cross @ cross.T
    m, E = np.linalg.eigh(normal)
    seen = seen_of(m)
    return Axes(columns @ (E * seen[:, None, :]), np.where(seen, m, 0.0), place.own)


def signal(candidate: Candidate, view: View, space: Space, hit: Floats) -> Signal:
    """The estimated signal of a candidate."""
    axes = axes_of(candidate, view, space, hit)
    u = np.einsum("umk,um->uk", axes.vectors, space.residual)
    data = np.einsum("umk,uk->um", axes.vectors, axes.inverse * (u if axes.own else u.sum(0)))
    d2 = float(np.sum(data**2)) - float(np.count_nonzero(axes.m))
    return Signal(data, axes, float(np.sqrt(max(d2, 0.0))))


def distance(found: Signal, other: Axes) -> float:
    """d·√κ of a found signal against another cause, freed of what noise adds to it."""
    unit = found.axes.vectors * np.sqrt(found.axes.inverse)[:, None, :]
    apart = _outside(found.data[..., None], other, each=False)
    return float(np.sqrt(max(apart - _outside(unit, other, each=found.axes.own), 0.0)))


def share_outside(found: Axes, other: Axes) -> float:
    """κ: which share of a cause another cannot imitate, over all directions of its coefficients."""
    total = float(found.m.sum())
    return max(_outside(found.vectors, other, each=found.own), 0.0) / total if total > 0 else 1.0


def _outside(vectors: Floats, other: Axes, *, each: bool) -> float:
    """Sum of squares of vectors (U, M, k) outside the axes of another cause. each: every unit's part is a vector of
    its own."""
    along = other.vectors.transpose(0, 2, 1) @ vectors
    inside = along**2 if other.own or each else along.sum(0, keepdims=True) ** 2
    return float(np.sum(vectors**2) - np.sum(other.inverse[..., None] * inside))


def alike(found: Signal, others: Sequence[tuple[Candidate, Floats]], view: View, space: Space) -> dict[str, float]:
    """d·√κ against each of the other causes, by name."""
    return {c.name: distance(found, axes_of(c, view, space, hit)) for c, hit in others}
