"""Where a stream changed, by how much, and whether it jumped or drifts: maximum likelihood, and the posterior of the
beginning.

Levels come from values clipped about their median; the beginning from Student's likelihood, in which one bad unit
counts little. Stated is the middle of the loads that hold most of the posterior: no estimate is nearer more often.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats

Values = Sequence[float] | Floats

#: Values before a change without which nothing can be said of it.
_LEAST_BEFORE = 10
#: Beyond so many robust standard deviations a value counts no further: one bad unit is no change.
_CLIP = 5.0
#: Natural logarithm of the likelihood ratio from which a drift is preferred to a jump.
_DRIFT_NATS = 3.0
#: Share of the posterior in the span of beginnings.
_SPAN = 0.95
#: The beginning stated is the one with most of the posterior within so many values of it.
_NEAR = 2
#: Degrees of freedom of the units' scatter, heavier in the tails than the normal distribution.
_FREEDOM = 6
#: Times that levels and beginning are found from each other.
_ROUNDS = 3
#: MAD to standard deviation of normal values.
_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class Change:
    """begin: index of the first changed value; low, high: beginnings that hold 95 %; before, after: means; std: of one
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


def with_spread(values: Values) -> tuple[Floats, float]:
    """The values, and the robust standard deviation of one of them."""
    x = np.asarray(values, float)
    step = np.diff(x)
    # Of differences: a change in the middle does not widen it.
    std = float(_MAD * np.median(np.abs(step - np.median(step))) / np.sqrt(2)) if len(step) else 0.0
    std = std or float(x.std()) or 1.0
    return x, std


def find(values: Values) -> Change | None:
    """The likeliest change in values of one stream; None while there are too few."""
    x, std = with_spread(values)
    if len(x) <= _LEAST_BEFORE + 1:
        return None
    jumps, drifts = _by_beginning(x, std)
    drifting = float(drifts.max()) > float(jumps.max()) + _DRIFT_NATS
    nats = drifts if drifting else _jump_posterior(x, std, int(jumps.argmax()))
    begin, low, high = _likeliest(nats)
    return at(values, begin, (low, high), drifting=drifting)


def nats_against(values: Values, begin: int, near: int) -> float:
    """Log likelihood ratio of the likeliest beginning against the likeliest within `near` values of `begin`."""
    x, std = with_spread(values)
    nats = np.maximum(*_by_beginning(x, std))
    return float(nats.max() - nats[max(0, begin - near) : begin + near + 1].max(initial=-np.inf))


def at(values: Values, begin: int, span: tuple[int, int] | None = None, *, drifting: bool = False) -> Change:
    """The change if it began with value `begin`."""
    x, std = with_spread(values)
    before, after = x[:begin], x[begin:]
    level, std = _level(before, std)
    size = _level_after(after, std) - level
    slope = slope_std = 0.0
    if drifting and len(after) > 1:
        time = np.arange(1, len(after) + 1, dtype=float)
        slope = float(time @ (after - level) / (time @ time))
        slope_std = std / float(np.sqrt(time @ time))
    size_std = std * float(np.sqrt(1 / max(len(before), 1) + 1 / max(len(after), 1)))
    low, high = span or (begin, begin)
    nats = (size / size_std) ** 2 / 2
    return Change(begin, low, high, level, level + size, std, size_std, slope, slope_std, nats)


def _by_beginning(x: Floats, std: float) -> tuple[Floats, Floats]:
    """Log likelihood ratios (n) of a jump and of a ramp that begins with each value."""
    middle = float(np.median(x[: max(_LEAST_BEFORE, len(x) // 2)]))
    # A jump beyond the clip stays one: it is clipped about the level before it.
    clipped = np.clip(x, middle - 4 * _CLIP * std, middle + 4 * _CLIP * std)
    return _jump_nats(clipped, std), _drift_nats(clipped, std)


def _level(before: Floats, std: float) -> tuple[float, float]:
    """Mean and standard deviation of what was before, single bad values clipped."""
    if not len(before):
        return 0.0, std
    middle = float(np.median(before))
    spread = float(_MAD * np.median(np.abs(before - middle))) or std
    calm = np.clip(before, middle - _CLIP * spread, middle + _CLIP * spread)
    return float(calm.mean()), float(calm.std(ddof=1)) if len(calm) > 2 and calm.std() > 0 else std


def _level_after(after: Floats, std: float) -> float:
    """Mean of what came after; while it is short, nothing tells a bad value from the change."""
    if len(after) < _LEAST_BEFORE:
        return float(after.mean())
    middle = float(np.median(after))
    return float(np.clip(after, middle - _CLIP * std, middle + _CLIP * std).mean())


def _likeliest(nats: Floats) -> tuple[int, int, int]:
    """From the log posterior of the beginning: the one with most of it near, and the span that holds 95 %."""
    posterior = np.exp(nats - nats.max())
    posterior /= posterior.sum()
    near = np.convolve(posterior, np.ones(2 * _NEAR + 1), "same")
    # The best of equals: a lone certain beginning has all of itself near its neighbours, too.
    begin = int(np.flatnonzero(near >= near.max() - 1e-9)[posterior[near >= near.max() - 1e-9].argmax()])
    order = np.argsort(-posterior)
    held = order[: int(np.searchsorted(np.cumsum(posterior[order]), _SPAN)) + 1]
    return begin, int(min(held.min(), begin)), int(max(held.max(), begin))


def _jump_posterior(x: Floats, std: float, begin: int) -> Floats:
    """Log posterior of the beginning of a jump: Student's likelihood ratio of the levels over all values from it on."""
    nats = np.zeros(len(x))
    for _ in range(_ROUNDS):
        begin = min(begin, len(x) - 1)
        before, spread = _level(x[:begin], std)
        after = _level_after(x[begin:], spread)
        nats = np.cumsum((_log_density(x - after, spread) - _log_density(x - before, spread))[::-1])[::-1]
        # The level after is estimated from n − k values: its own uncertainty, integrated out.
        nats -= np.log(np.arange(len(x), 0, -1)) / 2
        nats[:_LEAST_BEFORE] = -np.inf
        begin = _likeliest(nats)[0]
    return np.asarray(nats)


def _log_density(apart: Floats, std: float) -> Floats:
    scale = std**2 * (_FREEDOM - 2)
    return np.asarray(-(_FREEDOM + 1) / 2 * np.log1p(apart**2 / scale))


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
