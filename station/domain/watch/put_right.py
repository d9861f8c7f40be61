"""Whether a change is over: "since some load as before" against "still changed", over the loads since it began."""

import math

import numpy as np

from station.domain.core.types import Floats
from station.domain.watch.rows import Rows

#: Log likelihood ratio of "as before" against "still changed" that ends a change; no load counts more than the other.
_RIGHTED_NATS, _MOST_A_LOAD = math.log(1000), 4.0
#: Beyond both levels by so many standard deviations a value says nothing more of the level.
_CLIP = 3.0
#: Degrees of freedom of Student's t, as in change_point: one bad unit counts little.
_FREEDOM = 5
#: A return is looked for at so many loads back: each of the newest, then each a tenth farther.
_BACK = np.unique(np.r_[np.arange(1, 31), np.geomspace(30, 2000, 45).astype(int)])


class ReturnTest:
    """Values (m) since a change began, one after the other. after (m): its level when it was found. All are deviations
    from the level before, in standard deviations.

    "Still changed" may take its level from all loads or from those before the return, whichever fits better: a change
    is found where chance made it large, and at that level its later loads would look half put right.

    A load costs the same however long the change lasts: running sums, and the newest loads.
    """

    def __init__(self, after: Floats) -> None:
        self._low, self._high = np.minimum(after, 0) - _CLIP, np.maximum(after, 0) + _CLIP
        self._values, self._loss, self._total = Rows(len(after)), Rows(len(after)), Rows(len(after))
        self._sum = np.zeros(len(after))

    def __len__(self) -> int:
        return len(self._values)

    def extend(self, values: Floats) -> None:
        """Values (n, m) more."""
        total = np.cumsum(np.vstack([self._sum, np.clip(values, self._low, self._high)]), axis=0)
        self._sum = total[-1]
        self._values.extend(values)
        self._loss.extend(_loss(values))
        self._total.extend(total[1:])

    def righted_since(self) -> int | None:
        """Index of the first value that is as before; None while the change lasts."""
        n = len(self)
        returns = n - _BACK[n > _BACK][::-1]
        if not len(returns):
            return None
        level = self._sum / n
        own = self._total.array[returns - 1] / returns[:, None]  # (r, m): the change's level without the loads since
        nats = self._by_all(returns, level) + returns * ((own - level) ** 2).sum(axis=1) / 2
        most = _MOST_A_LOAD * (n - returns)
        open_yet = np.minimum(nats, most) >= _RIGHTED_NATS
        # Less is left of it than chance gives so many components: it was none, or is long over.
        gone = n * float(level @ level) < len(level)
        if not open_yet.any() and not gone:
            return None
        nats = np.minimum(nats, self._by_own(returns, own))
        righted = np.minimum(nats, most) >= _RIGHTED_NATS
        if righted.any():
            return int(returns[np.where(righted, nats, -math.inf).argmax()])
        return int(returns[nats.argmax()]) if gone else None

    def _by_all(self, returns: Floats, level: Floats) -> Floats:
        """Log likelihood ratio (r) over the values since each return, against this level."""
        first = int(returns[0])
        gain = (_loss(self._values.array[first:] - level) - self._loss.array[first:]).sum(axis=1)
        return np.asarray(np.cumsum(gain[::-1])[::-1][returns - first])

    def _by_own(self, returns: Floats, own: Floats) -> Floats:
        """The same against a level (r, m) for each return."""
        newest, as_before = self._values.array, self._loss.array
        pairs = zip(returns, own, strict=True)
        return np.array([float((_loss(newest[r:] - level) - as_before[r:]).sum()) for r, level in pairs])


def _loss(apart: Floats) -> Floats:
    """Negative log density of Student's t with standard deviation 1, but for its constant."""
    return np.asarray((_FREEDOM + 1) / 2 * np.log1p(apart**2 / (_FREEDOM - 2)))
