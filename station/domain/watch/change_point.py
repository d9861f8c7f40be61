"""Where a stream changed, by how much, and whether it jumped or drifts: maximum likelihood over the beginning."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats

#: Values before a change without which nothing can be said of it.
_LEAST_BEFORE = 10
#: Beyond so many robust standard deviations a value counts no further: one bad unit is no change.
_CLIP = 5.0
#: Natural logarithm of the likelihood ratio from which a drift is preferred to a jump.
_DRIFT_NATS = 3.0
#: 95 % of χ² with one degree of freedom, halved: beginnings within it of the best may be the true one.
_RANGE_NATS = 1.92
#: MAD to standard deviation of normal values.
_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class Change:
    """begin: index of the first changed value; low, high: span of likely beginnings; before, after: means; std: of one
    value; size_std: of after − before; slope, slope_std: per value, for a drift, else 0; nats: log likelihood ratio."""

    begin: int
    low: int
    high: int
    before: float
    after: float
    std: float
    size_std: float
    slope: float
    slope_std: float
    nats: float


def with_spread(values: Sequence[float]) -> tuple[Floats, float]:
    """The values, and the robust standard deviation of one of them."""
    x = np.asarray(values, float)
    step = np.diff(x)
    # Of differences: a change in the middle does not widen it.
    std = float(_MAD * np.median(np.abs(step - np.median(step))) / np.sqrt(2)) if len(step) else 0.0
    std = std or float(x.std()) or 1.0
    return x, std


def find(values: Sequence[float]) -> Change | None:
    """The likeliest change in values of one stream; None while there are too few."""
    x, std = with_spread(values)
    if len(x) <= _LEAST_BEFORE + 1:
        return None
    middle = float(np.median(x[: max(_LEAST_BEFORE, len(x) // 2)]))
    # A jump beyond the clip stays one: it is clipped about the level before it.
    x = np.clip(x, middle - 4 * _CLIP * std, middle + 4 * _CLIP * std)
    jumps, drifts = _jump_nats(x, std), _drift_nats(x, std)
    drifting = float(drifts.max()) > float(jumps.max()) + _DRIFT_NATS
    nats = drifts if drifting else jumps
    begin = int(nats.argmax())
    likely = np.flatnonzero(nats >= nats[begin] - _RANGE_NATS)
    return at(values, begin, (int(likely[0]), int(likely[-1])), drifting=drifting)


def at(values: Sequence[float], begin: int, span: tuple[int, int] | None = None, *, drifting: bool = False) -> Change:
    """The change if it began with value `begin`."""
    x, std = with_spread(values)
    before, after = x[:begin], x[begin:]
    level, std = _level(before, std)
    size = float(np.median(after) if len(after) >= _LEAST_BEFORE else after.mean()) - level
    if len(after) >= _LEAST_BEFORE:
        middle = float(np.median(after))
        size = float(np.clip(after, middle - _CLIP * std, middle + _CLIP * std).mean()) - level
    slope = slope_std = 0.0
    if drifting and len(after) > 1:
        time = np.arange(1, len(after) + 1, dtype=float)
        slope = float(time @ (after - level) / (time @ time))
        slope_std = std / float(np.sqrt(time @ time))
    size_std = std * float(np.sqrt(1 / max(len(before), 1) + 1 / max(len(after), 1)))
    low, high = span or (begin, begin)
    nats = (size / size_std) ** 2 / 2
    return Change(begin, low, high, level, level + size, std, size_std, slope, slope_std, nats)


def _level(before: Floats, std: float) -> tuple[float, float]:
    """Mean and standard deviation of what was before, single bad values clipped."""
    if not len(before):
        return 0.0, std
    middle = float(np.median(before))
    spread = float(_MAD * np.median(np.abs(before - middle))) or std
    calm = np.clip(before, middle - _CLIP * spread, middle + _CLIP * spread)
    return float(calm.mean()), float(calm.std(ddof=1)) if len(calm) > 2 and calm.std() > 0 else std


def _jump_nats(x: Floats, std: float) -> Floats:
    """Log likelihood ratio of a jump that begins with each value, both levels unknown."""
    n = len(x)
    after = np.arange(n, 0, -1, dtype=float)
    total = np.cumsum((x - x.mean())[::-1])[::-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        nats = total**2 * n / (after * (n - after)) / (2 * std**2)
    nats[:_LEAST_BEFORE] = -np.inf
    return np.asarray(nats)


def _drift_nats(x: Floats, std: float) -> Floats:
    """The same of a ramp from there on: regression on max(0, s − k + 1)."""
    n = len(x)
    after = np.arange(n, 0, -1, dtype=float)
    # Σ (s − k + 1)(x_s − x̄) over s ≥ k is the sum of the sums from each later value on.
    moment = np.cumsum(np.cumsum((x - x.mean())[::-1]))[::-1]
    square = after * (after + 1) * (2 * after + 1) / 6 - (after * (after + 1) / 2) ** 2 / n
    nats = moment**2 / np.maximum(square, 1e-300) / (2 * std**2)
    nats[:_LEAST_BEFORE] = -np.inf
    nats[-3:] = -np.inf  # a ramp of one or two values is a jump
    return np.asarray(nats)
