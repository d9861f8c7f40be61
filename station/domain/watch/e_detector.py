"""One stream watched for a change whose size nobody knows, with a proven bound on false alarms.

Each value becomes its rank among all before it, as a share. Whatever the distribution, the ranks of exchangeable values
are independent and uniform, exactly: nothing of the baseline is estimated. From them a mixture of Shiryaev-Roberts
statistics is made, an e-detector (Shin, Ramdas, Rinaldo, NEJSDS 2024): its mean after n values is n.
"""

import random
from bisect import bisect_left, bisect_right, insort
from collections.abc import Sequence

import numpy as np
import scipy

from station.domain.core.types import Floats

#: Shifts in standard deviations that the mixture expects, up and down, with equal weight.
SHIFTS = np.array([s * size for size in (0.35, 0.8, 1.8, 4.0) for s in (1, -1)])
#: Values learnt before the first test.
LEARN = 30
#: A shift is one of Student's t: units scatter with heavier tails than the normal distribution's.
_FREEDOM = 8
_SMALLEST = 1e-12
#: Values in a list of their own before they are merged with all others: so many, and such a share of the others, that a
#: value costs the same however many there are.
_NEWEST, _NEWEST_SHARE = 500, 0.1


class RankShares:
    """Sequential ranks in (0, 1). seed: of the ties and of the place within a rank, which randomise it."""

    def __init__(self, seed: str) -> None:
        self._sorted: list[float] = []
        self._newest: list[float] = []  # sorted, too, and short: putting a value into a long list moves half of it
        self._random = random.Random(seed)

    def __len__(self) -> int:
        return len(self._sorted) + len(self._newest)

    def add(self, value: float) -> float:
        """The share of a value among those before it; from then on it is one of them."""
        below, equal = 0, 0
        for values in (self._sorted, self._newest):
            first = bisect_left(values, value)
            below += first
            if first < len(values) and values[first] == value:
                equal += bisect_right(values, value, first) - first
        share = (below + self._random.random() * (equal + 1)) / (len(self) + 1)
        insort(self._newest, value)
        if len(self._newest) >= max(_NEWEST, _NEWEST_SHARE * len(self._sorted)):
            self._sorted, self._newest = sorted(self._sorted + self._newest), []
        return min(max(share, _SMALLEST), 1 - _SMALLEST)

    def restart(self, values: Floats) -> None:
        """From then on only these count as before."""
        self._sorted, self._newest = np.sort(values).tolist(), []


def likelihood_ratios(shares: Sequence[float]) -> Floats:
    """(n, shifts): for values whose ranks are these shares (n), Student's density of the quantile less the shift over
    that of the quantile. The mean over all shares is 1."""
    quantile = scipy.special.stdtrit(_FREEDOM, np.asarray(shares, float))[:, None]
    shifted = quantile - SHIFTS / np.sqrt((_FREEDOM - 2) / _FREEDOM)
    ratios = ((_FREEDOM + quantile**2) / (_FREEDOM + shifted**2)) ** ((_FREEDOM + 1) / 2)
    return np.asarray(ratios)


class ShiftDetector:
    """The mixture of Shiryaev-Roberts statistics of uniform shares.

    Evidence less n is a martingale, so that it reaches h after h shares or more on average. From any state it gets
    there no later than from none, for it grows with itself: within n shares at most n/h alarms are expected (Barlow
    and Proschan 1975, chapter 6: renewals new better than used).
    """

    def __init__(self) -> None:
        self._statistics = np.zeros(len(SHIFTS))
        #: n on average after n shares without a change.
        self.evidence = 0.0

    def add(self, ratios: Floats) -> None:
        """R ← (1 + R) · likelihood ratio for each shift (shifts)."""
        self._statistics = (1 + self._statistics) * ratios
        self.evidence = float(self._statistics.sum()) / len(SHIFTS)

    def restart(self) -> None:
        """Forgets all evidence."""
        self._statistics, self.evidence = np.zeros(len(SHIFTS)), 0.0
