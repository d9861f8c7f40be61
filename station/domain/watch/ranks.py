"""Sequential ranks: what each value is among all before it.

Whatever the distribution, the ranks of exchangeable values are independent and uniform, exactly: nothing of the
baseline is estimated.
"""

import random
from array import array
from bisect import bisect_left, bisect_right, insort

import numpy as np

from station.domain.core.types import Floats
from station.domain.watch.rows import Rows

_SMALLEST = 1e-12
#: Values in a list of their own before they are merged with all others: so many, and such a share of the others, that a
#: value costs the same however many there are.
_NEWEST, _NEWEST_SHARE = 500, 0.1


class RankShares:
    """Sequential ranks in (0, 1). seed: of the ties and of the place within a rank, which randomise it."""

    def __init__(self, seed: str) -> None:
        self._values = Rows()  # as they came; the first of them lie sorted in _sorted, the others in _newest
        self._sorted = array("d")
        self._newest: list[float] = []  # short: putting a value into a long list moves half of it
        self._random = random.Random(seed)

    def __len__(self) -> int:
        return len(self._values)

    def add(self, value: float) -> float:
        """The share of a value among those before it; from then on it is one of them."""
        below, equal = 0, 0
        for values in (self._sorted, self._newest):
            first = bisect_left(values, value)
            below += first
            if first < len(values) and values[first] == value:
                equal += bisect_right(values, value, first) - first
        share = (below + self._random.random() * (equal + 1)) / (len(self) + 1)
        self._values.add(value)
        insort(self._newest, value)
        if len(self._newest) >= max(_NEWEST, _NEWEST_SHARE * len(self._sorted)):
            self._merge()
        return min(max(share, _SMALLEST), 1 - _SMALLEST)

    def restart(self, values: Floats) -> None:
        """From then on only these count as before. What is the same as until now is not sorted anew."""
        present = self._values.array
        shorter = min(len(present), len(values))
        differs = np.flatnonzero(present[:shorter] != values[:shorter])
        same = int(differs[0]) if len(differs) else shorter
        if same < len(self._sorted):
            self._take_out(present[same : len(self._sorted)])
        self._values.keep(same)
        self._values.extend(values[same:])
        self._newest = sorted(self._values.array[len(self._sorted) :].tolist())
        if len(self._newest) >= _NEWEST:
            self._merge()

    def _merge(self) -> None:
        merged, newest = np.frombuffer(self._sorted), np.array(self._newest)
        self._keep_sorted(np.insert(merged, np.searchsorted(merged, newest), newest))
        self._newest = []

    def _take_out(self, values: Floats) -> None:
        kept, gone = np.frombuffer(self._sorted), np.sort(values)
        # Of equal values each stands at a place of its own.
        places = np.searchsorted(kept, gone) + np.arange(len(gone)) - np.searchsorted(gone, gone)
        self._keep_sorted(np.delete(kept, places))

    def _keep_sorted(self, values: Floats) -> None:
        self._sorted = array("d", values.tobytes())
