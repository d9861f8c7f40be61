"""One component of one place, value after value: what it was at each load, its ranks and its evidence."""

from bisect import bisect_left

from station.domain.core.types import Floats
from station.domain.watch.e_detector import LEARN, ShiftDetector
from station.domain.watch.ranks import RankShares
from station.domain.watch.rows import Rows

#: Values before a change, and since it began, that tell its levels to a hundredth of their scatter.
_NEAR = 5000


class Stream:
    """loads: numbers of the loads, since the last change that was put right."""

    def __init__(self, name: str) -> None:
        self.loads: list[int] = []
        self._values = Rows()
        self._newest = 0.0
        self.ranks, self.detector = RankShares(name), ShiftDetector()

    @property
    def values(self) -> Floats:
        """Of those loads."""
        return self._values.array

    def add(self, load: int, value: float) -> None:
        """The value of one load more."""
        self.loads.append(load)
        self._values.add(value)
        self._newest = value

    def rank(self) -> float | None:
        """The newest value's rank among those before, as a share; None while it only learns."""
        share = self.ranks.add(self._newest)
        return share if len(self.ranks) > LEARN else None

    def first_after(self, load: int) -> int:
        """Index of the first value of this load or later."""
        return bisect_left(self.loads, load)

    def first_near(self, index: int) -> int:
        """Index of the first value that tells what was before the one at this index: older ones tell no more of it, and
        would cost more the longer the log is."""
        return max(0, index - _NEAR)

    def first_recent(self) -> int:
        """Index of the first value at which a change that is new may have begun, and of those that tell what was
        before: the smallest shift that is found at all is found within some thousand loads."""
        return max(0, len(self.loads) - 2 * _NEAR)

    def near(self, index: int, end: int | None = None) -> tuple[Floats, int]:
        """Values near the one at this index, before `end`, and its index among them."""
        first, last = self.first_near(index), len(self.loads) if end is None else end
        return self.values[first : min(index + _NEAR, last)], index - first

    def changed(self, begin: int) -> None:
        """The value at this index and those since are another level: they count as before no more."""
        self.ranks.restart(self.values[:begin])
        self.detector.restart()

    def forget(self, load: int) -> None:
        """Values from this load on are no longer known, and all evidence is."""
        keep = self.first_after(load)
        del self.loads[keep:]
        self._values.keep(keep)
        self.changed(keep)
