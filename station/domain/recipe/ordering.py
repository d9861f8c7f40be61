"""Positions in the order of the least moving time: a path through all of them from where the fixture stands.

Up to MAX_EXACT positions the optimum itself (Bellman 1962, J. ACM 9; Held & Karp 1962, J. SIAM 10); beyond, 2-opt and
Or-opt from several nearest-neighbour paths, kicked out of their optima (Martin, Otto & Felten 1991). Costs may differ
both ways. The same costs give the same order on every day.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

Path = NDArray[np.intp]

#: Up to so many positions the search is exact.
MAX_EXACT = 14
#: The cost of a move that must not be, s: two visits at one pose tell pure error only when the fixture left it between.
FORBIDDEN_S = 1e6
#: Kicks without a better path after which the search ends, and paths from which it starts.
KICKS, STARTS = 40, 6
#: Two costs that differ by less are alike, s.
TIE_S = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class MoveTimes:
    """Moving times, s. between (n, n): from row to column; start (n): from where the fixture stands; end (n): to where
    it goes afterwards, 0 where that does not matter. FORBIDDEN_S stands where a move must not be."""

    between: Floats
    start: Floats
    end: Floats

    def of(self, path: Path) -> float:
        """Moving time of a path through all positions."""
        return float(self.start[path[0]] + self.between[path[:-1], path[1:]].sum() + self.end[path[-1]])

    def fixed(self, first: int | None, last: int | None) -> "MoveTimes":
        """The same where the path must begin or end at a given position."""
        here = np.arange(len(self.start))
        start = self.start if first is None else np.where(here == first, self.start, FORBIDDEN_S)
        end = self.end if last is None else np.where(here == last, self.end, FORBIDDEN_S)
        return MoveTimes(self.between, start, end)


def fastest(moves: MoveTimes) -> Path:
    """The best order found; the listed one where none is better."""
    n = len(moves.start)
    listed = np.arange(n)
    if n < 2:
        return listed
    found = exact(moves) if n <= MAX_EXACT else search(moves)
    return found if moves.of(found) < moves.of(listed) - TIE_S else listed


def exact(moves: MoveTimes) -> Path:
    """The optimum by dynamic programming over all subsets, those of one size at a time."""
    n = len(moves.start)
    least = np.full((1 << n, n), np.inf)
    before = np.zeros((1 << n, n), np.int8)
    least[1 << np.arange(n), np.arange(n)] = moves.start
    subsets = np.arange(1 << n)
    size = (subsets[:, None] >> np.arange(n) & 1).sum(axis=1)
    for k in range(1, n):
        of_size = subsets[size == k]
        for j in range(n):
            rows = of_size[(of_size >> j) & 1 == 0]
            total = least[rows] + moves.between[:, j]
            best = total.argmin(axis=1)
            least[rows | 1 << j, j], before[rows | 1 << j, j] = total[np.arange(len(rows)), best], best
    at, subset = int((least[-1] + moves.end).argmin()), (1 << n) - 1
    path = [at]
    while len(path) < n:
        at, subset = int(before[subset, at]), subset ^ 1 << at
        path.append(at)
    return np.array(path[::-1])


def search(moves: MoveTimes, kicks: int = KICKS, seed: int = 1) -> Path:
    """A good path for many positions: improved from several starts, then kicked until `kicks` in a row are in vain."""
    n = len(moves.start)
    cost = np.full((n + 2, n + 2), FORBIDDEN_S)
    cost[1:-1, 1:-1], cost[0, 1:-1], cost[1:-1, -1] = moves.between, moves.start, moves.end
    rng = np.random.default_rng(seed)
    starts = [_nearest(cost, int(first)) for first in np.argsort(moves.start, kind="stable")[:STARTS] + 1]
    tours = [_improved(cost, tour) for tour in (np.arange(n + 2), *starts)]
    best = min(tours, key=lambda tour: _length(cost, tour))
    in_vain = 0
    while in_vain < kicks:
        tried = _improved(cost, _double_bridge(best, rng))
        in_vain = 0 if _length(cost, tried) < _length(cost, best) - TIE_S else in_vain + 1
        best = best if in_vain else tried
    return best[1:-1] - 1


def _length(cost: Floats, tour: Path) -> float:
    return float(cost[tour[:-1], tour[1:]].sum())


def _nearest(cost: Floats, first: int) -> Path:
    """From start 0 to `first`, then always to the nearest position not yet visited, to the end n + 1."""
    n = len(cost) - 2
    tour, remaining = [0, first], [p for p in range(1, n + 1) if p != first]
    while remaining:
        tour.append(remaining.pop(int(cost[tour[-1], remaining].argmin())))
    return np.array([*tour, n + 1])


def _improved(cost: Floats, tour: Path) -> Path:
    """Turns stretches round and moves short ones elsewhere, the best change first, until nothing helps."""
    while True:
        gain, changed = max((_two_opt(cost, tour), *(_or_opt(cost, tour, k) for k in (1, 2, 3))), key=lambda g: g[0])
        if gain <= TIE_S:
            return tour
        tour = changed


def _two_opt(cost: Floats, tour: Path) -> tuple[float, Path]:
    """The best stretch to go through backwards (2-opt): seconds gained, and the tour."""
    there = np.r_[0.0, np.cumsum(cost[tour[:-1], tour[1:]])]
    back = np.r_[0.0, np.cumsum(cost[tour[1:], tour[:-1]])]
    i, j = np.triu_indices(len(tour) - 2, 1)
    i, j = i + 1, j + 1
    was = there[j + 1] - there[i - 1]
    now = cost[tour[i - 1], tour[j]] + back[j] - back[i] + cost[tour[i], tour[j + 1]]
    best = int((was - now).argmax())
    a, b = int(i[best]), int(j[best])
    return float(was[best] - now[best]), np.r_[tour[:a], tour[a : b + 1][::-1], tour[b + 1 :]]


def _or_opt(cost: Floats, tour: Path, size: int) -> tuple[float, Path]:
    """The best stretch of `size` visits to take elsewhere, either way round (Or-opt, Or 1976)."""
    n = len(tour) - 2
    if n <= size:
        return 0.0, tour
    a = np.arange(1, n - size + 2)[:, None]
    b = a + size - 1
    to = np.arange(n + 1)[None]
    out = cost[tour[a - 1], tour[a]] + cost[tour[b], tour[b + 1]] - cost[tour[a - 1], tour[b + 1]]
    gap = cost[tour[to], tour[to + 1]]
    same = out - (cost[tour[to], tour[a]] + cost[tour[b], tour[to + 1]] - gap)
    there, back = (_inside(cost, tour, a, size, forth) for forth in (True, False))
    other = out + there - back - (cost[tour[to], tour[b]] + cost[tour[a], tour[to + 1]] - gap)
    outside = (to < a - 1) | (to > b)
    gain = np.where(outside, np.maximum(same, other), -np.inf)
    row, place = np.unravel_index(int(gain.argmax()), gain.shape)
    first = int(a[row, 0])
    stretch = tour[first : first + size]
    stretch = stretch if same[row, place] >= other[row, place] else stretch[::-1]
    rest = np.r_[tour[:first], tour[first + size :]]
    at = int(place) + 1 if place < first else int(place) + 1 - size
    return float(gain[row, place]), np.r_[rest[:at], stretch, rest[at:]]


def _inside(cost: Floats, tour: Path, a: Path, size: int, forth: bool) -> Floats:
    """Cost (m, 1) within the stretches that begin at a (m, 1), one way or the other."""
    at = a + np.arange(size - 1)
    one, two = (tour[at], tour[at + 1]) if forth else (tour[at + 1], tour[at])
    return np.asarray(cost[one, two].sum(axis=1, keepdims=True))


def _double_bridge(tour: Path, rng: np.random.Generator) -> Path:
    """Two neighbouring stretches change places (double bridge)."""
    a, b, c = np.sort(rng.choice(np.arange(1, len(tour)), 3, replace=False))
    return np.concatenate([tour[:a], tour[b:c], tour[a:b], tour[c:]])
