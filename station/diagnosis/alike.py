"""Which causes these data cannot tell from a found one: d·√κ < 3.3 (method notes, section 1).

The found cause leaves a signal s in the white readings. What another cause could not imitate with any coefficients
is (I − P)s; its length is d·√κ. Two causes are named apart with 95 % confidence when that is at least 3.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.diagnosis.bank import OWN, Candidate
from station.diagnosis.evidence import spectrum
from station.diagnosis.known import accept, columns_of
from station.diagnosis.space import Space
from station.diagnosis.view import View
from station.domain.types import Floats

#: d·√κ for 95 % and for 99 % right of two.
APART_95, APART_99 = 3.29, 4.65


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """What a found cause leaves: data (U, M), the unit axes (U, M, K) it is made of, and its length d.

    own: whether each unit has axes of its own, or one set reaches over all units.
    """

    data: Floats
    axes: Floats
    own: bool
    d: float


def signal(candidate: Candidate, view: View, space: Space, hit: Floats) -> Signal:
    """The estimated signal of a candidate. hit (groups): 1 where a group acts."""
    axes, m = _axes(candidate, view, space, hit)
    own = candidate.of in OWN
    u = np.einsum("umk,um->uk", axes, space.residual)
    inverse = np.where(m > 0, 1 / np.where(m > 0, m, 1.0), 0.0)
    data = np.einsum("umk,uk->um", axes, inverse * (u if own else u.sum(0)))
    d2 = float(np.sum(data**2)) - float(np.count_nonzero(m))
    return Signal(data, axes * np.sqrt(inverse)[:, None, :], own, float(np.sqrt(max(d2, 0.0))))


def _axes(candidate: Candidate, view: View, space: Space, hit: Floats) -> tuple[Floats, Floats]:
    """Orthogonal axes (U, M, K) that a candidate can move along, and their squared lengths (U or 1, K)."""
    rows, place = columns_of(accept(candidate, hit > 0, 1.0), view)
    found, axes = spectrum(space, space.see(rows), 1, "own" if place.own else "shared")
    return axes, found.m if place.own else found.m[None]


def distance(found: Signal, other: Candidate, view: View, space: Space, hit: Floats) -> float:
    """d·√κ of a found signal against another cause, freed of what noise adds to it."""
    axes, m = _axes(other, view, space, hit)
    own = other.of in OWN
    apart = _outside(found.data[..., None], axes, m, each=False, own=own)
    noise = _outside(found.axes, axes, m, each=found.own, own=own)
    return float(np.sqrt(max(apart - noise, 0.0)))


def _outside(vectors: Floats, axes: Floats, m: Floats, *, each: bool, own: bool) -> float:
    """Sum of squares of vectors (U, M, k) outside the axes. each: every unit's part is a vector of its own; own:
    every unit has axes of its own."""
    inverse = np.where(m > 0, 1 / np.where(m > 0, m, 1.0), 0.0)
    along = axes.transpose(0, 2, 1) @ vectors
    inside = along**2 if own or each else along.sum(0, keepdims=True) ** 2
    return float(np.sum(vectors**2) - np.sum(inverse[..., None] * inside))


def alike(found: Signal, others: Sequence[tuple[Candidate, Floats]], view: View, space: Space) -> dict[str, float]:
    """d·√κ against each of the other causes, by name."""
    return {c.name: distance(found, c, view, space, hit) for c, hit in others}
