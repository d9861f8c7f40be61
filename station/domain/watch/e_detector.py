"""One stream watched for a change whose size nobody knows, with a proven bound on false alarms.

Each value becomes the normal score of its rank among all before it. Whatever the distribution, the scores of
exchangeable values are independent and standard normal, exactly: nothing of the baseline is estimated. From the scores
a mixture of Shiryaev-Roberts statistics is made, an e-detector (Shin, Ramdas, Rinaldo, NEJSDS 2024): its mean after n
values is at most n, and by Doob's inequality the chance that it ever reaches h within n values is at most n/h.
"""

import random
from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable
from statistics import NormalDist

import numpy as np

#: Shifts in standard deviations that the mixture expects, up and down, with equal weight.
SHIFTS = np.array([s * size for size in (0.25, 0.5, 1.0, 2.0, 3.0) for s in (1, -1)])
#: Values learnt before the first test.
LEARN = 30

_NORMAL = NormalDist()
_SMALLEST = 1e-12


class RankScores:
    """Sequential ranks as normal scores. seed: of the ties and of the place within a rank, which randomise it."""

    def __init__(self, seed: str) -> None:
        self._sorted: list[float] = []
        self._random = random.Random(seed)

    def __len__(self) -> int:
        return len(self._sorted)

    def add(self, value: float) -> float:
        """The score of a value among those before it; from then on it is one of them."""
        below, up_to = bisect_left(self._sorted, value), bisect_right(self._sorted, value)
        place = (below + self._random.random() * (up_to - below + 1)) / (len(self._sorted) + 1)
        insort(self._sorted, value)
        return _NORMAL.inv_cdf(min(max(place, _SMALLEST), 1 - _SMALLEST))

    def restart(self, values: Iterable[float]) -> None:
        """From then on only these count as before."""
        self._sorted = sorted(values)


class ShiftDetector:
    """The mixture of Shiryaev-Roberts statistics of standard normal scores."""

    def __init__(self) -> None:
        self._statistics = np.zeros(len(SHIFTS))

    @property
    def evidence(self) -> float:
        """At most n on average after n scores without a change."""
        return float(self._statistics.mean())

    def add(self, score: float) -> float:
        """R ← (1 + R) · exp(λ z − λ²/2) for each shift λ; the evidence then."""
        self._statistics = (1 + self._statistics) * np.exp(SHIFTS * score - SHIFTS**2 / 2)
        return self.evidence

    def restart(self) -> None:
        """Forgets all evidence."""
        self._statistics = np.zeros(len(SHIFTS))
