"""Whether a change is over: "since some load as before" against "still changed", over the loads since it began."""

import math

import numpy as np

from station.domain.core.types import Floats

#: Log likelihood ratio of "as before" against "still changed" that ends a change; no load counts more than the other.
_RIGHTED_NATS, _MOST_A_LOAD = math.log(1000), 4.0
#: Beyond both levels by so many standard deviations a value says nothing more of the level.
_CLIP = 3.0
#: Degrees of freedom of Student's t, as in change_point: one bad unit counts little.
_FREEDOM = 5
#: A return is looked for at so many loads back: each of the newest, then each a tenth farther.
_BACK = np.unique(np.r_[np.arange(1, 31), np.geomspace(30, 2000, 45).astype(int)])


def righted_since(values: Floats, after: Floats) -> int | None:
    """Index of the first value (n, m) that is as before; None while the change lasts. after (m): its level when it was
    found. All are deviations from the level before, in standard deviations.

    "Still changed" may take its level from all loads or from those before the return, whichever fits better: a change
    is found where chance made it large, and at that level its later loads would look half put right.
    """
    n = len(values)
    clipped = np.clip(values, np.minimum(after, 0) - _CLIP, np.maximum(after, 0) + _CLIP)
    total = np.cumsum(clipped, axis=0)
    level = total[-1] / n
    returns = n - _BACK[n > _BACK][::-1]
    if not len(returns):
        return None
    own = total[returns - 1] / returns[:, None]  # (r, m): the change's level without the loads since
    newest = values[returns[0] :]
    since = np.arange(returns[0], n) >= returns[:, None]
    as_before = _loss(newest)
    by_own = (_loss(newest[None] - own[:, None]) - as_before).sum(axis=2)
    by_all = (_loss(newest - level) - as_before).sum(axis=1)
    apart = returns * ((own - level) ** 2).sum(axis=1) / 2
    nats = np.minimum((by_own * since).sum(axis=1), since @ by_all + apart)
    righted = np.minimum(nats, _MOST_A_LOAD * (n - returns)) >= _RIGHTED_NATS
    if righted.any():
        return int(returns[np.where(righted, nats, -math.inf).argmax()])
    # Less is left of it than chance gives so many components: it was none, or is long over.
    gone = n * float(level @ level) < values.shape[1]
    return int(returns[nats.argmax()]) if gone else None


def _loss(apart: Floats) -> Floats:
    """Negative log density of Student's t with standard deviation 1, but for its constant."""
    return np.asarray((_FREEDOM + 1) / 2 * np.log1p(apart**2 / (_FREEDOM - 2)))
