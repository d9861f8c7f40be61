"""One place, load after load: its components, and its streams along each and along all of them at once."""

from bisect import bisect_left
from dataclasses import dataclass
from itertools import product

import numpy as np

from station.domain.core.types import Floats
from station.domain.watch.e_detector import LEARN, ShiftDetector
from station.domain.watch.ranks import RankShares
from station.domain.watch.rows import Rows

#: Values before a change, and since it began, that tell its levels to a hundredth of their scatter.
_NEAR = 5000
#: What the directions between the components count, of all: so little costs a change along one component a hundredth of
#: its delay, and finds one along all of them a third earlier.
_BETWEEN = 0.13


class PlaceValues:
    """What one place was. loads: their numbers, since the last change that was put right; components: (m)."""

    def __init__(self, components: int) -> None:
        self.loads: list[int] = []
        self.components = components
        self._values = Rows(components)

    def add(self, load: int, values: Floats) -> None:
        """The components of one load more."""
        self.loads.append(load)
        self._values.add(values)

    def along(self, direction: Floats, first: int, end: int | None = None) -> Floats:
        """What the loads from index `first` to before `end` were along a direction (m)."""
        return np.asarray(self._values.array[first:end] @ direction)

    def first_after(self, load: int) -> int:
        """Index of the first value of this load or later."""
        return bisect_left(self.loads, load)

    def keep(self, count: int) -> None:
        """Only the first so many loads are known from then on."""
        del self.loads[count:]
        self._values.keep(count)


@dataclass(slots=True, eq=False)
class Stream:
    """One direction (m) of a place. share: what its evidence counts."""

    known: PlaceValues
    direction: Floats
    share: float
    ranks: RankShares
    detector: ShiftDetector

    def __len__(self) -> int:
        return len(self.known.loads)

    @property
    def loads(self) -> list[int]:
        """Numbers of the loads that it has values of."""
        return self.known.loads

    @property
    def evidence(self) -> float:
        """For a change since any load."""
        return self.share * self.detector.evidence

    def values(self, first: int, end: int | None = None) -> Floats:
        """From index `first` to before `end`."""
        return self.known.along(self.direction, first, end)

    def rank(self) -> float | None:
        """The newest value's rank among those before, as a share; None while it only learns."""
        share = self.ranks.add(float(self.values(len(self) - 1)[0]))
        return share if len(self.ranks) > LEARN else None

    def first_after(self, load: int) -> int:
        """Index of the first value of this load or later."""
        return self.known.first_after(load)

    def first_near(self, index: int) -> int:
        """Index of the first value that tells what was before the one at this index: older ones tell no more of it, and
        would cost more the longer the log is."""
        return max(0, index - _NEAR)

    def first_recent(self) -> int:
        """Index of the first value at which a change that is new may have begun, and of those that tell what was
        before: the smallest shift that is found at all is found within some thousand loads."""
        return max(0, len(self) - 2 * _NEAR)

    def near(self, index: int, end: int | None = None) -> tuple[Floats, int]:
        """Values near the one at this index, before `end`, and its index among them."""
        first, last = self.first_near(index), len(self) if end is None else end
        return self.values(first, min(index + _NEAR, last)), index - first

    def changed(self, begin: int) -> None:
        """The value at this index and those since are another level: they count as before no more."""
        self.ranks.restart(self.values(0, begin))
        self.detector.restart()


def streams_of(known: PlaceValues, name: str) -> list[Stream]:
    """Along each of the components (m), then along all of them at once with every sign: 2^(m−1) directions."""
    m = known.components
    if m == 1:
        return [Stream(known, np.ones(1), 1.0, RankShares(f"{name}/0"), ShiftDetector())]
    signs = np.array([(1, *rest) for rest in product((1, -1), repeat=m - 1)])
    directions = np.vstack([np.eye(m), signs / np.sqrt(m)])
    shares = np.repeat([1 - _BETWEEN, _BETWEEN * m / len(signs)], [m, len(signs)]).tolist()
    pairs = zip(directions, shares, strict=True)
    return [Stream(known, d, share, RankShares(f"{name}/{i}"), ShiftDetector()) for i, (d, share) in enumerate(pairs)]
